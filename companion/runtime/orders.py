"""Orders to a flight, as lines of a pipe: each is an `Order` of `companion.mission.orders` as JSON."""

import os

from companion.supervision.operations import LandRequest, OrderRequest

LOG_AT = "companion: log at "
"""Said by a flight that takes orders, before the path of its log."""
MOST_BYTES = 1 << 18
"""Bytes of a line at most: some 2000 waypoints. A longer one is cut, so it is refused."""
_AT_ONCE = 1 << 16
"""Bytes that are read at a tick."""
_SHOWN_BYTES = 200
"""What the log holds of a longer one."""


class Orders:
    """Reads without waiting. `descriptor`: the reading end of a pipe; None for a flight that takes no orders."""

    def __init__(self, descriptor: int | None = None) -> None:
        if descriptor is not None:
            os.set_blocking(descriptor, False)
        self._descriptor = descriptor
        self._rest = b""

    def take(self, now_ns: int) -> list[OrderRequest | LandRequest]:
        """What has come since the last call. The end of the pipe, when whoever gave the orders has gone, lands; so does
        one that can't be read, as a socket whose other end was killed."""
        if self._descriptor is None:
            return []
        try:
            data = os.read(self._descriptor, _AT_ONCE)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._descriptor = None
            return [LandRequest(now_ns)]
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[: MOST_BYTES + 1]
        return [OrderRequest(now_ns, _whole(line).decode(errors="replace")) for line in lines if line.strip()]


def _whole(line: bytes) -> bytes:
    """A line, or the beginning of one that is too long, which is no JSON."""
    return line if len(line) <= MOST_BYTES else line[:_SHOWN_BYTES]
