"""Leaps of a log's clock: who writes one hears of the time during a flight, or is set anew."""

_LONGEST_PAUSE_NS = 1_800_000_000_000
_LONGEST_BACK_NS = 10_000_000_000
"""By less, records may be out of order."""


def is_leap(step_ns: int) -> bool:
    """Whether so long from one record to the next, or back, is a leap, or a pause that counts as one: half an hour."""
    return not -_LONGEST_BACK_NS < step_ns < _LONGEST_PAUSE_NS


class WithoutLeaps:
    """The times of records that follow each other, without the leaps between them."""

    def __init__(self) -> None:
        self._before_ns: int | None = None
        self._left_out_ns = 0

    def take(self, time_ns: int) -> int:
        """The next one (ns)."""
        step_ns = 0 if self._before_ns is None else time_ns - self._before_ns
        self._before_ns = time_ns
        self._left_out_ns += step_ns if is_leap(step_ns) else 0
        return time_ns - self._left_out_ns
