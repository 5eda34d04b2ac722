"""Tables that come in batches, without a seam between the batches."""

import numpy as np

from companion.view.batches import Table


class Continuation:
    """Puts the last row of the batch before in front of each batch, so that differences between rows lose nothing."""

    def __init__(self) -> None:
        self._last: Table | None = None

    def join(self, table: Table) -> Table:
        """(n,) rows -> (n + 1,) rows, or (n,) rows the first time."""
        before, self._last = self._last, table[-1:].copy()
        return table if before is None else np.concatenate((before, table))
