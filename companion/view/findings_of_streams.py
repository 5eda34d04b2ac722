"""What a report says about the setpoints, the telemetry and the link."""

import math
from collections.abc import Mapping

from companion.logs.recordings import SETPOINTS
from companion.view.batches import sender_and_name
from companion.view.finding import Finding, Level, at_text, times_text
from companion.view.gather import GatheredFlight
from companion.view.lines import Regularity
from protocol.signing import REFUSED

_SLOWEST_STREAM_S = 0.05
"""Longest usual interval (s) of the streams whose gaps are looked for: slower ones do not control the flight."""
_SHORTEST_GAP = 10.0
"""Shortest gap, in usual intervals."""
_SHORTEST_GAP_S = 0.1
_LONG_GAP_S = 0.25
"""A gap that is longer than this (s) is a warning."""
_SILENT_END_S = 0.5
"""A stream that ends this long (s) before the log does has stopped."""
_TOGETHER_S = 0.25
"""Pauses that begin within so long have one cause."""
_Pauses = list[tuple[str, float, list[tuple[float, float]]]]
"""Streams by name with their usual interval (s) and their gaps: (length in s, start in s), longest first."""
_OBEYS = ("Offboard", "Guided")
"""Modes in which vehicles fly by setpoints."""
_STOPPED_S = 0.5
"""PX4's shortest usual COM_OF_LOSS_T (s)."""
_CHARTS_OF_STREAMS = {
    "ATTITUDE_QUATERNION": "Roll",
    "ATTITUDE": "Roll",
    "LOCAL_POSITION_NED": "Position north",
    "GLOBAL_POSITION_INT": "Height",
    "OBSTACLE_DISTANCE": "Clearance",
    "SERVO_OUTPUT_RAW": "Outputs of the vehicle",
}
"""What shows the pause of a stream best."""
_IMPLAUSIBLE = (("motion", "implausible pose"), ("rings", "implausible ring"))
_LINK_COUNTERS = (
    ("frames_bad", "damaged frame"),
    ("duplicates", "duplicate"),
    ("messages_late", "late message"),
    ("sequence_restarts", "sequence restart"),
)
"""Counters of the link in the log's result, without those that have a sentence of their own."""

_MOST_DIGITS = 19
"""A counter has no more; Python makes no number of thousands."""


def setpoint_gaps(flight: GatheredFlight) -> list[tuple[float, float]]:
    """Stops of the setpoints while the vehicle flew by them, longest first: (length in s, start in s)."""
    found = []
    for topic, clock in flight.clocks.items():
        message = sender_and_name(topic)
        if message is None or message[1] not in SETPOINTS or clock.count < 20:
            continue
        end = _obeyed_until(flight, clock.last + _STOPPED_S)
        gaps = [*clock.gaps, (end - clock.last, clock.last)]
        found += [gap for gap in gaps if gap[0] > _STOPPED_S and _obeyed_until(flight, gap[1] + _STOPPED_S) > gap[1]]
    return sorted(found, reverse=True)


def _obeyed_until(flight: GatheredFlight, at: float) -> float:
    """When the vehicle ended to fly by setpoints that it flew by, armed, at a time (s); -inf if it did not."""
    senders = flight.senders
    modes, armed = senders.modes.get(flight.vehicle), senders.armed.get(flight.vehicle)
    if modes is None or armed is None or not any(s.value and s.start <= at <= s.stop for s in armed.finish()):
        return -math.inf
    at_that_time = (s for s in modes.finish() if s.start <= at <= s.stop)
    obeyed = (s for s in at_that_time if senders.mode(flight.vehicle, s.value) in _OBEYS)
    return max((stretch.stop for stretch in obeyed), default=-math.inf)


def setpoints(flight: GatheredFlight) -> list[Finding]:
    gaps = setpoint_gaps(flight)
    if not gaps:
        return []
    rows = tuple(f"{seconds:.2f} s from {at_text(start)}" for seconds, start in gaps)
    text = f"The setpoints stopped for up to {gaps[0][0]:.1f} s in flight: the vehicle then acts by itself."
    return [Finding(Level.PROBLEM, "setpoints", text, rows, tuple(start for _, start in gaps), "Thrust")]


def telemetry(flight: GatheredFlight) -> list[Finding]:
    judged, found = _gaps(flight)
    found += _link(flight.log.metadata.get("result", {}))
    if judged and not found:
        found.append(Finding(Level.GOOD, "telemetry", f"No gap in {times_text(judged, 'stream')} of telemetry."))
    return found


def _gaps(flight: GatheredFlight) -> tuple[int, list[Finding]]:
    """How many streams of the vehicle were judged, and a finding for each time at which some of them paused."""
    paused: _Pauses = []
    judged = 0
    for topic, clock in sorted(flight.clocks.items()):
        message = sender_and_name(topic)
        if message is None or message[0] != flight.vehicle or clock.count < 20:
            continue
        if clock.usual > _SLOWEST_STREAM_S:
            continue
        judged += 1
        gaps = _gaps_of(clock, flight.end)
        if gaps:
            paused.append((message[1], clock.usual, gaps))
    paused.sort(key=lambda each: each[2][0][1])
    together = list[_Pauses]()
    for each in paused:
        same = together and each[2][0][1] - together[-1][0][2][0][1] < _TOGETHER_S
        if same:
            together[-1].append(each)
        else:
            together.append([each])
    return judged, [_pause(flight, each) for each in together]


def _pause(flight: GatheredFlight, streams: _Pauses) -> Finding:
    """About streams whose longest pauses began at the same time."""
    name, usual, gaps = max(streams, key=lambda each: each[2][0][0])
    longest, names = gaps[0][0], sorted(each[0] for each in streams)
    level = Level.WARNING if longest > _LONG_GAP_S else Level.NOTE
    rows = tuple(f"{seconds * 1e3:.0f} ms from {at_text(start)}" for seconds, start in gaps)
    text = f"{name} paused for up to {longest:.2f} s; it usually comes every {usual * 1e3:.1f} ms."
    ends = gaps[0][1] + longest > flight.end - _SILENT_END_S
    if ends and longest > 0.5 * (flight.end - (flight.begin or 0.0)):
        text, level = f"{' and '.join(names)} came for a part of the flight only.", Level.NOTE
    elif len(streams) > 1:
        text = f"The telemetry paused for up to {longest:.2f} s, {len(streams)} streams at once."
        rows = (*rows, ", ".join(names))
    chart = next((_CHARTS_OF_STREAMS[each] for each in names if each in _CHARTS_OF_STREAMS), "")
    return Finding(level, "telemetry", text, rows, tuple(start for _, start in gaps), chart)


def _gaps_of(clock: Regularity, end: float) -> list[tuple[float, float]]:
    """The gaps of a stream up to the log's end, longest first: (length in s, start in s)."""
    limit = max(_SHORTEST_GAP * clock.usual, _SHORTEST_GAP_S)
    gaps = [gap for gap in clock.gaps if gap[0] > limit]
    silence = end - clock.last
    if silence > max(limit, _SILENT_END_S):
        gaps.append((silence, clock.last))
    return sorted(gaps, reverse=True)


def _link(result: Mapping[str, str]) -> list[Finding]:
    """About the counters of the companion's link, as far as the log's result has them."""
    found = []
    if lost := _count(result, "messages_lost"):
        text = f"{lost} messages of the vehicle were lost on the way, by their sequence numbers."
        found.append(Finding(Level.WARNING, "telemetry", text))
    if reboots := _count(result, "reboots"):
        text = f"The vehicle's autopilot rebooted {times_text(reboots, 'time')}, by its time since boot."
        found.append(Finding(Level.WARNING, "telemetry", text))
    counted = [(_count(result, key), words) for key, words in _LINK_COUNTERS]
    rows = tuple(times_text(count, words) for count, words in counted if count)
    if rows:
        level = Level.WARNING if _count(result, "frames_bad") else Level.NOTE
        text = "Not every message of the vehicle came whole, once and in order."
        found.append(Finding(level, "telemetry", text, rows))
    unlikely = [(_count(result, f"{what}_implausible"), words) for what, words in _IMPLAUSIBLE]
    rows = tuple(times_text(count, words) for count, words in unlikely if count)
    if rows:
        text = "What the vehicle said could not always be true, and was not followed."
        found.append(Finding(Level.WARNING, "telemetry", text, rows))
    refused = {
        key.removeprefix(REFUSED).replace("_", " "): _count(result, key) for key in result if key.startswith(REFUSED)
    }
    if total := sum(refused.values()):
        text = (
            f"{times_text(total, 'message')} did not pass the check of signatures: of somebody else, or on a wrong way."
        )
        rows = tuple(f"{reason}: {count}" for reason, count in refused.items() if count)
        found.append(Finding(Level.WARNING, "signing", text, rows))
    return found


def _count(result: Mapping[str, str], key: str) -> int:
    """A counter of the log's result; 0 if it is not there or not a number of at most 19 digits."""
    value = result.get(key, "0")
    return int(value) if value.isascii() and value.isdecimal() and len(value) <= _MOST_DIGITS else 0
