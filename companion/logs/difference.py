"""Compares what an autopilot sent with what its replay sends: byte for byte, and by fields where they differ."""

import math
import struct
from array import array
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from companion.records import LOGGED
from protocol.flightlog import SCALARS, RecordType
from protocol.framing import Frame, Framer
from protocol.messages import decode, layout

MISSING = "(not sent again)"
EXTRA = "(sent only now)"
BYTES = "(bytes)"


@dataclass(slots=True)
class Difference:
    """All differences in one field of one message."""

    message: str
    field: str
    """Its name, or MISSING, EXTRA, BYTES."""
    first_ns: int
    count: int = 0
    largest: float | None = None
    """Largest absolute difference, in the field's unit; inf where one of the two was; None if it is no number."""

    def add(self, size: float | None) -> None:
        """Add a difference of this size."""
        self.count += 1
        if size is not None:
            self.largest = max(size, self.largest or 0.0)


@dataclass(slots=True)
class Series:
    """A number as it was recorded and as it was replayed."""

    time_ns: "array[int]" = field(default_factory=lambda: array("q"))
    recorded: "array[float]" = field(default_factory=lambda: array("d"))
    replayed: "array[float]" = field(default_factory=lambda: array("d"))


class Differ:
    """Takes pairs of recorded and replayed data. `keeps_series`: also keep the numbers in them, for a plot."""

    def __init__(self, *, keeps_series: bool = False, trace: RecordType = LOGGED) -> None:
        self.datagrams = 0
        self.bytes = 0
        self.traces = 0
        self.series: dict[tuple[str, str], Series] = defaultdict(Series)
        self._keeps_series = keeps_series
        self._trace_names = [
            part.name if part.length is None else f"{part.name}[{index}]"
            for part in trace.fields
            for index in range(part.length or 1)
        ]
        self._trace = struct.Struct("<" + "".join(SCALARS[part.kind] * (part.length or 1) for part in trace.fields))
        self._found: dict[tuple[str, str], Difference] = {}
        self._count = 0

    @property
    def differences(self) -> list[Difference]:
        """Sorted by their first times."""
        return sorted(self._found.values(), key=lambda each: (each.first_ns, each.message, each.field))

    def datagram(self, time_ns: int, recorded: bytes, replayed: bytes) -> None:
        """Compare a datagram; one that was not sent is empty."""
        self.datagrams += bool(recorded)
        self.bytes += len(recorded)
        if recorded == replayed and not self._keeps_series:
            return
        found = self._count
        then, now = Framer().datagram(recorded), Framer().datagram(replayed)
        for one, other in _pairs(then, now):
            self._frames(time_ns, one, other)
        if recorded != replayed and found == self._count:
            self._add("datagram", BYTES, time_ns, None)  # the same frames in another order, or bytes that are no frame

    def trace(self, time_ns: int, recorded: bytes, replayed: bytes) -> None:
        """Compare a record of the trace; one that is missing is empty."""
        self.traces += bool(recorded)
        if recorded == replayed:
            return
        if not recorded or not replayed:
            self._add("trace", MISSING if recorded else EXTRA, time_ns, None)
            return
        unpack = self._trace.unpack
        for name, then, now in zip(self._trace_names, unpack(recorded), unpack(replayed), strict=True):
            if not _same(then, now):
                self._add("trace", name, time_ns, _distance(then, now))

    def _frames(self, time_ns: int, then: Frame | None, now: Frame | None) -> None:
        if then is None or now is None:
            frame = then or now
            assert frame is not None
            self._add(_name(frame), EXTRA if then is None else MISSING, time_ns, None)
            return
        if then.raw == now.raw and not self._keeps_series:
            return
        name = _name(then)
        for part in ("sequence", "system", "component"):
            if getattr(then, part) != getattr(now, part):
                self._add(name, part, time_ns, abs(getattr(then, part) - getattr(now, part)))
        if not then.known:
            if then.payload != now.payload:
                self._add(name, "payload", time_ns, None)
            return
        self._fields(time_ns, name, then, now)

    def _fields(self, time_ns: int, name: str, then: Frame, now: Frame) -> None:
        one, other = decode(then), decode(now)
        for part in layout(then.message_id).fields:
            for key, old, new in _elements(part.name, getattr(one, part.name), getattr(other, part.name)):
                if not _same(old, new):
                    self._add(name, key, time_ns, _distance(old, new))
                if self._keeps_series and isinstance(old, int | float):
                    series = self.series[name, key]
                    series.time_ns.append(time_ns)
                    series.recorded.append(old)
                    series.replayed.append(new)

    def _add(self, message: str, name: str, time_ns: int, size: float | None) -> None:
        self._count += 1
        found = self._found.get((message, name))
        if found is None:
            found = self._found[message, name] = Difference(message, name, time_ns)
        found.add(size)


def _pairs(then: list[Frame], now: list[Frame]) -> Iterator[tuple[Frame | None, Frame | None]]:
    """Pairs of frames of the same message, in their order."""
    rest = defaultdict[int, list[Frame]](list)
    for frame in now:
        rest[frame.message_id].append(frame)
    for frame in then:
        others = rest[frame.message_id]
        yield frame, others.pop(0) if others else None
    for frames in rest.values():
        for frame in frames:
            yield None, frame


def _name(frame: Frame) -> str:
    return layout(frame.message_id).name if frame.known else f"UNKNOWN_{frame.message_id}"


def _elements(name: str, then: Any, now: Any) -> Iterator[tuple[str, Any, Any]]:
    if not isinstance(then, list):
        yield name, then, now
        return
    for index, (old, new) in enumerate(zip(then, now, strict=True)):
        yield f"{name}[{index}]", old, new


def _same(then: Any, now: Any) -> bool:
    """Equal to the bit; any NaN equals any other."""
    if isinstance(then, float):
        return struct.pack("<d", then) == struct.pack("<d", now) or (math.isnan(then) and math.isnan(now))
    return bool(then == now)


def _distance(then: Any, now: Any) -> float | None:
    """None where it is no number: of texts, and between a number and none."""
    size = abs(float(now) - float(then)) if isinstance(then, int | float) else math.nan
    return None if math.isnan(size) else size
