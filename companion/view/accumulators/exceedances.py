"""How often a limit was exceeded, and when by most."""

from dataclasses import dataclass, field

import numpy as np

from companion.view.lines import Floats

_EXAMPLES = 5


@dataclass(slots=True)
class Exceedances:
    """A count of all values above their limit, and the largest few."""

    count: int = 0
    examples: list[tuple[float, float]] = field(default_factory=list)
    """(value, time in s), largest value first."""

    def add(self, times: Floats, values: Floats, limits: Floats | float) -> None:
        """Times (n,) in s, values (n,), and one limit for all of them or (n,)."""
        found = np.flatnonzero(values > limits)
        self.count += len(found)
        if len(found):
            top = found[np.argsort(values[found])[-_EXAMPLES:]]
            largest = [(float(values[index]), float(times[index])) for index in top]
            self.examples = sorted([*self.examples, *largest], reverse=True)[:_EXAMPLES]
