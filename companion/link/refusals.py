"""Telemetry that can't be true is refused: once that is worth a word, again and again it is a fault."""

from collections import deque

_TOLERATED = 3
_WITHIN_NS = 500_000_000
"""So many refusals within this time are a fault."""


class RefusedError(Exception):
    """Telemetry that can't be true; the text names the message and what is wrong with it."""

    grave = True
    """No flight goes on without such telemetry."""


class RefusedRingError(RefusedError):
    """A ring that can't be true is none; the flight goes on as without it."""

    grave = False


class RefusedOdometryError(RefusedError):
    """It says nothing of the estimate; the flight goes on as without it."""

    grave = False


class Refusals:
    """The refusals of one vehicle. Times in ns."""

    def __init__(self) -> None:
        self.count = 0
        self._latest: deque[int] = deque(maxlen=_TOLERATED)
        self._text = ""

    def add(self, text: str, now_ns: int, *, grave: bool = True) -> bool:
        """A message was refused, for what the text says; whether it is the first one. One that is not `grave` is
        missed, and no fault by itself."""
        self.count += 1
        if grave:
            self._latest.append(now_ns)
            self._text = text
        return self.count == 1

    def fault(self, now_ns: int) -> str | None:
        """The latest one, if there are too many now."""
        too_many = len(self._latest) == _TOLERATED and now_ns - self._latest[0] < _WITHIN_NS
        return self._text if too_many else None
