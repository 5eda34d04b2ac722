"""How closely the vehicle followed its reference, in each phase of the flight."""

from dataclasses import dataclass, field

import numpy as np

from companion.supervision.states import State
from companion.view.batches import Table
from companion.view.columns import largest_error
from companion.view.lines import Floats


@dataclass(slots=True)
class TrackingErrors:
    """The distances from the reference in one phase."""

    count: int = 0
    squares_ned: Floats = field(default_factory=lambda: np.zeros(3))
    """(3,) sums of the squared errors (m2)."""
    largest: float = 0.0
    """m"""
    largest_at: float = 0.0
    """s"""

    def add(self, times: Floats, errors_ned: Floats, largest: Floats) -> None:
        """Times (n,) in s, errors (n, 3) in m, and the largest distance (n,) in m since the step before."""
        self.count += len(times)
        self.squares_ned += (errors_ned**2).sum(axis=0)
        worst = int(largest.argmax())
        if largest[worst] > self.largest:
            self.largest, self.largest_at = float(largest[worst]), float(times[worst])

    @property
    def rms_ned(self) -> Floats:
        """(3,) root mean square of the error along each axis (m)."""
        return np.sqrt(self.squares_ned / max(self.count, 1))


class Tracking:
    """Tracking errors by phase, while the companion flies its mission (not while it holds or lands)."""

    def __init__(self) -> None:
        self.phases: dict[int, TrackingErrors] = {}

    def add_steps(self, times: Floats, table: Table) -> None:
        """Control steps: times (n,) in s and records of the trace (n,)."""
        errors = table["position_ned"] - table["reference_position_ned"]
        largest = largest_error(table)
        flown = table["state"] == State.FLY.value
        for phase in np.unique(table["phase"][flown]):
            chosen = flown & (table["phase"] == phase)
            self.phases.setdefault(int(phase), TrackingErrors()).add(times[chosen], errors[chosen], largest[chosen])

    @property
    def worst(self) -> TrackingErrors | None:
        """The phase with the largest error; None if nothing was flown."""
        return max(self.phases.values(), key=lambda errors: errors.largest, default=None)
