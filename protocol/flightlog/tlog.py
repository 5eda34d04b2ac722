"""Telemetry logs (.tlog) as ground stations write them: entry after entry, without header, index or end.

An entry is a time stamp (microseconds since 1970, 8 bytes, big-endian) and a MAVLink frame. Only the frames have
checksums.
"""

import mmap
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from protocol.flightlog.mcap_format import MAGIC, FlightLogError
from protocol.framing import Frame, Framer

STAMP_BYTES = 8
_MAGIC_V2, _MAGIC_V1 = 0xFD, 0xFE
_find_magic = re.compile(b"[\xfd\xfe]").search
_LATEST_US = (1 << 63) // 1000
"""Latest stamp whose nanoseconds fit 63 bits, in the year 2262."""
_SEARCHED_BYTES = 1 << 16
"""A file without a frame within its first bytes, up to here, is no telemetry log."""
_FIRST_GROUND_SYSTEM = 250
"""System ids from here on are ground stations."""
_COMPANIONS = frozenset(range(190, 196))
"""MAV_COMP_ID_MISSIONPLANNER, ONBOARD_COMPUTER to 4, PATHPLANNER."""


class Entry(NamedTuple):
    """One stamp and the bytes up to the next: a frame, with damaged bytes behind it if there are any."""

    time_us: int
    data: bytes


class TlogReader:
    """A telemetry log, whole, cut off or damaged. Raises FlightLogError if it can't be opened or is none."""

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
        self._start = self._first_entry()
        if self._data[: len(MAGIC)] == MAGIC or self._start >= min(len(self._data), _SEARCHED_BYTES):
            raise FlightLogError(f"{self.path}: neither a flight log (MCAP) nor a telemetry log")

    @property
    def problem(self) -> str | None:
        """What is wrong with the file, known after `entries` has read it; None if nothing is."""
        if not self._damage:
            return None
        more = f" and {len(self._damage) - 3} places more" if len(self._damage) > 3 else ""
        return f"{self.path}: " + "; ".join(self._damage[:3]) + more

    def entries(self) -> Iterator[Entry]:
        """All entries in the file's order. Bytes that are no entry are part of the one before them."""
        self._damage.clear()
        data = self._data
        position = self._start
        if position:
            self._damage.append(f"{position} bytes before its first frame are lost")
        while position < len(data):
            stop = following = self._end(position)
            if following < len(data) and not self._starts(following):
                if not _is_valid_frame(data[position + STAMP_BYTES : stop]):
                    stop = position + STAMP_BYTES
                following = self._next_entry(stop)
                where = "cut off" if following >= len(data) else "damaged"
                self._damage.append(f"{where} at byte {stop}")
            yield Entry(self._stamp(position), data[position + STAMP_BYTES : following])
            position = following

    def _stamp(self, position: int) -> int:
        return int.from_bytes(self._data[position : position + STAMP_BYTES], "big")

    def _end(self, position: int) -> int:
        """Where the entry at `position` ends, by its frame's length; `position` itself if there is none."""
        data = self._data
        start = position + STAMP_BYTES
        if start + 3 > len(data):
            return position
        if data[start] == _MAGIC_V2:
            return start + 12 + data[start + 1] + (13 if data[start + 2] & 1 else 0)
        return start + 8 + data[start + 1] if data[start] == _MAGIC_V1 else position

    def _starts(self, position: int) -> bool:
        """Whether an entry seems to start at `position`."""
        stop = self._end(position)
        return position < stop <= len(self._data) and self._stamp(position) < _LATEST_US

    def _first_entry(self) -> int:
        """Where the first entry starts; the file's end if none does within _SEARCHED_BYTES.

        It is 0 if entries follow each other from there up to a valid frame or the end of the search: messages that the
        dialect lacks have no checksum that could be verified.
        """
        position, stop = 0, min(len(self._data), _SEARCHED_BYTES)
        while position < stop and self._starts(position):
            end = self._end(position)
            if _is_valid_frame(self._data[position + STAMP_BYTES : end]):
                return 0
            position = end
        return 0 if position >= stop else self._next_entry(0, _SEARCHED_BYTES)

    def _next_entry(self, position: int, limit: int | None = None) -> int:
        """Where the next entry with a valid frame starts, before `limit`, or the file's end."""
        data = self._data
        stop = len(data) if limit is None else limit + STAMP_BYTES
        while found := _find_magic(data, position + STAMP_BYTES, stop):
            position = found.start() - STAMP_BYTES
            if self._starts(position) and _is_valid_frame(data[found.start() : self._end(position)]):
                return position
            position += 1
        return len(data)


def is_tlog(path: Path | str) -> bool:
    """Whether the file's content is a telemetry log."""
    with suppress(FlightLogError):
        TlogReader(path)
        return True
    return False


def write(path: Path, entries: Iterable[Entry]) -> int:
    """Make a telemetry log; returns its number of entries. Raises FlightLogError if it exists or can't be made."""
    count = 0
    try:
        with path.open("xb") as file:
            for time_us, data in entries:
                file.write(time_us.to_bytes(STAMP_BYTES, "big") + data)
                count += 1
    except OSError as error:
        raise FlightLogError(f"{path}: {error.strerror or error}") from error
    return count


def from_vehicle(frame: Frame) -> bool:
    """Whether a frame came from the vehicle and not from a ground station or companion; a telemetry log doesn't say."""
    return frame.system < _FIRST_GROUND_SYSTEM and frame.component not in _COMPANIONS


def _is_valid_frame(data: bytes) -> bool:
    frames = Framer(carry_unknown=False).datagram(data)
    return bool(frames) and len(frames[0].raw) == len(data)
