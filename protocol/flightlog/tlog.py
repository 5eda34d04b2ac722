"""Telemetry logs (.tlog) as ground stations write them: 8 bytes of big-endian microseconds since 1970, then a frame,
and so on to the end. No header, no index, no checksum but the frames' own."""

import mmap
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from protocol.flightlog import MAGIC, FlightLogError
from protocol.framing import Frame, Framer

STAMP = 8
_MAGIC_V2, _MAGIC_V1 = 0xFD, 0xFE
_MAGICS = frozenset((_MAGIC_V1, _MAGIC_V2))
_find_magic = re.compile(b"[\xfd\xfe]").search
_LATEST_US = (1 << 63) // 1000
"""Such that nanoseconds fit 63 bits; it is the year 2262."""
_LOOK = 1 << 16
"""A file whose first frame does not come within so many bytes is no telemetry log."""
_GROUND_SYSTEM = 250
_COMPANIONS = frozenset(range(190, 196))
"""MAV_COMP_ID_MISSIONPLANNER, ONBOARD_COMPUTER to 4, PATHPLANNER."""


class Entry(NamedTuple):
    """One stamp and what follows it up to the next: a frame, and behind it what is damaged, if anything is."""

    time_us: int
    data: bytes


class TlogReader:
    """A telemetry log, whole or cut or damaged. Raises FlightLogError if it can't be opened or is none."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._damage: list[str] = []
        self._data: mmap.mmap | bytes
        try:
            with self.path.open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if size else b""
        except OSError as error:
            raise FlightLogError(f"{self.path}: {error.strerror or error}") from error
        self._start = self._first()
        if self._data[: len(MAGIC)] == MAGIC or self._start >= min(len(self._data), _LOOK):
            raise FlightLogError(f"{self.path}: neither a flight log (MCAP) nor a telemetry log")

    @property
    def problem(self) -> str | None:
        """What is wrong with the file, once `entries` has come by; None if nothing is."""
        if not self._damage:
            return None
        more = f" and {len(self._damage) - 3} places more" if len(self._damage) > 3 else ""
        return f"{self.path}: " + "; ".join(self._damage[:3]) + more

    def entries(self) -> Iterator[Entry]:
        """All of it, in the file's order. Bytes that are no entry stay behind the one before them."""
        self._damage.clear()
        data = self._data
        position = self._start
        if position:
            self._damage.append(f"{position} bytes before its first frame are lost")
        while position < len(data):
            stop = following = self._end(position)
            if following < len(data) and not self._starts(following):
                if not _sound(data[position + STAMP : stop]):
                    stop = position + STAMP
                following = self._next(stop)
                where = "cut off" if following >= len(data) else "damaged"
                self._damage.append(f"{where} at byte {stop}")
            yield Entry(self._stamp(position), data[position + STAMP : following])
            position = following

    def _stamp(self, position: int) -> int:
        return int.from_bytes(self._data[position : position + STAMP], "big")

    def _end(self, position: int) -> int:
        """Where the entry there ends, by its frame's length; the position itself if there is none."""
        data = self._data
        start = position + STAMP
        if start + 3 > len(data):
            return position
        if data[start] == _MAGIC_V2:
            return start + 12 + data[start + 1] + (13 if data[start + 2] & 1 else 0)
        return start + 8 + data[start + 1] if data[start] == _MAGIC_V1 else position

    def _starts(self, position: int) -> bool:
        """Whether an entry seems to start there."""
        stop = self._end(position)
        return position < stop <= len(self._data) and self._stamp(position) < _LATEST_US

    def _first(self) -> int:
        """Where the first entry starts; the end, if that is not within `_LOOK`.

        It is at once, if entry follows on entry from there to a sound frame or as far as is looked: messages that the
        dialect lacks have no checksum to go by.
        """
        position, stop = 0, min(len(self._data), _LOOK)
        while position < stop and self._starts(position):
            end = self._end(position)
            if _sound(self._data[position + STAMP : end]):
                return 0
            position = end
        return 0 if position >= stop else self._next(0, _LOOK)

    def _next(self, position: int, limit: int | None = None) -> int:
        """Where the next entry with a sound frame starts, before `limit`, or the end."""
        data = self._data
        stop = len(data) if limit is None else limit + STAMP
        while found := _find_magic(data, position + STAMP, stop):
            position = found.start() - STAMP
            if self._starts(position) and _sound(data[found.start() : self._end(position)]):
                return position
            position += 1
        return len(data)


def is_tlog(path: Path | str) -> bool:
    """Whether that file is a telemetry log, by its content."""
    with suppress(FlightLogError):
        TlogReader(path)
        return True
    return False


def write(path: Path, entries: Iterable[Entry]) -> int:
    """Make a telemetry log; how many entries it has. Raises FlightLogError if it is there already or can't be made."""
    count = 0
    try:
        with path.open("xb") as file:
            for time_us, data in entries:
                file.write(time_us.to_bytes(STAMP, "big") + data)
                count += 1
    except OSError as error:
        raise FlightLogError(f"{path}: {error.strerror or error}") from error
    return count


def from_vehicle(frame: Frame) -> bool:
    """Whether a frame of a telemetry log, which does not say so, came from the vehicle and not from who commands it."""
    return frame.system < _GROUND_SYSTEM and frame.component not in _COMPANIONS


def _sound(data: bytes) -> bool:
    frames = Framer(carry_unknown=False).datagram(data)
    return bool(frames) and len(frames[0].raw) == len(data)
