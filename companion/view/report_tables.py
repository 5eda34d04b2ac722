"""The report's views in space and its tables, from a gathered flight."""

import math
from typing import Any

import msgspec
import numpy as np

from companion.config import Settings
from companion.logs.message_names import with_name
from companion.renamed_settings import RENAMED_SETTINGS
from companion.view.events import phase_name
from companion.view.gather import GatheredFlight
from companion.view.lines import Floats
from companion.view.report_charts import best_line
from companion.view.report_page import AMBER, BLUE, GREEN, RED, TEAL, VIOLET, Band, Row, Solid, Way, packed
from companion.view.scene import mesh, solids
from protocol.toml_files import with_new_names

_AROUND_M = 25.0
"""Obstacles are drawn up to this distance (m) from the box around the path; a whole world would make it small."""
_BAND_COLORS = (BLUE, AMBER, GREEN, VIOLET, TEAL)
_MOST_BANDS = 60


def tiles(flight: GatheredFlight) -> tuple[tuple[str, str], ...]:
    """The few figures at the head of the page, with their names."""
    found = [] if flight.verdict is None else [("outcome", flight.verdict.outcome.value)]
    found.append(("duration", _duration(flight.end - (flight.begin or 0.0))))
    if flight.paths.distance_m:
        found.append(("distance", f"{flight.paths.distance_m:.0f} m"))
    for label, quantity, form in (
        ("greatest height", "height", "{:.1f} m"),
        ("top speed", "speed", "{:.1f} m/s"),
        ("greatest tilt", "tilt_deg", "{:.0f}°"),
    ):
        best = best_line(flight, quantity)
        if best is not None:
            found.append((label, form.format(best.points()[1].max())))
    for sources in (flight.batteries, (f"{flight.vehicle}/SYS_STATUS",)):
        energies = [flight.energy.watt_hours[each] for each in sources if each in flight.energy.watt_hours]
        if energies:
            found.append(("energy", f"{sum(energies):.2f} Wh"))
            break
    worst = flight.tracking.worst
    if worst is not None:
        found.append(("largest error", f"{100.0 * worst.largest:.1f} cm"))
    if flight.clearance.least is not None:
        found.append(("nearest thing seen", f"{flight.clearance.least[0]:.2f} m"))
    latency = flight.timing.latency_quantile(0.5)
    if latency is not None:
        found.append(("median latency", f"{latency:.0f} µs"))
    return tuple(found)


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    hours, rest = divmod(round(seconds), 3600)
    return f"{hours} h {rest // 60:02d} min" if hours else f"{rest // 60} min {rest % 60:02d} s"


def obstacles(flight: GatheredFlight) -> tuple[Solid, ...]:
    """The obstacles of the flight's world near its path."""
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


def ways(flight: GatheredFlight) -> tuple[Way, ...]:
    """The paths of the reference and of the vehicle."""
    wanted = flight.paths.traced.rows()
    found = [_way("reference", RED, wanted[:, 0], wanted[:, 4:7], "dot")] if len(wanted) else []
    flown = _flown(flight)
    return (*found, _way("flown", BLUE, flown[:, 0], flown[:, 1:4])) if len(flown) else tuple(found)


def _flown(flight: GatheredFlight) -> Floats:
    """(n, 4) times (s) and positions NED (m), from the source that lasts longest."""
    for sender in (flight.vehicle, f"{flight.vehicle} global"):
        if sender in flight.paths.told:
            return flight.paths.told[sender].rows()
    return flight.paths.traced.rows()[:, :4]


def _way(name: str, color: str, times: Floats, places_ned: Floats, dash: str = "solid") -> Way:
    north, east, down = places_ned.T
    return Way(name, color, packed(east), packed(north), packed(-down), packed(times), dash)


def bands(flight: GatheredFlight) -> tuple[Band, ...]:
    """The companion's phases, and the vehicle's modes after the last of them."""
    phases = flight.phases.finish()
    until = phases[-1].stop if phases else -math.inf
    modes = flight.senders.modes.get(flight.vehicle)
    named = [(stretch.start, stretch.stop, phase_name(stretch.value)) for stretch in phases]
    named += [
        (max(stretch.start, until), stretch.stop, flight.senders.mode(flight.vehicle, stretch.value))
        for stretch in (modes.finish() if modes is not None else ())
        if stretch.stop > until
    ]
    names = sorted({name for _, _, name in named})
    longest = sorted(named, key=lambda band: band[0] - band[1])[:_MOST_BANDS]
    return tuple(
        Band(start, stop, name, _BAND_COLORS[names.index(name) % len(_BAND_COLORS)])
        for start, stop, name in sorted(longest)
    )


def topics(flight: GatheredFlight) -> tuple[Row, ...]:
    """The table of the log's topics."""
    return tuple(
        Row(
            with_name(topic),
            clock.count,
            clock.rate,
            1e3 * clock.usual,
            1e3 * clock.gaps[0][0] if clock.gaps else 0.0,
            flight.last.text(topic),
        )
        for topic, clock in sorted(flight.clocks.items())
    )


def changed_settings(flight: GatheredFlight) -> tuple[tuple[str, str, str], ...]:
    """The settings that differ from this version's defaults: key, as flown, default."""
    flown = flight.log.attachments.get("settings.json")
    if flown is None:
        return ()
    try:
        tables = msgspec.json.decode(flown, type=dict[str, Any])
        recorded = _flat(with_new_names(tables, RENAMED_SETTINGS))
    except (msgspec.DecodeError, RecursionError):
        return ()
    defaults = _flat(msgspec.to_builtins(Settings()))
    return tuple(
        (key, str(value), str(defaults.get(key, "not known")))
        for key, value in recorded.items()
        if msgspec.json.encode(value) != msgspec.json.encode(defaults.get(key))
    )


def _flat(table: Any, prefix: str = "") -> dict[str, Any]:
    """The values of nested tables by their dotted keys."""
    if not isinstance(table, dict):
        return {prefix: table}
    return {
        key: value
        for name, inner in table.items()
        for key, value in _flat(inner, f"{prefix}.{name}" if prefix else str(name)).items()
    }
