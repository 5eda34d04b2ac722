"""What a report says about a flight in words, each finding with the figures behind it."""

import math
from collections.abc import Callable

import numpy as np

from companion.logs.recordings import printable
from companion.outcomes import Outcome
from companion.state import Reason
from companion.supervision.states import State
from companion.view.accumulators.exceedances import Exceedances
from companion.view.events import phase_name
from companion.view.finding import Finding, Level, at_text, times_text
from companion.view.findings_of_streams import setpoint_gaps, setpoints, telemetry
from companion.view.gather import GatheredFlight
from companion.view.lines import Floats, Stretch

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
_CAUSES_WITHIN_S = 5.0
_WINDY_M_S2 = 0.5
_AT_LIMIT = 0.97
_LISTED_LEAPS = 5
_GUARD_REASONS = {
    Reason.BARRIER: "too near to something",
    Reason.STOP: "no way to stop was left",
    Reason.NO_STOP: "there was no way to stop any more",
    Reason.STALE: "nothing was seen for too long",
    Reason.EVASION: "something came towards the vehicle",
}


def findings(flight: GatheredFlight) -> list[Finding]:
    """All findings about a flight, the worst first."""
    judges: tuple[Callable[[GatheredFlight], list[Finding]], ...] = (
        _outcome,
        _file,
        setpoints,
        _failsafes,
        _clearance,
        _tracking,
        _saturation,
        _outputs,
        telemetry,
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


def _outcome(flight: GatheredFlight) -> list[Finding]:
    verdict = flight.verdict
    if verdict is None:
        return []
    at = [text.time for text in flight.texts.companion if verdict.cause and verdict.cause in text.text]
    outcome = verdict.outcome
    level = Level.GOOD if outcome.succeeded else Level.NOTE if outcome.wanted else Level.PROBLEM
    if outcome is Outcome.UNFINISHED:
        level = Level.WARNING
    return [Finding(level, "outcome", verdict.sentence, at=tuple(at[:1]), chart="Height")]


def _file(flight: GatheredFlight) -> list[Finding]:
    found = []
    if flight.log.problem is not None:
        found.append(Finding(Level.WARNING, "log", f"The log is not whole: {printable(flight.log.problem)}."))
    if flight.log.missing:
        figures = ", ".join(f"{count} {name}" for name, count in flight.log.missing.items())
        found.append(Finding(Level.WARNING, "log", "Not every record reached the log.", (figures,)))
    _, unread = flight.settings_read
    if unread is not None:
        text = "The settings that were flown can't be read here: the defaults stand for them."
        found.append(Finding(Level.WARNING, "settings", text, (printable(unread),)))
    if flight.scans.left_out:
        text = f"Not drawn: {times_text(flight.scans.left_out, 'ring')} without bearings from the vehicle's nose."
        found.append(Finding(Level.NOTE, "rings", text))
    if foreign := flight.foreign:
        text = f"Left out: {times_text(len(foreign), 'topic')} without the fields that the name says."
        found.append(Finding(Level.WARNING, "log", text, foreign))
    if flight.leaps:
        rows = tuple(f"{_leap(by)} at {at_text(at)}" for at, by in flight.leaps[:_LISTED_LEAPS])
        text = f"The log's clock leapt {times_text(len(flight.leaps), 'time')}; the times here are without that."
        found.append(Finding(Level.WARNING, "log", text, rows, tuple(at for at, _ in flight.leaps[:_LISTED_LEAPS])))
    return found


def _leap(seconds: float) -> str:
    """A leap ahead may be a pause, too."""
    days, hours = abs(seconds) / 86_400.0, abs(seconds) / 3600.0
    long = f"{days:.1f} days" if days >= 2.0 else f"{hours:.1f} h" if hours >= 1.0 else f"{abs(seconds):.0f} s"
    return f"{long} ahead, or nothing was recorded for so long," if seconds > 0.0 else f"{long} back"


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
            found.append(
                Finding(
                    Level.WARNING, "failsafe", text, (f"from {at_text(stretch.start)}",), (stretch.start,), "Height"
                )
            )
    for sender, stretches in flight.senders.critical.items():
        for stretch in stretches.finish():
            if stretch.value:
                lasting = f" for {stretch.seconds:.1f} s" if stretch.seconds >= 0.05 else ""
                text = f"The {flight.senders.name(sender)} reported a critical state{lasting}."
                evidence = [f"from {at_text(stretch.start)}"]
                evidence += [
                    f"setpoints had stopped at {at_text(start)}"
                    for _, start in setpoint_gaps(flight)
                    if start < stretch.start < start + _CAUSES_WITHIN_S
                ]
                found.append(Finding(Level.PROBLEM, "failsafe", text, tuple(evidence), (stretch.start,), "Height"))
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
    return [Finding(level, "clearance", text, (f"at {at_text(at)}", share), (at,), "Clearance")]


def _tracking(flight: GatheredFlight) -> list[Finding]:
    worst = flight.tracking.worst
    if worst is None:
        return []
    rows = []
    for number, errors in sorted(flight.tracking.phases.items()):
        north, east, down = 100.0 * errors.rms_ned
        rows.append(
            f"{phase_name(number)}: rms {north:.1f}, {east:.1f}, {down:.1f} cm (north, east, down), "
            f"largest {100.0 * errors.largest:.1f} cm at {at_text(errors.largest_at)}"
        )
    level = Level.WARNING if worst.largest > _ERROR_WARNING_M else Level.GOOD
    text = f"The reference was followed to within {100.0 * worst.largest:.1f} cm."
    if level is Level.WARNING:
        rows += _wind(flight)
    return [Finding(level, "tracking", text, tuple(rows), (worst.largest_at,), "Distance from the reference")]


def _wind(flight: GatheredFlight) -> list[str]:
    """What pushed the vehicle, as the disturbance observer had it."""
    lines = [flight.lines.get(f"trace:disturbance_ned.{axis}") for axis in range(2)]
    means = [float(line.points()[1].mean()) for line in lines if line is not None and len(line.points()[1])]
    push = math.hypot(*means)
    if len(means) < 2 or push < _WINDY_M_S2:
        return []
    from_deg = math.degrees(math.atan2(-means[1], -means[0])) % 360.0
    return [f"wind, it seems: a push of {push:.1f} m/s² on average, from {from_deg:.0f}°"]


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
    text = f"A limit on thrust or tilt was reached {times_text(count, 'time')}, {seconds:.2f} s in all."
    share = f"{100.0 * seconds / max(total, 1e-9):.1f} % of the flight; longest {longest.seconds:.2f} s"
    evidence = [f"{share} from {at_text(longest.start)}"]
    level, chart = Level.NOTE, "Roll"
    if longest.seconds > _LONG_LIMIT_S:
        level = Level.WARNING
        cause, chart = _cause_of_limit(flight, longest)
        evidence.append(cause)
    return [Finding(level, "saturation", text, tuple(evidence), (longest.start,), chart)]


def _cause_of_limit(flight: GatheredFlight, stretch: Stretch) -> tuple[str, str]:
    """What a long stretch at a limit is likely to come from, and the chart that shows it."""
    line = flight.lines.get("trace:thrust_command")
    times, values = line.points() if line is not None else (np.empty(0), np.empty(0))
    during = values[(times >= stretch.start) & (times <= stretch.stop)]
    if len(during) and np.median(during) >= _AT_LIMIT * flight.settings.limits.highest_thrust:
        return "thrust was at its upper limit: too heavy, a weak battery, or a climb that is too hard", "Thrust"
    return "tilt was at its limit: wind, or a manoeuvre that needs a larger limits.tilt_deg", "Roll"


def _outputs(flight: GatheredFlight) -> list[Finding]:
    """About thrust and torque commands at the end of their range; the pulses of the motors depend on the vehicle."""
    found = []
    sent = flight.output or "actuators"
    for name, quantity in (("torque", "worst_torque"), ("thrust", "worst_thrust")):
        if name == "torque" and sent != "actuators":  # the vehicle makes its own from what is sent
            continue
        for key, line in flight.lines.items():
            if not key.startswith(f"trace:{quantity}"):
                continue
            times, values = line.points()
            full = np.flatnonzero(np.abs(values) >= _SATURATED)
            if len(full):
                axis = {"0": "roll ", "1": "pitch ", "2": "yaw "}.get(key.rpartition(".")[2], "")
                text = f"The {axis}{name} command reached the end of its range."
                evidence = (f"{np.abs(values).max():.2f} of the whole, first at {at_text(times[full[0]])}",)
                at = (float(times[full[0]]),)
                found.append(Finding(Level.WARNING, "saturation", text, evidence, at, name.capitalize()))
    return found


def _deadlines(flight: GatheredFlight) -> list[Finding]:
    timing = flight.timing
    p50, p99 = timing.latency_quantile(0.5), timing.latency_quantile(0.99)
    evidence = () if p50 is None or p99 is None else (f"attitude to command: median {p50:.0f} µs, 99 % {p99:.0f} µs",)
    late = timing.late_ticks
    if late.count:
        worst, at = late.examples[0]
        text = f"The loop was more than 2 ms late {times_text(late.count, 'time')}, {worst * 1e3:.1f} ms at most."
        rows = tuple(f"{seconds * 1e3:.1f} ms at {at_text(when)}" for seconds, when in late.examples)
        level = Level.WARNING if worst > _VERY_LATE_S else Level.NOTE
        return [Finding(level, "deadlines", text, (*rows, *evidence), (at,), "Lateness of the loop's ticks")]
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
    rows = tuple(f"{stretch.seconds:.1f} s from {at_text(stretch.start)}" for stretch in longest)
    text = f"Avoidance steered away from the route {times_text(count, 'time')}, {seconds:.1f} s in all."
    return [Finding(Level.NOTE, "avoidance", text, rows, tuple(stretch.start for stretch in longest), "Clearance")]


def _guard(flight: GatheredFlight) -> list[Finding]:
    guard = flight.interventions.guard
    stretches = [stretch for stretch in guard.finish() if stretch.value != Reason.NONE]
    if not stretches:
        return []
    seconds, count = guard.seconds, guard.count
    reasons = [reason for reason in Reason if reason is not Reason.NONE and count.get(reason)]
    changes, total_s = sum(count[reason] for reason in reasons), sum(seconds[reason] for reason in reasons)
    text = f"The guard changed the command {times_text(changes, 'time')}, {total_s:.2f} s in all."
    rows = [
        f"{_GUARD_REASONS[reason]}: {times_text(count[reason], 'time')}, {seconds[reason]:.2f} s" for reason in reasons
    ]
    rows += [f"by {size:.2f} m/s² at {at_text(at)}" for size, at in flight.interventions.guard_changes.examples[:1]]
    longest = sorted(stretches, key=lambda stretch: -stretch.seconds)[:5]
    level = Level.WARNING if Reason.NO_STOP in reasons or Reason.STALE in reasons else Level.NOTE
    at = tuple(stretch.start for stretch in longest)
    return [Finding(level, "guard", text, tuple(rows), at, "Guard change")]


def _jumps(flight: GatheredFlight) -> list[Finding]:
    found = []
    for what, source, unit, scale, by_sender in (
        ("position", "velocity", "m", 1.0, flight.jumps.position),
        ("attitude", "body rates", "deg", 180.0 / np.pi, flight.jumps.attitude),
    ):
        jumps = by_sender.get(flight.vehicle, Exceedances())
        if not jumps.count:
            continue
        rows = tuple(f"{size * scale:.2f} {unit} at {at_text(at)}" for size, at in jumps.examples)
        text = f"The estimated {what} jumped {times_text(jumps.count, 'time')} by more than its {source} can explain."
        at, chart = tuple(at for _, at in jumps.examples), "Position north" if what == "position" else "Roll"
        found.append(Finding(Level.WARNING, "estimator", text, rows, at, chart))
    if not found and flight.vehicle in flight.jumps.position:
        found.append(Finding(Level.GOOD, "estimator", "The estimated position and attitude never jumped."))
    return found


def _vibration(flight: GatheredFlight) -> list[Finding]:
    found = []
    told = f"{flight.vehicle}/VIBRATION:vibration"
    lines = [line.points() for key, line in flight.lines.items() if key.startswith(told)]
    peaks = [(float(values.max()), float(times[values.argmax()])) for times, values in lines if len(values)]
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
        evidence = (f"at {at_text(at)}; up to {_VIBRATION_NOTE:g} is usual",)
        found.append(Finding(level, "vibration", text, evidence, (at,), "Vibration"))
    spectrum = flight.body_rates.spectrum(flight.vehicle)
    if spectrum is not None:
        rms = spectrum.rms_above(_SHAKING_FROM_HZ)
        level = Level.WARNING if rms.max() > _SHAKING_RAD_S else Level.GOOD
        roll, pitch, yaw = np.degrees(rms)
        text = f"Body rates above {_SHAKING_FROM_HZ:g} Hz: {np.degrees(rms.max()):.2f} deg/s rms on the worst axis."
        found.append(Finding(level, "vibration", text, (f"roll {roll:.2f}, pitch {pitch:.2f}, yaw {yaw:.2f} deg/s",)))
    return found


def _battery(flight: GatheredFlight) -> list[Finding]:
    """About each battery that told its charge, or about what the vehicle told of all of them."""
    for sources in (flight.batteries, (f"{flight.vehicle}/SYS_STATUS",)):
        told = {each: flight.lines[f"{each}:remaining"] for each in sources if f"{each}:remaining" in flight.lines}
        found = [_charge(source, *line.points()) for source, line in told.items() if len(line.points()[1])]
        if found:
            return found
    return []


def _charge(source: str, times: Floats, values: Floats) -> Finding:
    lowest, number = float(values.min()), source.partition(" ")[2]
    level = Level.WARNING if lowest < _LOW_BATTERY else Level.GOOD
    text = f"The {f'battery {number}'.strip()} went from {values[0]:.0f} % to {values[-1]:.0f} %."
    at = (float(times[values.argmin()]),)
    return Finding(level, "power", text, (f"lowest {lowest:.0f} %",), at, "Battery left")
