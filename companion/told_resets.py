"""What positions do about the resets that the vehicle tells of: ODOMETRY's reset_counter.

The count comes less often than positions do. So the step that a reset made lies among those since the count before, or,
where the count was sooner, it is that to the next position.
"""

import math

_LEAST_M = 0.1
"""A smaller step is none: the noise of an estimate makes such ones, and they shake nothing."""

Step = tuple[float, float, float]
"""m, in the frame of the vehicle, by which a position is elsewhere than the one before and the velocities lead."""


class ToldResets:
    """The resets that one vehicle tells of."""

    def __init__(self) -> None:
        self.due = False
        """One was told of, and its step was not seen: what the next position says is believed."""
        self._largest: Step | None = None
        self._followed = False
        """A jump was followed since the count before, whatever the vehicle tells."""

    def step(self, step: Step) -> bool:
        """Look at the step to the next position; whether it is the one that is due."""
        size = math.hypot(*step)
        if size < _LEAST_M:
            return False
        if self._largest is None or size > math.hypot(*self._largest):
            self._largest = step
        return self.due

    def believed(self) -> None:
        """The next position was taken, so what was due has come or did not show."""
        self.due = False

    def refused(self) -> None:
        """The latest step leads to a position that is not believed."""
        self._largest = None

    def followed(self) -> None:
        """The frame has gone along with the latest step."""
        self._largest, self._followed = None, True

    def told(self, *, reset: bool) -> Step | None:
        """The count has come, and tells of a reset or of none: the step that it made and that was not followed yet."""
        step, followed = self._largest, self._followed
        self._largest, self._followed = None, False
        self.due = reset and step is None and not followed
        return step if reset and not followed else None
