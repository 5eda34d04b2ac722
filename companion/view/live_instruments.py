"""The live page's instruments, drawn as SVG from one moment of the flight: horizon, tapes of speed, height and climb,
and compass.

Each is a function of values that are None where they are not known; what is not known is crossed out.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from companion.view.attitudes import euler_deg
from companion.view.history import Moment
from companion.view.lines import Floats

WIDTH, HEIGHT = 372, 236
"""Pixels of the instruments."""
_TAPE_WIDTH, _TAPE_HEIGHT = 60, 190
_HORIZON_LEFT, _HORIZON_WIDTH = 66, 190
_PITCH_PX = 3.2
"""Pixels of the horizon to a degree of pitch."""
_HEADING_PX = 2.2
"""Pixels of the compass to a degree."""
_CLIMB_PX = 22.0
"""Pixels to 1 m/s."""
_CLIMB_MOST = 4.0
_POINTS = {0: "N", 45: "NE", 90: "E", 135: "SE", 180: "S", 225: "SW", 270: "W", 315: "NW"}
_SKY, _EARTH, _TAPE, _INK, _PAPER = "#1f6fb8", "#7a5430", "#1b222c", "#ffffff", "#0d1117"
_OWN, _WANTED, _CROSS = "#ffd54a", "#ffb13d", "#ff6b6b"


@dataclass(frozen=True, slots=True)
class Flown:
    """What the instruments show; None where it is not known."""

    roll_deg: float | None = None
    pitch_deg: float | None = None
    heading_deg: float | None = None
    speed: float | None = None
    """Over the ground (m/s)."""
    height: float | None = None
    """m"""
    climb: float | None = None
    """m/s, upwards"""
    course_deg: float | None = None
    """Where the vehicle moves to, unless it stands still."""
    home_deg: float | None = None
    """Where the take-off point is, unless it is below."""
    wanted_height: float | None = None
    """m"""
    speed_limit: float | None = None
    """m/s"""


def flown(moment: Moment) -> Flown:
    """What the instruments show of a moment."""
    values: dict[str, float | None] = {}
    if moment.attitude_ned_frd is not None:
        roll, pitch, yaw = euler_deg(moment.attitude_ned_frd[None])[0].tolist()
        values |= {"roll_deg": roll, "pitch_deg": pitch, "heading_deg": yaw % 360.0}
    if moment.position_ned is not None and moment.velocity_ned is not None:
        over_ground = moment.velocity_ned[:2]
        values |= {"speed": float(np.linalg.norm(over_ground)), "climb": -float(moment.velocity_ned[2])}
        values |= {"height": -float(moment.position_ned[2])}
        values |= {"course_deg": _bearing(over_ground, 0.3), "home_deg": _bearing(-moment.position_ned[:2], 1.0)}
    if moment.plan is not None:
        values |= {"wanted_height": -float(moment.plan.reference_ned[2])}
        values |= {"speed_limit": moment.plan.speed_limit if 0.0 < moment.plan.speed_limit < math.inf else None}
    return Flown(**values)


def _bearing(north_east: Floats, least: float) -> float | None:
    """The bearing (deg) of a vector; None if it is shorter than `least`."""
    north, east = float(north_east[0]), float(north_east[1])
    return math.degrees(math.atan2(east, north)) % 360.0 if math.hypot(north, east) > least else None


def instruments(values: Flown) -> str:
    """All instruments as one SVG."""
    parts = (
        _tape("speed", "m/s", 0, values.speed, values.speed_limit),
        _horizon(values.roll_deg, values.pitch_deg),
        _tape("height", "m", _HORIZON_LEFT + _HORIZON_WIDTH + 6, values.height, values.wanted_height),
        _climb(_HORIZON_LEFT + _HORIZON_WIDTH + _TAPE_WIDTH + 12, values.climb),
        _compass(values.heading_deg, values.course_deg, values.home_deg),
    )
    return (
        f'<svg id="instruments" role="img" aria-label="flight instruments" width="{WIDTH}" height="{HEIGHT}" '
        f'viewBox="0 0 {WIDTH} {HEIGHT}" font-family="system-ui,sans-serif" font-size="11" fill="{_INK}">'
        f"{''.join(parts)}</svg>"
    )


def _horizon(roll_deg: float | None, pitch_deg: float | None) -> str:
    """The horizon behind the vehicle's sign, with a scale of bank above."""
    half, middle = _HORIZON_WIDTH / 2, _TAPE_HEIGHT / 2
    if roll_deg is None or pitch_deg is None:
        return _frame("horizon", _HORIZON_LEFT, 0, _HORIZON_WIDTH, _TAPE_HEIGHT, _crossed(_HORIZON_WIDTH, _TAPE_HEIGHT))
    ladder = "".join(
        f'<path d="M{-width} {-_PITCH_PX * mark:.0f}H{width}" stroke="{_INK}"/>'
        + (f'<text x="{width + 4}" y="{4 - _PITCH_PX * mark:.0f}">{abs(mark)}</text>' if width == 30 else "")
        for mark in range(-60, 61, 5)
        if mark
        for width in (30 if mark % 10 == 0 else 14,)
    )
    world = (
        f'<g transform="rotate({-roll_deg:.1f}) translate(0 {_PITCH_PX * pitch_deg:.1f})">'
        f'<path d="M-300 -600H300V0H-300Z" fill="{_SKY}"/><path d="M-300 600H300V0H-300Z" fill="{_EARTH}"/>'
        f'<path d="M-300 0H300" stroke="{_INK}" stroke-width="2"/>{ladder}</g>'
    )
    bank = "".join(
        f'<path d="M0 -84V{-78 if mark % 30 else -74}" stroke="{_INK}" transform="rotate({mark})"/>'
        for mark in (-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60)
    )
    pointer = f'<path d="M0 -76l-6 10h12Z" fill="{_OWN}" transform="rotate({-roll_deg:.1f})"/>'
    own = (
        f'<path d="M-58 0H-24l8 9M58 0H24l-8 9" fill="none" stroke="{_PAPER}" stroke-width="6"/>'
        f'<path d="M-58 0H-24l8 9M58 0H24l-8 9" fill="none" stroke="{_OWN}" stroke-width="3"/>'
        f'<circle r="3" fill="{_OWN}"/>'
    )
    inside = f'<g transform="translate({half} {middle})">{world}{bank}{pointer}{own}</g>'
    return _frame("horizon", _HORIZON_LEFT, 0, _HORIZON_WIDTH, _TAPE_HEIGHT, inside)


def _tape(name: str, unit: str, left: int, value: float | None, wanted: float | None) -> str:
    """A scale that moves behind its pointer, with a mark at what is wanted."""
    if value is None:
        return _frame(name, left, 0, _TAPE_WIDTH, _TAPE_HEIGHT, _crossed(_TAPE_WIDTH, _TAPE_HEIGHT))
    shown, middle, pixels = value, _TAPE_HEIGHT / 2, 14.0

    def row(mark: int) -> str:
        y = middle - pixels * (mark - shown)
        long = mark % 2 == 0
        label = f'<text x="44" y="{y + 4:.1f}" text-anchor="end">{mark}</text>' if long else ""
        return f'<path d="M{_TAPE_WIDTH - (12 if long else 6)} {y:.1f}h12" stroke="{_INK}"/>{label}'

    marks = _marks(shown, middle / pixels + 1.0, 1, row)
    bug = ""
    if wanted is not None:
        y = min(max(middle - pixels * (wanted - shown), 3.0), _TAPE_HEIGHT - 3.0)
        bug = f'<path d="M{_TAPE_WIDTH - 9} {y:.1f}l9 -6v12Z" fill="{_WANTED}"/>'
    text = f"{round(value, 1) + 0.0:.1f}" if abs(value) < 99.95 else f"{value:.0f}"
    box = (
        f'<path d="M1 {middle - 12}H{_TAPE_WIDTH - 10}l8 12l-8 12H1Z" fill="{_PAPER}" stroke="{_OWN}"/>'
        f'<text id="{name}-value" x="{_TAPE_WIDTH - 14}" y="{middle + 5}" font-size="15" font-weight="600" '
        f'text-anchor="end">{text}</text>'
    )
    title = (
        f'<path d="M0 0H{_TAPE_WIDTH}V17H0Z" fill="{_PAPER}"/>'
        f'<text x="{_TAPE_WIDTH / 2}" y="12" text-anchor="middle">{name} {unit}</text>'
    )
    return _frame(name, left, 0, _TAPE_WIDTH, _TAPE_HEIGHT, marks + bug + box + title)


def _climb(left: int, value: float | None) -> str:
    """A bar up or down from the middle."""
    width, middle = WIDTH - left, _TAPE_HEIGHT / 2
    if value is None:
        return _frame("climb", left, 0, width, _TAPE_HEIGHT, _crossed(width, _TAPE_HEIGHT))
    end = middle - _CLIMB_PX * min(max(value, -_CLIMB_MOST), _CLIMB_MOST)
    ticks = "".join(
        f'<path d="M0 {middle - _CLIMB_PX * mark:.0f}h{8 if mark else 14}" stroke="{_INK}"/>' for mark in range(-3, 4)
    )
    bar = f'<path d="M4 {middle}V{end:.1f}" stroke="{_OWN}" stroke-width="6"/>'
    text = (
        f'<path d="M0 0H{width}V17H0Z" fill="{_PAPER}"/><text x="{width / 2}" y="12" text-anchor="middle">climb</text>'
        f'<text id="climb-value" x="{width - 3}" y="{middle + 5}" font-size="13" font-weight="600" text-anchor="end">'
        f"{round(value, 1) + 0.0:+.1f}</text>"
    )
    return _frame("climb", left, 0, width, _TAPE_HEIGHT, ticks + bar + text)


def _compass(heading_deg: float | None, course_deg: float | None, home_deg: float | None) -> str:
    """A scale of headings below, with marks at the course (a ring) and at home (H)."""
    top, height = _TAPE_HEIGHT + 6, HEIGHT - _TAPE_HEIGHT - 6
    if heading_deg is None:
        return _frame("compass", 0, top, WIDTH, height, _crossed(WIDTH, height))
    middle, shown = WIDTH / 2, heading_deg

    def at(bearing_deg: float) -> float:
        away = (bearing_deg - shown + 180.0) % 360.0 - 180.0
        return middle + _HEADING_PX * away

    def tick(mark: int) -> str:
        x, name = middle + _HEADING_PX * (mark - shown), _POINTS.get(mark % 360)
        label = name or (f"{mark % 360}" if mark % 30 == 0 else "")
        weight = ' font-weight="700" font-size="13"' if name else ""
        text = f'<text x="{x:.1f}" y="16" text-anchor="middle"{weight}>{label}</text>' if label else ""
        return f'<path d="M{x:.1f} {height}v-{9 if label else 5}" stroke="{_INK}"/>{text}'

    marks = _marks(shown, middle / _HEADING_PX, 15, tick)
    if course_deg is not None:
        marks += (
            f'<circle cx="{at(course_deg):.1f}" cy="{height - 7}" r="5" fill="none" stroke="{_OWN}" stroke-width="2"/>'
        )
    if home_deg is not None:
        x = min(max(at(home_deg), 8.0), WIDTH - 8.0)
        marks += (
            f'<path d="M{x - 7:.1f} {height - 14}h14v14h-14Z" fill="{_WANTED}"/><text x="{x:.1f}" y="{height - 3}" '
            f'fill="{_PAPER}" font-weight="700" text-anchor="middle">H</text>'
        )
    box = (
        f'<path d="M{middle - 22} 0h44v19h-18l-4 5l-4 -5h-18Z" fill="{_PAPER}" stroke="{_OWN}"/>'
        f'<text id="heading-value" x="{middle}" y="15" font-size="14" font-weight="600" text-anchor="middle">'
        f"{round(shown) % 360:03d}°</text>"
    )
    return _frame("compass", 0, top, WIDTH, height, marks + box)


def _marks(middle: float, reach: float, step: int, draw: Callable[[int], str]) -> str:
    """The marks at the multiples of `step` that are nearer to a value than `reach`."""
    first, last = math.ceil((middle - reach) / step), math.floor((middle + reach) / step)
    return "".join(draw(step * index) for index in range(first, last + 1))


def _crossed(width: float, height: float) -> str:
    return f'<path d="M0 0L{width} {height}M0 {height}L{width} 0" stroke="{_CROSS}" stroke-width="2"/>'


def _frame(name: str, left: float, top: float, width: float, height: float, inside: str) -> str:
    """A part of the picture, cut off at its edge."""
    return (
        f'<svg id="{name}" x="{left}" y="{top}" width="{width}" height="{height}">'
        f'<path d="M0 0H{width}V{height}H0Z" fill="{_TAPE}"/>{inside}</svg>'
    )


def battery_icon(percent: float, color: str) -> str:
    """A battery that is as full as that (%)."""
    filled = 0.17 * min(max(percent, 0.0), 100.0)
    return (
        '<svg aria-hidden="true" width="26" height="13" viewBox="0 0 26 13">'
        '<path d="M1 1H22V12H1Z" fill="none" stroke="#fff" stroke-width="1.5"/><path d="M23.5 4V9" stroke="#fff" '
        f'stroke-width="3"/><path d="M3 3h{filled:.1f}v7H3Z" fill="{color}"/></svg>'
    )


def link_icon(bars: int, color: str) -> str:
    """Four bars, of which so many are lit; crossed out if none is."""
    lit: Iterable[str] = (
        f'<path d="M{2 + 5 * bar} 13V{10 - 3 * bar}" stroke="{color if bar < bars else "#59636e"}" stroke-width="3.5"/>'
        for bar in range(4)
    )
    cross = "" if bars else f'<path d="M1 1L19 13M19 1L1 13" stroke="{color}" stroke-width="2"/>'
    return f'<svg aria-hidden="true" width="20" height="14" viewBox="0 0 20 14">{"".join(lit)}{cross}</svg>'
