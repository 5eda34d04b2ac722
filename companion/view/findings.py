"""What a report says about a flight in words, each finding with the figures behind it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from companion.mission.plan import Phase
from companion.outcomes import Outcome
from companion.state import Reason
from companion.supervision.states import State
from companion.view.accumulators.exceedances import Exceedances
from companion.view.batches import sender_and_name
from companion.view.gather import GatheredFlight
from companion.view.lines import Regularity, Stretch
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
_SATURATED = 0.98
"""A command is at the end of its range from this fraction of it on."""
_LONG_LIMIT_S = 0.5
_VERY_LATE_S = 0.02
_VIBRATION_NOTE, _VIBRATION_WARNING = 30.0, 60.0
"""Bounds (m/s2) that ArduPilot's documentation gives for VIBRATION's three values."""
_SHAKING_FROM_HZ = 20.0
_SHAKING_RAD_S = 0.35
"""rms of the body rates above _SHAKING_FROM_HZ (rad/s): a smooth quadrotor stays well below, 20 deg/s is audible."""
_ERROR_WARNING_M = 0.5
_CONTACT_M = 0.1
_LOW_BATTERY = 20.0
"""%"""
_MOST_EVENTS = 600
_IMPLAUSIBLE = (("motion", "implausible pose"), ("rings", "implausible ring"))
_LINK_COUNTERS = (
    ("frames_bad", "damaged frame"),
    ("duplicates", "duplicate"),
    ("messages_late", "late message"),
    ("sequence_restarts", "sequence restart"),
)
"""Counters of the link in the log's result, without those that have a sentence of their own."""
_GUARD_REASONS = {
    Reason.BARRIER: "too near to something",
    Reason.STOP: "no way to stop was left",
    Reason.NO_STOP: "there was no way to stop any more",
    Reason.STALE: "nothing was seen for too long",
}


class Level(Enum):
    """How much a finding matters, the worst first."""

    PROBLEM = "problem"
    WARNING = "warning"
    NOTE = "note"
    GOOD = "good"


@dataclass(frozen=True, slots=True)
class Finding:
    """One sentence that stands by itself, and the figures behind it."""

    level: Level
    about: str
    text: str
    evidence: tuple[str, ...] = ()
    at: tuple[float, ...] = ()
    """Times (s) to look at, the most telling first."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that was said or that changed."""

    time: float
    """s"""
    level: int
    """As in `logging`, by tens."""
    source: str
    text: str


def findings(flight: GatheredFlight) -> list[Finding]:
    """All findings about a flight, the worst first."""
    judges: tuple[Callable[[GatheredFlight], list[Finding]], ...] = (
        _outcome,
        _file,
        _failsafes,
        _clearance,
        _tracking,
        _saturation,
        _outputs,
        _telemetry,
        _deadlines,
        _interventions,
        _guard,
        _jumps,
        _vibration,
        _battery,
    )
    found = [finding for judge in judges for finding in judge(flight)]
    order = list(Level)
    return sorted(found, key=lambda finding: order.index(finding.level))


def _at(seconds: float) -> str:
    return f"{seconds:.2f} s"


def _times(count: int, what: str) -> str:
    return f"one {what}" if count == 1 else f"{count} {what}s"


def _outcome(flight: GatheredFlight) -> list[Finding]:
    verdict = flight.verdict
    if verdict is None:
        return []
    at = [text.time for text in flight.texts.companion if verdict.cause and verdict.cause in text.text]
    outcome = verdict.outcome
    level = Level.GOOD if outcome.succeeded else Level.NOTE if outcome.wanted else Level.PROBLEM
    if outcome is Outcome.UNFINISHED:
        level = Level.WARNING
    return [Finding(level, "outcome", verdict.sentence, at=tuple(at[:1]))]


def _file(flight: GatheredFlight) -> list[Finding]:
    found = []
    if flight.log.problem is not None:
        found.append(Finding(Level.WARNING, "log", f"The log is not whole: {flight.log.problem}."))
    if flight.log.missing:
        figures = ", ".join(f"{count} {name}" for name, count in flight.log.missing.items())
        found.append(Finding(Level.WARNING, "log", "Not every record reached the log.", (figures,)))
    return found


def _failsafes(flight: GatheredFlight) -> list[Finding]:
    found = []
    bad = {
        State.HOLD.value: "held",
        State.WITHDRAW.value: "asked the vehicle to hold",
        State.RELINQUISHED.value: "left the vehicle to others",
        State.RELEASED.value: "let go",
        State.GAP.value: "waited, after a gap of its own, for what the vehicle does",
        State.WATCH.value: "watched the vehicle's own failsafe",
        State.ADOPT.value: "took the vehicle over in flight, which took",
        State.DISARM.value: "disarmed what it had armed",
    }
    for stretch in flight.states.finish():
        if stretch.value in bad:
            text = f"The companion {bad[stretch.value]} for {stretch.seconds:.1f} s."
            found.append(Finding(Level.WARNING, "failsafe", text, (f"from {_at(stretch.start)}",), (stretch.start,)))
    for sender, stretches in flight.senders.critical.items():
        for stretch in stretches.finish():
            if stretch.value:
                lasting = f" for {stretch.seconds:.1f} s" if stretch.seconds >= 0.05 else ""
                text = f"The vehicle {sender} reported a critical state{lasting}."
                found.append(
                    Finding(Level.PROBLEM, "failsafe", text, (f"from {_at(stretch.start)}",), (stretch.start,))
                )
    return found[:20]


def _clearance(flight: GatheredFlight) -> list[Finding]:
    clearance = flight.clearance
    if clearance.least is None:
        return []
    (least, at), wanted = clearance.least, clearance.safe_distance
    text = f"Nothing was seen nearer than {least:.2f} m to the hull."
    percent = 100.0 * clearance.near_steps / clearance.total
    share = f"{percent:.1f} % of the steps with something near were within {wanted:g} m"
    level = Level.PROBLEM if least <= _CONTACT_M else Level.WARNING if least < 0.5 * wanted else Level.GOOD
    return [Finding(level, "clearance", text, (f"at {_at(at)}", share), (at,))]


def _tracking(flight: GatheredFlight) -> list[Finding]:
    worst = flight.tracking.worst
    if worst is None:
        return []
    rows = []
    for number, errors in sorted(flight.tracking.phases.items()):
        north, east, down = 100.0 * errors.rms_ned
        rows.append(
            f"{phase_name(number)}: rms {north:.1f}, {east:.1f}, {down:.1f} cm (north, east, down), "
            f"largest {100.0 * errors.largest:.1f} cm at {_at(errors.largest_at)}"
        )
    level = Level.WARNING if worst.largest > _ERROR_WARNING_M else Level.GOOD
    text = f"The reference was followed to within {100.0 * worst.largest:.1f} cm."
    return [Finding(level, "tracking", text, tuple(rows), (worst.largest_at,))]


def _saturation(flight: GatheredFlight) -> list[Finding]:
    if not flight.has_trace:
        return []
    limited = flight.interventions.limited
    stretches = [stretch for stretch in limited.finish() if stretch.value]
    seconds = limited.seconds.get(1, 0.0)
    count = limited.count.get(1, 0)
    if not count:
        return [Finding(Level.GOOD, "saturation", "No limit on thrust or tilt was reached.")]
    longest = max(stretches, key=lambda stretch: stretch.seconds)
    total = seconds + limited.seconds.get(0, 0.0)
    text = f"A limit on thrust or tilt was reached {_times(count, 'time')}, {seconds:.2f} s in all."
    evidence = f"{100.0 * seconds / max(total, 1e-9):.1f} % of the flight; longest {longest.seconds:.2f} s"
    level = Level.WARNING if longest.seconds > _LONG_LIMIT_S else Level.NOTE
    return [Finding(level, "saturation", text, (f"{evidence} from {_at(longest.start)}",), (longest.start,))]


def _outputs(flight: GatheredFlight) -> list[Finding]:
    """About thrust and torque commands at the end of their range; the pulses of the motors depend on the vehicle."""
    found = []
    sent = flight.output or "actuators"
    for name, quantity in (("torque", "worst_torque"), ("thrust", "worst_thrust")):
        for key, line in flight.lines.items():
            if not key.startswith(f"trace:{quantity}"):
                continue
            times, values = line.points()
            full = np.flatnonzero(np.abs(values) >= _SATURATED)
            if len(full):
                axis = {"0": "roll ", "1": "pitch ", "2": "yaw "}.get(key.rpartition(".")[2], "")
                text = f"The {axis}{name} command reached the end of its range."
                evidence = [f"{np.abs(values).max():.2f} of the whole, first at {_at(times[full[0]])}"]
                level = Level.WARNING
                if name == "torque" and sent != "actuators":
                    level = Level.NOTE
                    evidence.append(f"not sent: the output was {sent}, from which the vehicle makes its own torque")
                found.append(Finding(level, "saturation", text, tuple(evidence), (float(times[full[0]]),)))
    return found


def _telemetry(flight: GatheredFlight) -> list[Finding]:
    judged, found = _gaps(flight)
    found += _link(flight.log.metadata.get("result", {}))
    if judged and not found:
        found.append(Finding(Level.GOOD, "telemetry", f"No gap in {_times(judged, 'stream')} of telemetry."))
    return found


def _gaps(flight: GatheredFlight) -> tuple[int, list[Finding]]:
    """How many streams of the vehicle were judged, and a finding for each that has gaps."""
    found = []
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
            rows = tuple(f"{seconds * 1e3:.0f} ms from {_at(start)}" for seconds, start in gaps)
            longest, usual_ms = gaps[0][0], clock.usual * 1e3
            text = f"{message[1]} paused for up to {longest:.2f} s; it usually comes every {usual_ms:.1f} ms."
            level = Level.WARNING if longest > _LONG_GAP_S else Level.NOTE
            found.append(Finding(level, "telemetry", text, rows, tuple(start for _, start in gaps)))
    return judged, found


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
        text = f"The vehicle's autopilot rebooted {_times(reboots, 'time')}, by its time since boot."
        found.append(Finding(Level.WARNING, "telemetry", text))
    counted = [(_count(result, key), words) for key, words in _LINK_COUNTERS]
    rows = tuple(_times(count, words) for count, words in counted if count)
    if rows:
        level = Level.WARNING if _count(result, "frames_bad") else Level.NOTE
        text = "Not every message of the vehicle came whole, once and in order."
        found.append(Finding(level, "telemetry", text, rows))
    unlikely = [(_count(result, f"{what}_implausible"), words) for what, words in _IMPLAUSIBLE]
    rows = tuple(_times(count, words) for count, words in unlikely if count)
    if rows:
        text = "What the vehicle said could not always be true, and was not followed."
        found.append(Finding(Level.WARNING, "telemetry", text, rows))
    refused = {
        key.removeprefix(REFUSED).replace("_", " "): _count(result, key) for key in result if key.startswith(REFUSED)
    }
    if total := sum(refused.values()):
        text = f"{_times(total, 'message')} did not pass the check of signatures: of somebody else, or on a wrong way."
        rows = tuple(f"{reason}: {count}" for reason, count in refused.items() if count)
        found.append(Finding(Level.WARNING, "signing", text, rows))
    return found


def _count(result: Mapping[str, str], key: str) -> int:
    """A counter of the log's result; 0 if it is not there or not a number."""
    value = result.get(key, "0")
    return int(value) if value.isdigit() else 0


def _deadlines(flight: GatheredFlight) -> list[Finding]:
    timing = flight.timing
    p50, p99 = timing.latency_quantile(0.5), timing.latency_quantile(0.99)
    evidence = () if p50 is None or p99 is None else (f"attitude to command: median {p50:.0f} µs, 99 % {p99:.0f} µs",)
    late = timing.late_ticks
    if late.count:
        worst, at = late.examples[0]
        text = f"The loop was more than 2 ms late {_times(late.count, 'time')}, {worst * 1e3:.1f} ms at most."
        rows = tuple(f"{seconds * 1e3:.1f} ms at {_at(when)}" for seconds, when in late.examples)
        level = Level.WARNING if worst > _VERY_LATE_S else Level.NOTE
        return [Finding(level, "deadlines", text, (*rows, *evidence), (at,))]
    if flight.has_trace:
        return [Finding(Level.GOOD, "deadlines", "No deadline of the loop was missed.", evidence)]
    return []


def _interventions(flight: GatheredFlight) -> list[Finding]:
    blocked = flight.interventions.blocked
    stretches = [stretch for stretch in blocked.finish() if stretch.value]
    if not stretches:
        return []
    count, seconds = blocked.count[1], blocked.seconds[1]
    longest = sorted(stretches, key=lambda stretch: -stretch.seconds)[:5]
    rows = tuple(f"{stretch.seconds:.1f} s from {_at(stretch.start)}" for stretch in longest)
    text = f"Avoidance steered away from the route {_times(count, 'time')}, {seconds:.1f} s in all."
    return [Finding(Level.NOTE, "avoidance", text, rows, tuple(stretch.start for stretch in longest))]


def _guard(flight: GatheredFlight) -> list[Finding]:
    guard = flight.interventions.guard
    stretches = [stretch for stretch in guard.finish() if stretch.value != Reason.NONE]
    if not stretches:
        return []
    seconds, count = guard.seconds, guard.count
    reasons = [reason for reason in Reason if reason is not Reason.NONE and count.get(reason)]
    changes, total_s = sum(count[reason] for reason in reasons), sum(seconds[reason] for reason in reasons)
    text = f"The guard changed the command {_times(changes, 'time')}, {total_s:.2f} s in all."
    rows = [f"{_GUARD_REASONS[reason]}: {_times(count[reason], 'time')}, {seconds[reason]:.2f} s" for reason in reasons]
    rows += [f"by {size:.2f} m/s² at {_at(at)}" for size, at in flight.interventions.guard_changes.examples[:1]]
    longest = sorted(stretches, key=lambda stretch: -stretch.seconds)[:5]
    level = Level.WARNING if Reason.NO_STOP in reasons or Reason.STALE in reasons else Level.NOTE
    return [Finding(level, "guard", text, tuple(rows), tuple(stretch.start for stretch in longest))]


def _jumps(flight: GatheredFlight) -> list[Finding]:
    found = []
    for what, source, unit, scale, by_sender in (
        ("position", "velocity", "m", 1.0, flight.jumps.position),
        ("attitude", "body rates", "deg", 180.0 / np.pi, flight.jumps.attitude),
    ):
        jumps = by_sender.get(flight.vehicle, Exceedances())
        if not jumps.count:
            continue
        rows = tuple(f"{size * scale:.2f} {unit} at {_at(at)}" for size, at in jumps.examples)
        text = f"The estimated {what} jumped {_times(jumps.count, 'time')} by more than its {source} can explain."
        found.append(Finding(Level.WARNING, "estimator", text, rows, tuple(at for _, at in jumps.examples)))
    if not found and flight.vehicle in flight.jumps.position:
        found.append(Finding(Level.GOOD, "estimator", "The estimated position and attitude never jumped."))
    return found


def _vibration(flight: GatheredFlight) -> list[Finding]:
    found = []
    lines = [(key, line.points()) for key, line in flight.lines.items() if "/VIBRATION:vibration" in key]
    peaks = [(float(values.max()), float(times[values.argmax()])) for _, (times, values) in lines if len(values)]
    if peaks and max(peaks)[0] > 0.0:
        level_m_s2, at = max(peaks)
        level = (
            Level.WARNING
            if level_m_s2 > _VIBRATION_WARNING
            else Level.NOTE
            if level_m_s2 > _VIBRATION_NOTE
            else Level.GOOD
        )
        text = f"Vibration of the inertial sensors reached {level_m_s2:.1f} m/s²."
        found.append(Finding(level, "vibration", text, (f"at {_at(at)}; up to {_VIBRATION_NOTE:g} is usual",), (at,)))
    spectrum = flight.body_rates.spectrum(flight.vehicle)
    if spectrum is not None:
        rms = spectrum.rms_above(_SHAKING_FROM_HZ)
        level = Level.WARNING if rms.max() > _SHAKING_RAD_S else Level.GOOD
        roll, pitch, yaw = np.degrees(rms)
        text = f"Body rates above {_SHAKING_FROM_HZ:g} Hz: {np.degrees(rms.max()):.2f} deg/s rms on the worst axis."
        found.append(Finding(level, "vibration", text, (f"roll {roll:.2f}, pitch {pitch:.2f}, yaw {yaw:.2f} deg/s",)))
    return found


def _battery(flight: GatheredFlight) -> list[Finding]:
    for message in ("BATTERY_STATUS", "SYS_STATUS"):
        remaining = flight.lines.get(f"{flight.vehicle}/{message}:remaining")
        if remaining is None:
            continue
        times, values = remaining.points()
        if not len(values):
            continue
        lowest = float(values.min())
        level = Level.WARNING if lowest < _LOW_BATTERY else Level.GOOD
        text = f"The battery went from {values[0]:.0f} % to {values[-1]:.0f} %."
        return [Finding(level, "power", text, (f"lowest {lowest:.0f} %",), (float(times[values.argmin()]),))]
    return []


def phase_name(number: int) -> str:
    """The name of a phase by its number in the trace."""
    known = {phase.value: phase.name.lower() for phase in Phase}
    return known.get(number, f"phase {number}")


def state_name(number: int) -> str:
    """The name of a state of the supervisor by its number in the trace."""
    known = {state.value: state.name.lower() for state in State}
    return known.get(number, f"state {number}")


def events(flight: GatheredFlight) -> list[Event]:
    """What was said and what changed, in order of time, the first 600 of them."""
    senders = flight.senders
    said = flight.texts.companion or flight.texts.vehicle
    story = [Event(text.time, text.level, text.source, text.text) for text in said]
    story += _changes(flight.phases.finish(), "phase", phase_name)
    for sender, stretches in senders.modes.items():
        story += _changes(stretches.finish(), f"mode of {sender}", lambda mode: senders.mode_names.get(mode, str(mode)))
    for sender, stretches in senders.armed.items():
        story += _changes(stretches.finish(), sender, lambda armed: "armed" if armed else "disarmed")
    return sorted(story, key=lambda event: event.time)[:_MOST_EVENTS]


def _changes(stretches: list[Stretch], source: str, name: Callable[[int], str]) -> list[Event]:
    """The first value and each change, as events that a source of that name tells."""
    changes = [(after.start, after.value) for before, after in pairwise(stretches) if before.value != after.value]
    first = [(stretches[0].start, stretches[0].value)] if stretches else []
    return [Event(at, 2, source, name(value)) for at, value in (*first, *changes)]
