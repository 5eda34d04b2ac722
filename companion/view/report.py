"""`companion report`: one HTML file that holds a flight, to be opened, kept or sent as it is."""

import base64
import html
import importlib.util
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from companion.config import Settings
from companion.logs.recordings import as_date, started_unix_s
from companion.logs.target import output
from companion.renamed_settings import RENAMED_SETTINGS
from companion.view.findings import Event, Finding, events, findings, phase_name
from companion.view.gather import CLEARANCE_BIN_M, Gathered
from companion.view.lines import Floats, Line
from companion.view.scene import mesh, solids
from protocol.flightlog import FILE_NAME as LOG_NAME
from protocol.flightlog import FlightLogError
from protocol.toml_files import with_new_names

FILE_NAME = "report.html"
PAGE = Path(__file__).with_name("report_page.html")
BLUE, RED, GREEN, AMBER, VIOLET, TEAL, GREY = (
    "#3b7ddd",
    "#d64560",
    "#4c9f50",
    "#d08a1d",
    "#8a5cc9",
    "#1f9e9e",
    "#8b8b93",
)
AXES = (BLUE, GREEN, VIOLET)
_NED = ("north", "east", "down")
_EULER = ("roll", "pitch", "yaw")
_BAND_COLORS = (BLUE, AMBER, GREEN, VIOLET, TEAL)
_MOST_BANDS = 60
_RESPONSE_S = 0.6
_AROUND_M = 25.0


class Curve(msgspec.Struct, frozen=True):
    """One line: x and y (m,) as base64 of little-endian float32."""

    name: str
    color: str
    x: str
    y: str
    dash: str = "solid"


class Chart(msgspec.Struct, frozen=True):
    """One picture of the page. `kind`: "time" (x is s), "xy", "log" (both axes), "bars", "bars-log", "ring"."""

    section: str
    title: str
    unit: str
    curves: tuple[Curve, ...]
    kind: str = "time"
    x_unit: str = "s"
    values: str = ""
    """For a ring: the ranges, a row a bearing."""
    note: str = ""


class Solid(msgspec.Struct, frozen=True):
    """An obstacle: outline from above, and corners and triangles (flat) for the view in space. East, north, up."""

    name: str
    east: tuple[float, ...]
    north: tuple[float, ...]
    corners: tuple[float, ...]
    faces: tuple[int, ...]
    height: float


class Way(msgspec.Struct, frozen=True):
    """A path in space: east, north, up (m,) and what belongs to each point."""

    name: str
    color: str
    east: str
    north: str
    up: str
    time: str
    dash: str = "solid"


class Band(msgspec.Struct, frozen=True):
    """A time that is shaded in the charts."""

    start: float
    stop: float
    name: str
    color: str


class Row(msgspec.Struct, frozen=True):
    """One topic of the log."""

    topic: str
    count: int
    rate: float
    usual_ms: float
    longest_ms: float


class Page(msgspec.Struct, frozen=True):
    """All that the page's script draws."""

    title: str
    subtitle: str
    tiles: tuple[tuple[str, str], ...]
    findings: tuple[Finding, ...]
    events: tuple[Event, ...]
    begin: float
    end: float
    bands: tuple[Band, ...]
    charts: tuple[Chart, ...]
    solids: tuple[Solid, ...]
    ways: tuple[Way, ...]
    topics: tuple[Row, ...]
    changed: tuple[tuple[str, str, str], ...]
    """Settings: key, as flown, default."""
    parameters: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]


def write(log: Path, target: Path | None = None) -> Path:
    """Write the report of a log, by default beside it (`beside`), and return where.

    An older report makes room. Raises FlightLogError if the log can't be read or it can't be written or is a log.
    """
    flight = Gathered(log)
    target = beside(log) if target is None else target
    page = compose(flight)
    # Nothing in the text may end the script that it stands in.
    data = msgspec.json.encode(page).decode().replace("</", "<\\/").replace("<!--", "<\\!--")
    parts = PAGE.read_text(encoding="utf-8").split("@@")
    values = {"title": html.escape(page.title), "plotly": _plotly(), "data": data}
    with output(target, source=log, replaces=True) as draft, draft.open("w", encoding="utf-8") as file:
        for index, part in enumerate(parts):
            file.write(values[part] if index % 2 else part)
    return target


def beside(log: Path) -> Path:
    """Where a log's report goes: FILE_NAME for a flight in its own folder, under the log's name for any other."""
    return log.with_name(FILE_NAME if log.name == LOG_NAME else f"{log.stem}_{FILE_NAME}")


def _plotly() -> str:
    """The library's script alone: its Python side takes a second to import and is not needed."""
    found = importlib.util.find_spec("plotly")
    if found is None or found.origin is None:
        raise FlightLogError("the report needs plotly, which is not installed")
    return (Path(found.origin).parent / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def compose(flight: Gathered) -> Page:
    """The page of a gathered flight."""
    flown = flight.log.metadata.get("flight", {})
    when = started_unix_s(flight.log.metadata) or as_date(flight.start_ns * 1e-9) or 0.0
    return Page(
        title=flown.get("mission", "") or flight.log.path.stem,
        subtitle=" · ".join(filter(None, (_date(when), *_how(flown), flown.get("source") or str(flight.log.path)))),
        tiles=_tiles(flight),
        findings=tuple(findings(flight)),
        events=tuple(events(flight)),
        begin=flight.begin or 0.0,
        end=flight.end,
        bands=_bands(flight),
        charts=tuple(chart for chart in _charts(flight) if chart.curves or chart.values),
        solids=_solids(flight),
        ways=_ways(flight),
        topics=_topics(flight),
        changed=_changed(flight),
        parameters=tuple((name, f"{value:.7g}") for name, value in sorted(flight.parameters.items())),
        versions=tuple((name, value) for name, value in flown.items() if value),
    )


def _date(unix_s: float) -> str:
    return time_text(unix_s) if unix_s > 86_400.0 else ""


def time_text(unix_s: float) -> str:
    """UTC, to the minute."""
    return np.datetime_as_string(np.datetime64(int(unix_s), "s"), unit="m").replace("T", " ") + " UTC"


def _how(flown: dict[str, str]) -> list[str]:
    words = [f"output {flown['output']}"] if "output" in flown else []
    if "pace" in flown:
        words.append("real time" if flown["pace"] == "1.0" else flown["pace"])
    return [*words, f"seed {flown['seed']}"] if flown.get("seed") else words


def _tiles(flight: Gathered) -> tuple[tuple[str, str], ...]:
    tiles = [("duration", _duration(flight.end - (flight.begin or 0.0)))]
    if flight.distance_m:
        tiles.append(("distance", f"{flight.distance_m:.0f} m"))
    for label, quantity, form in (
        ("greatest height", "height", "{:.1f} m"),
        ("top speed", "speed", "{:.1f} m/s"),
        ("greatest tilt", "tilt_deg", "{:.0f}°"),
    ):
        best = _first(flight, quantity)
        if best is not None:
            tiles.append((label, form.format(best.points()[1].max())))
    for message in ("BATTERY_STATUS", "SYS_STATUS"):
        energy = flight.energy_wh.get(f"{flight.vehicle}/{message}")
        if energy is not None:
            tiles.append(("energy", f"{energy:.2f} Wh"))
            break
    if flight.tracking:
        largest = max(errors.largest for errors in flight.tracking.values())
        tiles.append(("largest error", f"{100.0 * largest:.1f} cm"))
    if flight.least_clearance is not None:
        tiles.append(("nearest thing seen", f"{flight.least_clearance[0]:.2f} m"))
    latency = flight.latency_quantile(0.5)
    if latency is not None:
        tiles.append(("median latency", f"{latency:.0f} µs"))
    return tuple(tiles)


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    hours, rest = divmod(round(seconds), 3600)
    return f"{hours} h {rest // 60:02d} min" if hours else f"{rest // 60} min {rest % 60:02d} s"


# ------------------------------------------------------------------------------------------------------------- charts


def _packed(values: Floats) -> str:
    return base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()


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
"""Where a quantity is found in the vehicle's own messages, the best first."""
_MEASURED = frozenset({"height", "speed", "position_ned", "velocity_ned", "euler_deg", "tilt_deg", "rates_deg"})
"""What the vehicle tells for longer than the companion's trace lasts, so it goes first; of all else the trace does."""


def _first(flight: Gathered, quantity: str) -> Line | None:
    """The line of a quantity from its best source that has any points."""
    name, _, column = quantity.partition(".")
    suffix = f".{column}" if column else ""
    told = [f"{flight.vehicle}/{source}{suffix}" for source in _SOURCES.get(name, ())]
    traced = [f"trace:{quantity}"]
    for key in told + traced if name in _MEASURED else traced + told:
        line = flight.lines.get(key)
        if line is not None and len(line.points()[0]):
            return line
    return None


def _curve(line: Line | None, name: str, color: str, dash: str = "solid", *, wraps: bool = False) -> tuple[Curve, ...]:
    """None or one; a silence becomes a gap in the line, and where it `wraps`, so does an angle's step round."""
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
    return (Curve(name, color, _packed(times), _packed(values), dash),)


def _pair(flight: Gathered, quantity: str, wanted: str, color: str) -> tuple[Curve, ...]:
    wraps = quantity == "euler_deg.2"
    before = _curve(_first(flight, wanted), "wanted", RED, "dot", wraps=wraps)
    return (*before, *_curve(_first(flight, quantity), "is", color, wraps=wraps))


def _three(flight: Gathered, section: str, title: str, unit: str, key: str, names: tuple[str, ...]) -> Chart:
    curves = [
        curve
        for axis, (name, color) in enumerate(zip(names, AXES, strict=True))
        for curve in _curve(_first(flight, f"{key}.{axis}"), name, color)
    ]
    return Chart(section, title, unit, tuple(curves))


def _own(flight: Gathered, *parts: tuple[str, str, str]) -> tuple[Curve, ...]:
    """Curves of the vehicle's messages: (key without the sender, name, color)."""
    return tuple(
        curve
        for key, name, color in parts
        for curve in _curve(flight.lines.get(f"{flight.vehicle}/{key}"), name, color)
    )


def _charts(flight: Gathered) -> list[Chart]:
    return [
        *_motion(flight),
        *_attitude(flight),
        *_commands(flight),
        *_surroundings(flight),
        *_timing(flight),
        *_spectra(flight),
        *_health(flight),
    ]


def _motion(flight: Gathered) -> list[Chart]:
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
        Chart(section, "Distance from the reference", "cm", _curve(_first(flight, "error_cm"), "tracking error", RED))
    )
    return charts


def _attitude(flight: Gathered) -> list[Chart]:
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


def _commands(flight: Gathered) -> list[Chart]:
    section = "Commands"
    colors = (BLUE, RED, GREEN, AMBER, VIOLET, TEAL, GREY, "#5b6b2a")
    outputs = [(f"SERVO_OUTPUT_RAW:outputs.{index}", f"output {index + 1}", colors[index]) for index in range(8)]
    return [
        Chart(section, "Thrust", "of the whole", _curve(_first(flight, "thrust_command"), "thrust", BLUE)),
        _three(flight, section, "Torque", "of the whole", "torque_command", _EULER),
        Chart(section, "Outputs of the vehicle", "µs", _own(flight, *outputs)),
        _three(flight, section, "Lyapunov functions of the position loop", "", "lyapunov", _NED),
    ]


def _surroundings(flight: Gathered) -> list[Chart]:
    section = "Surroundings"
    charts = [
        Chart(section, "Clearance", "m", _curve(_first(flight, "clearance"), "nearest thing seen", GREEN)),
        Chart(
            section, "Speed limit from what is seen", "m/s", _curve(flight.lines.get("trace:speed_limit"), "", AMBER)
        ),
    ]
    ring = flight.rings.get(flight.vehicle)
    rows = list(ring.rings.rows()) if ring is not None else []
    if ring is not None and len(rows) > 1:
        ranges = np.array([row for _, row in rows])
        bearings = ring.offset_deg + ring.increment_deg * np.arange(ranges.shape[1])
        bearings = (bearings + 180.0) % 360.0 - 180.0
        order = np.argsort(bearings)
        axes = Curve("", GREEN, _packed(np.array([at for at, _ in rows])), _packed(bearings[order]))
        charts.append(
            Chart(
                section,
                "The ring: nearest return by bearing",
                "bearing, deg",
                (axes,),
                "ring",
                values=_packed(ranges.T[order]),
            )
        )
    counts = flight.clearance_counts
    if counts.any():
        last = int(np.flatnonzero(counts)[-1]) + 1
        middles = (np.arange(last) + 0.5) * CLEARANCE_BIN_M
        share = 100.0 * counts[:last] / counts.sum()
        curve = Curve("share of the flight", GREEN, _packed(middles), _packed(share))
        charts.append(Chart(section, "Clearance, how often", "%", (curve,), "bars", "m"))
    return [*charts, *_guard(flight)]


def _guard(flight: Gathered) -> list[Chart]:
    """What a guard or an observer adds to the trace, by its own name."""
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
    """Of a line with a number behind its key."""
    name, _, column = key.partition(".")
    return _NED[int(column)] if name.endswith("_ned") and column else column


def _timing(flight: Gathered) -> list[Chart]:
    section = "Timing"
    charts = [
        Chart(section, "From attitude to command", "µs", _curve(flight.latency_us, "latency", BLUE)),
        Chart(section, "Lateness of the loop's ticks", "ms", _curve(flight.lines.get("ticks:late_ms"), "late", RED)),
        Chart(section, "Age of the position", "ms", _curve(flight.lines.get("trace:age_ms"), "age", AMBER)),
    ]
    counts = flight.latency_counts
    if counts.any():
        span = np.flatnonzero(counts)
        bins = np.arange(span[0], span[-1] + 1)
        curve = Curve("", BLUE, _packed(10 ** ((bins + 0.5) / 20.0)), _packed(100.0 * counts[bins] / counts.sum()))
        charts.append(Chart(section, "Latency, how often", "%", (curve,), "bars-log", "µs"))
    return charts


def _spectra(flight: Gathered) -> list[Chart]:
    section = "Spectra and step response"
    charts = []
    for title, unit, spectrum in (
        ("Body rates", "(rad/s)²/Hz", flight.rates),
        ("Torque commands", "1/Hz", flight.torques),
    ):
        if spectrum is None:
            continue
        frequencies, density = spectrum.density()
        curves = tuple(
            Curve(_EULER[axis], AXES[axis], _packed(frequencies[1:]), _packed(density[1:, axis])) for axis in range(3)
        )
        charts.append(Chart(section, title, unit, curves, "log", "Hz"))
    answer = flight.response
    times, response = answer.step_response(_RESPONSE_S) if answer is not None else (np.empty(0), np.empty((0, 3)))
    curves = tuple(Curve(_EULER[axis], AXES[axis], _packed(times), _packed(response[:, axis])) for axis in range(3))
    if len(times):
        charts.append(Chart(section, "Answer of the body rates to a step of the rate command", "1", curves, "xy"))
    return charts


def _health(flight: Gathered) -> list[Chart]:
    section = "Vehicle"
    message = "BATTERY_STATUS" if f"{flight.vehicle}/BATTERY_STATUS:volts" in flight.lines else "SYS_STATUS"
    vibration = [(f"VIBRATION:vibration.{axis}", name, AXES[axis]) for axis, name in enumerate("xyz")]
    ratios = [
        (f"{name}:{field}", label, color)
        for name, fields in (
            ("ESTIMATOR_STATUS", ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio")),
            (
                "EKF_STATUS_REPORT",
                ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance"),
            ),
        )
        for field, label, color in zip(
            fields, ("velocity", "horizontal", "vertical", "compass"), _BAND_COLORS[:4], strict=True
        )
    ]
    return [
        Chart(section, "Battery voltage", "V", _own(flight, (f"{message}:volts", "voltage", BLUE))),
        Chart(section, "Battery current", "A", _own(flight, (f"{message}:amperes", "current", RED))),
        Chart(section, "Battery left", "%", _own(flight, (f"{message}:remaining", "left", GREEN))),
        Chart(section, "Load of the autopilot", "%", _own(flight, ("SYS_STATUS:load", "load", VIOLET))),
        Chart(section, "Vibration", "m/s²", _own(flight, *vibration)),
        Chart(section, "Estimator: innovations against their bounds", "1 is the bound", _own(flight, *ratios)),
        Chart(
            section,
            "Satellites",
            "",
            _own(flight, ("GPS_RAW_INT:satellites", "used", BLUE), ("GPS_RAW_INT:fix", "fix type", AMBER)),
        ),
        Chart(
            section,
            "Radio",
            "",
            _own(
                flight,
                ("RADIO_STATUS:rssi", "strength", BLUE),
                ("RADIO_STATUS:remrssi", "remote strength", GREEN),
                ("RADIO_STATUS:noise", "noise", RED),
            ),
        ),
    ]


# -------------------------------------------------------------------------------------------------- space and the rest


def _solids(flight: Gathered) -> tuple[Solid, ...]:
    """What stands within _AROUND_M of the box around the path: the rest of a world would make the flight small."""
    flown = _flown(flight)[:, 1:3]
    low, high = (flown.min(axis=0), flown.max(axis=0)) if len(flown) else (np.zeros(2), np.zeros(2))
    found = []
    for prism in solids(flight.log.attachments.get("world.toml", b"")):
        outside = (np.max(prism.outline, axis=0) < low - _AROUND_M) | (np.min(prism.outline, axis=0) > high + _AROUND_M)
        if outside.any():
            continue
        corners, faces = mesh(prism)
        outline = (*prism.outline, prism.outline[0])
        found.append(
            Solid(
                prism.name,
                tuple(round(east, 3) for _, east in outline),
                tuple(round(north, 3) for north, _ in outline),
                tuple(round(value, 3) for corner in corners for value in corner),
                tuple(index for face in faces for index in face),
                prism.top,
            )
        )
    return tuple(found)


def _ways(flight: Gathered) -> tuple[Way, ...]:
    wanted = flight.path.rows()
    ways = [_way("reference", RED, wanted[:, 0], wanted[:, 4:7], "dot")] if len(wanted) else []
    flown = _flown(flight)
    return (*ways, _way("flown", BLUE, flown[:, 0], flown[:, 1:4])) if len(flown) else tuple(ways)


def _flown(flight: Gathered) -> Floats:
    """(n, 4) times and positions NED, from what tells them for longest."""
    for sender in (flight.vehicle, f"{flight.vehicle} global"):
        if sender in flight.paths:
            return flight.paths[sender].rows()
    return flight.path.rows()[:, :4]


def _way(name: str, color: str, times: Floats, places_ned: Floats, dash: str = "solid") -> Way:
    north, east, down = places_ned.T
    return Way(name, color, _packed(east), _packed(north), _packed(-down), _packed(times), dash)


def _bands(flight: Gathered) -> tuple[Band, ...]:
    """The companion's phases, and the vehicle's modes from where these end."""
    phases = flight.phases.finish()
    until = phases[-1].stop if phases else -math.inf
    modes = flight.modes.get(flight.vehicle)
    named = [(stretch.start, stretch.stop, phase_name(stretch.value)) for stretch in phases]
    named += [
        (max(stretch.start, until), stretch.stop, flight.mode_names[stretch.value])
        for stretch in (modes.finish() if modes is not None else ())
        if stretch.stop > until
    ]
    names = sorted({name for _, _, name in named})
    longest = sorted(named, key=lambda band: band[0] - band[1])[:_MOST_BANDS]
    return tuple(
        Band(start, stop, name, _BAND_COLORS[names.index(name) % len(_BAND_COLORS)])
        for start, stop, name in sorted(longest)
    )


def _topics(flight: Gathered) -> tuple[Row, ...]:
    return tuple(
        Row(topic, clock.count, clock.rate, 1e3 * clock.usual, 1e3 * clock.gaps[0][0] if clock.gaps else 0.0)
        for topic, clock in sorted(flight.clocks.items())
    )


def _changed(flight: Gathered) -> tuple[tuple[str, str, str], ...]:
    """Settings that were not this version's defaults."""
    flown = flight.log.attachments.get("settings.json")
    if flown is None:
        return ()
    try:
        tables = msgspec.json.decode(flown, type=dict[str, Any])
    except msgspec.DecodeError:
        return ()
    recorded = _flat(with_new_names(tables, RENAMED_SETTINGS))
    defaults = _flat(msgspec.to_builtins(Settings()))
    return tuple(
        (key, str(value), str(defaults.get(key, "not known")))
        for key, value in recorded.items()
        if msgspec.json.encode(value) != msgspec.json.encode(defaults.get(key))
    )


def _flat(table: Any, prefix: str = "") -> dict[str, Any]:
    if not isinstance(table, dict):
        return {prefix: table}
    return {
        key: value
        for name, inner in table.items()
        for key, value in _flat(inner, f"{prefix}.{name}" if prefix else str(name)).items()
    }
