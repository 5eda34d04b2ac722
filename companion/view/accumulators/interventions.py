"""When limits, avoidance and the guard changed what was flown."""

import numpy as np

from companion.supervision.states import State
from companion.view.accumulators.exceedances import Exceedances
from companion.view.batches import Table
from companion.view.lines import Floats, Stretches


class Interventions:
    """Stretches of time by flag: 1 while it was set, 0 otherwise. They count only while the companion flies: what it
    commands in another state does not move the vehicle."""

    def __init__(self) -> None:
        self.limited = Stretches()
        """A limit on thrust or tilt was reached."""
        self.blocked = Stretches()
        """Avoidance steered away from the route."""
        self.guard = Stretches()
        """The guard changed the command, by its `Reason` (0 for no change), in any state."""
        self.guard_changes = Exceedances()
        """The largest changes of acceleration by the guard (m/s2)."""

    def add_steps(self, times: Floats, table: Table) -> None:
        """Control steps: times (n,) in s and records of the trace (n,)."""
        flown = table["state"] == State.FLY.value
        self.limited.add(times, (table["limited"] & flown).astype(np.int64))
        self.blocked.add(times, (table["blocked"] & flown).astype(np.int64))
        if "guard_reason" in (table.dtype.names or ()):  # logs from before the guard have none
            reasons = table["guard_reason"].astype(np.int64)
            self.guard.add(times, reasons)
            self.guard_changes.add(times, table["guard_change"], np.where(reasons > 0, 0.0, np.inf))
