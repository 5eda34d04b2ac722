"""The charts of the report: which quantities of a gathered flight each of them shows."""

import math

import msgspec
import numpy as np

from companion.link.wire_ranges import beams_of_turn
from companion.view.accumulators.clearance import BIN_M
from companion.view.accumulators.timing import latency_of_bin
from companion.view.gather import GatheredFlight
from companion.view.lines import Line
from companion.view.report_page import AMBER, BLUE, GREEN, GREY, RED, TEAL, VIOLET, Chart, Curve, packed, unpacked

AXES = (BLUE, GREEN, VIOLET)
_NED = ("north", "east", "down")
_EULER = ("roll", "pitch", "yaw")
_OUTPUTS = (BLUE, RED, GREEN, AMBER, VIOLET, TEAL, GREY, "#5b6b2a")
_RESPONSE_S = 0.6
"""Length of the step response (s)."""
_ESTIMATOR_FIELDS = (
    ("ESTIMATOR_STATUS", ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio")),
    ("EKF_STATUS_REPORT", ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance")),
)
_ESTIMATOR_NAMES = (("velocity", BLUE), ("horizontal", AMBER), ("vertical", GREEN), ("compass", VIOLET))

_SOURCES = {
    "height": ("LOCAL_POSITION_NED:height", "GLOBAL_POSITION_INT:height"),
    "speed": ("LOCAL_POSITION_NED:speed", "GLOBAL_POSITION_INT:speed", "VFR_HUD:groundspeed"),
    "position_ned": ("LOCAL_POSITION_NED:position_ned",),
    "velocity_ned": ("LOCAL_POSITION_NED:velocity_ned", "GLOBAL_POSITION_INT:velocity_ned"),
    "euler_deg": ("ATTITUDE_QUATERNION:euler_deg", "ATTITUDE:euler_deg"),
    "tilt_deg": ("ATTITUDE_QUATERNION:tilt_deg", "ATTITUDE:tilt_deg"),
    "rates_deg": ("ATTITUDE_QUATERNION:rates_deg", "ATTITUDE:rates_deg"),
    "reference_position_ned": ("POSITION_TARGET_LOCAL_NED:position_ned",),
    "reference_velocity_ned": ("POSITION_TARGET_LOCAL_NED:velocity_ned",),
    "reference_height": ("POSITION_TARGET_LOCAL_NED:height",),
    "euler_command_deg": ("ATTITUDE_TARGET:euler_deg",),
    "rates_command_deg": ("ATTITUDE_TARGET:rates_deg",),
    "thrust_command": ("ATTITUDE_TARGET:thrust",),
    "clearance": ("OBSTACLE_DISTANCE:nearest",),
}
"""The vehicle's messages that tell a quantity, the best first."""
_MEASURED = frozenset({"height", "speed", "position_ned", "velocity_ned", "euler_deg", "tilt_deg", "rates_deg"})
"""Quantities for which the vehicle's messages come before the companion's trace, because they last longer."""


def best_line(flight: GatheredFlight, quantity: str) -> Line | None:
    """The line of a quantity from the best source that has any points; None if there is none."""
    name, _, column = quantity.partition(".")
    suffix = f".{column}" if column else ""
    sender = flight.scanner if name == "clearance" else flight.vehicle
    told = [f"{sender}/{source}{suffix}" for source in _SOURCES.get(name, ())]
    traced = [f"trace:{quantity}"]
    for key in told + traced if name in _MEASURED else traced + told:
        line = flight.lines.get(key)
        if line is not None and len(line.points()[0]):
            return line
    return None


def _curve(line: Line | None, name: str, color: str, dash: str = "solid", *, wraps: bool = False) -> tuple[Curve, ...]:
    """The line as a curve; none for an empty one.

    A silence becomes a gap in the curve, and so does a step of an angle that `wraps` at 180 degrees.
    """
    if line is None:
        return ()
    times, values = line.points()
    if not len(times):
        return ()
    steps = np.diff(times)
    if len(steps):
        silent = steps > max(0.5, 20.0 * float(np.median(steps)))
        gaps = np.flatnonzero(silent | (np.abs(np.diff(values)) > 180.0) if wraps else silent) + 1
        times, values = np.insert(times, gaps, times[gaps]), np.insert(values, gaps, math.nan)
    return (Curve(name, color, packed(times), packed(values), dash),)


def _pair(flight: GatheredFlight, quantity: str, wanted: str, color: str) -> tuple[Curve, ...]:
    """A quantity and its reference or command."""
    wraps = quantity == "euler_deg.2"
    before = _curve(best_line(flight, wanted), "wanted", RED, "dot", wraps=wraps)
    return (*before, *_curve(best_line(flight, quantity), "is", color, wraps=wraps))


def _axes(flight: GatheredFlight, quantity: str, names: tuple[str, ...]) -> tuple[Curve, ...]:
    """The three axes of a vector."""
    return tuple(
        curve
        for axis, (name, color) in enumerate(zip(names, AXES, strict=True))
        for curve in _curve(best_line(flight, f"{quantity}.{axis}"), name, color)
    )


def _told(flight: GatheredFlight, *parts: tuple[str, str, str]) -> tuple[Curve, ...]:
    """Curves of the vehicle's messages; each part is the line's key without the sender, a name and a color."""
    return tuple(
        curve
        for key, name, color in parts
        for curve in _curve(flight.lines.get(f"{flight.vehicle}/{key}"), name, color)
    )


def charts(flight: GatheredFlight) -> tuple[Chart, ...]:
    """All charts that have anything to show."""
    found = [
        *_motion(flight),
        *_attitude(flight),
        *_commands(flight),
        *_surroundings(flight),
        *_timing(flight),
        *_spectra(flight),
        *_health(flight),
    ]
    return tuple(msgspec.structs.replace(chart, flat=_flat(chart)) for chart in found if chart.curves or chart.values)


def _flat(chart: Chart) -> str:
    """What the curves of a chart over time stay at, if none of them ever moves; else empty."""
    if chart.kind != "time":
        return ""
    levels = []
    for curve in chart.curves:
        values = unpacked(curve.y)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if high - low > 1e-4 * max(abs(low), abs(high)):
            return ""
        levels.append(f"{curve.name} {high:.4g}".strip())
    return f"always {', '.join(levels)}"


def _motion(flight: GatheredFlight) -> list[Chart]:
    section = "Position and velocity"
    charts = [
        Chart(section, "Height", "m", _pair(flight, "height", "reference_height", BLUE)),
        Chart(section, "Speed", "m/s", _pair(flight, "speed", "reference_speed", BLUE)),
    ]
    for axis in range(2):
        curves = _pair(flight, f"position_ned.{axis}", f"reference_position_ned.{axis}", AXES[axis])
        charts.append(Chart(section, f"Position {_NED[axis]}", "m", curves))
    for axis in range(3):
        curves = _pair(flight, f"velocity_ned.{axis}", f"reference_velocity_ned.{axis}", AXES[axis])
        charts.append(Chart(section, f"Velocity {_NED[axis]}", "m/s", curves))
    charts.append(
        Chart(
            section, "Distance from the reference", "cm", _curve(best_line(flight, "error_cm"), "tracking error", RED)
        )
    )
    return charts


def _attitude(flight: GatheredFlight) -> list[Chart]:
    section = "Attitude and rates"
    charts = []
    for what, unit, key, wanted in (
        ("", "deg", "euler_deg", "euler_command_deg"),
        (" rate", "deg/s", "rates_deg", "rates_command_deg"),
    ):
        for axis in range(3):
            curves = _pair(flight, f"{key}.{axis}", f"{wanted}.{axis}", AXES[axis])
            charts.append(Chart(section, f"{_EULER[axis].capitalize()}{what}", unit, curves))
    return charts


def _commands(flight: GatheredFlight) -> list[Chart]:
    section = "Commands"
    outputs = [(f"SERVO_OUTPUT_RAW:outputs.{index}", f"output {index + 1}", _OUTPUTS[index]) for index in range(8)]
    return [
        Chart(section, "Thrust", "of the whole", _curve(best_line(flight, "thrust_command"), "thrust", BLUE)),
        Chart(section, "Torque", "of the whole", _axes(flight, "torque_command", _EULER)),
        Chart(section, "Outputs of the vehicle", "µs", _told(flight, *outputs)),
        Chart(section, "Lyapunov functions of the position loop", "", _axes(flight, "lyapunov", _NED)),
    ]


def _surroundings(flight: GatheredFlight) -> list[Chart]:
    section = "Surroundings"
    charts = [
        Chart(section, "Clearance", "m", _curve(best_line(flight, "clearance"), "nearest thing seen", GREEN)),
        Chart(
            section, "Speed limit from what is seen", "m/s", _curve(flight.lines.get("trace:speed_limit"), "", AMBER)
        ),
    ]
    return [*charts, *_scans(flight), *_clearances(flight), *_guard(flight)]


def _scans(flight: GatheredFlight) -> list[Chart]:
    scans = flight.scans.of.get(flight.scanner)
    rows = list(scans.rows.rows()) if scans is not None else []
    if scans is None or len(rows) < 2:
        return []
    ranges = np.array([row for _, row in rows])
    ranges = ranges[:, : beams_of_turn(scans.increment_deg, ranges.shape[1])]
    bearings = scans.offset_deg + scans.increment_deg * np.arange(ranges.shape[1])
    bearings = (bearings + 180.0) % 360.0 - 180.0
    order = np.argsort(bearings)
    axes = Curve("", GREEN, packed(np.array([at for at, _ in rows])), packed(bearings[order]))
    title, values = "The ring: nearest return by bearing", packed(ranges.T[order])
    return [Chart("Surroundings", title, "bearing, deg", (axes,), "ring", values=values)]


def _clearances(flight: GatheredFlight) -> list[Chart]:
    counts = flight.clearance.counts
    if not counts.any():
        return []
    last = int(np.flatnonzero(counts)[-1]) + 1
    middles = (np.arange(last) + 0.5) * BIN_M
    share = 100.0 * counts[:last] / counts.sum()
    curve = Curve("share of the flight", GREEN, packed(middles), packed(share))
    return [Chart("Surroundings", "Clearance, how often", "%", (curve,), "bars", "m")]


def _guard(flight: GatheredFlight) -> list[Chart]:
    """Charts of what the guard and the disturbance observer write into the trace, by the names of its fields."""
    groups: dict[str, list[str]] = {}
    for key in flight.lines:
        if key.startswith(("trace:guard_", "trace:disturbance", "trace:wind")):
            groups.setdefault(key.partition(".")[0], []).append(key)
    charts = []
    for group, keys in groups.items():
        curves = [
            curve
            for index, key in enumerate(keys)
            for curve in _curve(flight.lines[key], _axis_name(key), AXES[index % 3])
        ]
        title = group.removeprefix("trace:").removesuffix("_ned").replace("_", " ").capitalize()
        unit = "m/s²" if group in ("trace:guard_change", "trace:disturbance_ned") else ""
        charts.append(Chart("Surroundings", title, unit, tuple(curves)))
    return charts


def _axis_name(key: str) -> str:
    """The name of the axis of a line with a number behind its key."""
    name, _, column = key.partition(".")
    return _NED[int(column)] if name.endswith("_ned") and column else column


def _timing(flight: GatheredFlight) -> list[Chart]:
    section = "Timing"
    charts = [
        Chart(section, "From attitude to command", "µs", _curve(flight.timing.latency_us, "latency", BLUE)),
        Chart(section, "Lateness of the loop's ticks", "ms", _curve(flight.timing.late_ms, "late", RED)),
        Chart(section, "Age of the position", "ms", _curve(flight.lines.get("trace:age_ms"), "age", AMBER)),
    ]
    counts = flight.timing.latency_counts
    if counts.any():
        span = np.flatnonzero(counts)
        bins = np.arange(span[0], span[-1] + 1)
        curve = Curve("", BLUE, packed(latency_of_bin(bins)), packed(100.0 * counts[bins] / counts.sum()))
        charts.append(Chart(section, "Latency, how often", "%", (curve,), "bars-log", "µs"))
    return charts


def _spectra(flight: GatheredFlight) -> list[Chart]:
    section = "Spectra and step response"
    charts = []
    for title, unit, spectrum in (
        ("Body rates", "(rad/s)²/Hz", flight.body_rates.spectrum(flight.vehicle)),
        ("Torque commands", "1/Hz", flight.body_rates.torques),
    ):
        if spectrum is None:
            continue
        frequencies, density = spectrum.density()
        curves = tuple(
            Curve(_EULER[axis], AXES[axis], packed(frequencies[1:]), packed(density[1:, axis])) for axis in range(3)
        )
        charts.append(Chart(section, title, unit, curves, "log", "Hz"))
    response = flight.body_rates.response
    times, answer = response.step_response(_RESPONSE_S) if response is not None else (np.empty(0), np.empty((0, 3)))
    curves = tuple(Curve(_EULER[axis], AXES[axis], packed(times), packed(answer[:, axis])) for axis in range(3))
    if len(times):
        charts.append(Chart(section, "Answer of the body rates to a step of the rate command", "1", curves, "xy"))
    return charts


def _health(flight: GatheredFlight) -> list[Chart]:
    section = "Vehicle"
    vibration = [(f"VIBRATION:vibration.{axis}", name, AXES[axis]) for axis, name in enumerate("xyz")]
    innovations = [
        (f"{message}:{field}", name, color)
        for message, fields in _ESTIMATOR_FIELDS
        for field, (name, color) in zip(fields, _ESTIMATOR_NAMES, strict=True)
    ]
    satellites = ("GPS_RAW_INT:satellites", "used", BLUE), ("GPS_RAW_INT:fix", "fix type", AMBER)
    dilution = ("GPS_RAW_INT:hdop", "horizontal", BLUE), ("GPS_RAW_INT:vdop", "vertical", GREEN)
    sticks = [(f"RC_CHANNELS:pulses.{index}", f"channel {index + 1}", _OUTPUTS[index]) for index in range(8)]
    temperatures = (
        ("HIGHRES_IMU:temperature", "inertial sensors", BLUE),
        ("RAW_IMU:temperature", "inertial sensors", BLUE),
        ("SCALED_PRESSURE:temperature", "barometer", GREEN),
        ("BATTERY_STATUS:temperature", "battery", RED),
    )
    radio = (
        ("RADIO_STATUS:rssi", "strength", BLUE),
        ("RADIO_STATUS:remrssi", "remote strength", GREEN),
        ("RADIO_STATUS:noise", "noise", RED),
    )
    return [
        Chart(section, title, unit, _told(flight, *parts))
        for title, unit, parts in (
            ("Battery voltage", "V", _batteries(flight, "volts", "voltage")),
            ("Battery current", "A", _batteries(flight, "amperes", "current")),
            ("Battery left", "%", _batteries(flight, "remaining", "left")),
            ("Load of the autopilot", "%", [("SYS_STATUS:load", "load", VIOLET)]),
            ("Temperature", "°C", temperatures),
            ("Vibration", "m/s²", vibration),
            ("Acceleration, raw", "m/s²", _inertial(flight, "acceleration")),
            ("Gyroscope, raw", "deg/s", _inertial(flight, "gyro_deg")),
            ("Estimator: innovations against their bounds", "1 is the bound", innovations),
            ("Satellites", "", satellites),
            ("Dilution of the satellites' precision", "", dilution),
            ("Sticks and switches (RC)", "µs", sticks),
            ("Strength of RC", "%", [("RC_CHANNELS:strength", "strength", BLUE)]),
            ("Radio", "", radio),
        )
    ]


def _batteries(flight: GatheredFlight, quantity: str, name: str) -> list[tuple[str, str, str]]:
    """The parts of a chart of a quantity of the batteries, with their numbers behind the name where there are more."""
    sources = [source.removeprefix(f"{flight.vehicle}/") for source in flight.batteries]
    named = zip(sources, _OUTPUTS, strict=False)
    return [(f"{source}:{quantity}", f"{name} {source.partition(' ')[2]}".strip(), color) for source, color in named]


def _inertial(flight: GatheredFlight, quantity: str) -> list[tuple[str, str, str]]:
    """The parts of the best message that has a quantity of the inertial sensors."""
    names = ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU")
    best = next((name for name in names if f"{flight.vehicle}/{name}:{quantity}.0" in flight.lines), "")
    return [(f"{best}:{quantity}.{axis}", name, AXES[axis]) for axis, name in enumerate("xyz")]
