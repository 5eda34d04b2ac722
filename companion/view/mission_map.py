"""A mission's route from above: a sketch for a terminal, and a page with a map that loads nothing from elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from math import ceil, log10

import numpy as np

from companion.config import Settings
from companion.mission.plan import Mission, Step
from companion.trajectory import track_of
from companion.view.lines import Floats
from companion.view.report_page import AMBER, BLUE
from companion.view.scene import Prism, solids

_SAMPLES = 120
"""Points that a curve is drawn by."""
_SAME_PLACE_M = 0.5
_LEAST_M = 10.0
"""Height and width that are shown at least."""
_NARROWEST = 0.6
"""Shorter side of a page's map, in parts of the longer one."""
_BELOW_PX = 44.0
"""For the scale, below the map."""
_COLUMNS, _ROWS = 61, 21
_WIDTH_PX, _MOST_HEIGHT_PX = 1000.0, 700.0
_STYLE = """:root { color-scheme: light dark; --page: #f6f6f4; --ink: #24262b; --faint: #6d7078; --stone: #b9b2a6; }
@media (prefers-color-scheme: dark) { :root { --page: #17181b; --ink: #e6e6e3; --faint: #9a9da6; --stone: #6f6a61; } }
body { margin: 0 auto; max-width: 1050px; padding: 24px; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 26px; margin: 0; } p { color: var(--faint); margin: 2px 0 18px; }
svg { width: 100%; height: auto; max-height: 80vh; } text { fill: var(--ink); font-size: 15px; }
text { paint-order: stroke; stroke: var(--page); stroke-width: 4px; }
"""


@dataclass(frozen=True, slots=True)
class Mark:
    """A place of the route with the numbers of the steps that end there."""

    place_ned: Floats
    numbers: list[int]

    @property
    def label(self) -> str:
        return ",".join(map(str, self.numbers))


def way(plan: Sequence[Step]) -> Floats:
    """The places (n, 3) NED (m) that the steps lead through, in their order, curves with their bends."""
    defaults, places = Settings(), [np.zeros((1, 3))]
    for step in plan:
        if step.target_ned is None:
            continue
        places.append(step.target_ned[None])
        if step.curve is not None:
            track = track_of(step.curve, defaults.trajectory, defaults.limits.tilt)
            times = np.linspace(0.0, track.duration_s, _SAMPLES)
            places.append(step.target_ned + [track.at(time)[0] for time in times.tolist()])
    found: Floats = np.concatenate(places)
    return found


def marks(plan: Sequence[Step]) -> list[Mark]:
    """The places of the steps, those that are one from above as one."""
    found: list[Mark] = []
    for number, step in enumerate(plan, 1):
        if step.target_ned is None:
            continue
        flat = step.target_ned[:2]
        known = next((m for m in found if np.linalg.norm(m.place_ned[:2] - flat) < _SAME_PLACE_M), None)
        if known is None:
            found.append(Mark(step.target_ned, [number]))
        else:
            known.numbers.append(number)
    return found


def round_length(most: float) -> float:
    """The longest of 1, 2 and 5 times a power of ten that is no longer than that (m)."""
    power = 10.0 ** np.floor(log10(most))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= most * (1.0 + 1e-9)))


def sketch(plan: Sequence[Step]) -> str:
    """The route from above in characters, north up, a row twice as high as a column is wide."""
    places = way(plan)[:, :2]
    low, high = _corners(places)
    north, east = (high - low).tolist()
    metres = max(north / (2.0 * (_ROWS - 1)), east / (_COLUMNS - 1))
    rows, columns = ceil(north / metres / 2.0) + 1, ceil(east / metres) + 1
    cells = [[" "] * (columns + 12) for _ in range(rows)]

    def cell(place: Floats) -> tuple[int, int]:
        return round(float(high[0] - place[0]) / metres / 2.0), round(float(place[1] - low[1]) / metres)

    for start, end in pairwise(places):
        count = ceil(float(np.linalg.norm(end - start)) / metres) + 1
        for share in np.linspace(0.0, 1.0, count):
            row, column = cell(start + share * (end - start))
            cells[row][column] = "·"
    for mark in reversed(marks(plan)):
        row, column = cell(mark.place_ned)
        text = str(mark.numbers[0]) if len(mark.label) > 12 else mark.label
        cells[row][column : column + len(text)] = text
    length = round_length(metres * min(columns, 20))
    bar = "├" + "─" * max(round(length / metres) - 1, 0) + "┤"
    return "\n".join(["".join(row).rstrip() for row in cells] + ["", f"{bar} {length:g} m, north is up"])


def page(mission: Mission, plan: Sequence[Step], world: bytes, fence_radius: float | None) -> str:
    """The page, as HTML. `world`: the file of the mission's world; `fence_radius` (m) around the take-off."""
    places = way(plan)
    around = np.array([[-1.0, -1.0], [1.0, 1.0]]) * (0.0 if fence_radius is None else fence_radius)
    low, high = _corners(np.concatenate([places[:, :2], around]))
    largest = float(np.max(high - low))
    margin = 0.08 * largest + 2.0 + np.maximum(_NARROWEST * largest - (high - low), 0.0) / 2.0
    low, high = low - margin, high + margin
    north, east = (high - low).tolist()
    scale = min(_WIDTH_PX / east, _MOST_HEIGHT_PX / north)
    width, height = east * scale, north * scale

    def at(place: Sequence[float] | Floats) -> str:
        return f"{(float(place[1]) - low[1]) * scale:.1f},{(high[0] - float(place[0])) * scale:.1f}"

    def spot(place: Sequence[float] | Floats) -> str:
        return "translate(" + at(place) + ")"

    drawn = [_obstacle(prism, " ".join(map(at, prism.outline))) for prism in solids(world)]
    if fence_radius is not None:
        drawn.append(
            f'<circle class="fence" transform="{spot((0.0, 0.0))}" r="{fence_radius * scale:.1f}" fill="none" '
            f'stroke="{AMBER}" stroke-width="2" stroke-dasharray="8 6"><title>fence, {fence_radius:g} m</title>'
            "</circle>"
        )
    drawn.append(
        f'<polyline class="route" points="{" ".join(map(at, places))}" fill="none" stroke="{BLUE}" stroke-width="3" '
        'stroke-linejoin="round"/>'
    )
    for mark in marks(plan):
        words = f"{mark.label} · {-mark.place_ned[2]:g} m"
        drawn.append(
            f'<g class="place" transform="{spot(mark.place_ned)}"><circle r="6" fill="{BLUE}"/>'
            f'<text x="9" y="-9">{words}</text></g>'
        )
    length = round_length(0.25 * east)
    drawn.append(
        f'<g class="scale" transform="translate(16,{height + 34.0:.1f})"><path d="M0,-6V0H{length * scale:.1f}V-6" '
        f'fill="none" stroke="var(--ink)" stroke-width="2"/><text x="6" y="-8">{length:g} m</text></g>'
        f'<g class="north" transform="translate({width - 40.0:.1f},{height + 24.0:.1f})"><path '
        'd="M0,-12L8,12L0,6L-8,12Z" fill="var(--ink)"/><text x="14" y="6">N</text></g>'
    )
    name, said = escape(mission.name), escape(mission.description or f"In the world {mission.world}.")
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{name}</title>\n'
        f'<link rel="icon" href="data:,">\n<style>\n{_STYLE}</style>\n</head>\n<body>\n<h1>{name}</h1>\n<p>{said} '
        "The numbers are those of the steps, the heights are above the take-off.</p>\n"
        f'<svg viewBox="0 0 {width:.1f} {height + _BELOW_PX:.1f}" role="img" aria-label="The route from above">\n'
        + "\n".join(drawn)
        + "\n</svg>\n</body>\n</html>\n"
    )


def _obstacle(prism: Prism, points: str) -> str:
    return (
        f'<polygon class="obstacle" points="{points}" fill="var(--stone)"><title>{escape(prism.name)}, '
        f"{prism.bottom:g} to {prism.top:g} m</title></polygon>"
    )


def _corners(places: Floats) -> tuple[Floats, Floats]:
    """The south-west and north-east corners (2,) of what is shown, at least of _LEAST_M."""
    low, high = places.min(axis=0), places.max(axis=0)
    wider = np.maximum(_LEAST_M - (high - low), 0.0) / 2.0
    return low - wider, high + wider
