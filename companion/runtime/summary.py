"""The figures of a flight, from its log."""

import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.known_topics import is_foreign
from companion.mission.plan import Phase
from companion.records import LOOP, TRACE
from companion.supervision.states import FLYING, State
from protocol.flightlog import FlightLogError, LogReader, RecordType

Axes = tuple[float, float, float]
_FLYING = [state.value for state in FLYING]


@dataclass(frozen=True, slots=True)
class Summary:
    """Figures of a flight. Errors are along north, east and down; None if nothing was flown."""

    distance_m: float
    mae_m: Axes | None
    rmse_m: Axes | None
    seen_clearance_m: float | None
    """Least distance (m) from the hull to a return of a scan, in flight; None if nothing was seen."""
    latency_p50_us: float | None
    latency_p99_us: float | None
    messages_in: int
    messages_out: int


def summarize(path: Path) -> Summary:
    """Summarize a log. Tracking counts while the mission is flown, not while the companion holds or lands; what is near
    and how far it is count all the time in the air.

    The summary of a log that can't be opened is empty.
    """
    try:
        log = LogReader(path)
    except FlightLogError:
        return Summary(0.0, None, None, None, None, None, 0, 0)
    counts = Counter(record.topic for record in log.records())
    trace = _array(log, TRACE)
    flown = trace[trace["state"] == State.FLY.value]
    error = flown["position_ned"] - flown["reference_position_ned"]
    airborne = trace[in_the_air(trace)]
    steps = np.diff(airborne["position_ned"], axis=0)
    clearance = airborne["clearance"][np.isfinite(airborne["clearance"])]
    latency_us = latencies_us(log)
    return Summary(
        distance_m=float(np.sqrt((steps**2).sum(axis=1)).sum()),
        mae_m=_axes(np.abs(error).mean(axis=0)) if len(flown) else None,
        rmse_m=_axes(np.sqrt((error**2).mean(axis=0))) if len(flown) else None,
        seen_clearance_m=float(clearance.min()) if len(clearance) else None,
        latency_p50_us=float(np.percentile(latency_us, 50)) if len(latency_us) else None,
        latency_p99_us=float(np.percentile(latency_us, 99)) if len(latency_us) else None,
        messages_in=sum(count for topic, count in counts.items() if _is_vehicle(topic) is True),
        messages_out=sum(count for topic, count in counts.items() if _is_vehicle(topic) is False),
    )


def in_the_air(trace: NDArray[np.void]) -> NDArray[np.bool_]:
    """(n,) whether the vehicle flew at these control steps (n,), whoever flew it."""
    flying: NDArray[np.bool_] = np.isin(trace["state"], _FLYING) & (trace["phase"] > Phase.PREPARE.value)
    return flying


def latencies_us(log: LogReader) -> NDArray[np.float64]:
    """(n,) latencies (us) of all commands in order, from the receipt of an attitude to the command's departure.
    Raises FlightLogError for a record that is too short."""
    kind = log.topics.get(LOOP.topic)
    if kind is None or is_foreign(kind):
        return np.empty(0)
    try:  # in an older log each record has one latency
        found = [kind.unpack(each.data)["latency_ns"] for each in log.records((LOOP.topic,))]
    except struct.error as error:
        raise FlightLogError(f"{log.path}: a record on {LOOP.topic} is not as its schema says") from error
    return np.hstack([np.empty(0), *found]) * 1e-3


def _array(log: LogReader, kind: RecordType) -> NDArray[np.void]:
    """(n,) all records of a type; none where the log has something else on its topic."""
    there = log.topics.get(kind.topic)
    if there is None or is_foreign(there):
        return np.empty(0, [("time_ns", "<i8"), *_fields(kind)])
    return log.array(kind.topic)


def _fields(kind: RecordType) -> list[tuple[str, np.dtype[np.void], tuple[int, ...]]]:
    layout = kind.dtype
    return [(name, layout[name].base, layout[name].shape) for name in layout.names or ()]


def _axes(values: NDArray[np.float64]) -> Axes:
    north, east, down = values.tolist()
    return north, east, down


def _is_vehicle(topic: str) -> bool | None:
    """Whether the message of a topic is from the vehicle (component 1); None if the topic is no message's."""
    parts = topic.split("/")
    return parts[3] == "1" if len(parts) == 5 and parts[1] == "mavlink" else None
