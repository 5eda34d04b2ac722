"""Picture of a flown route: the world from above with the path, and height, speed and clearance over time.

python -m studies.route logs/<flight>/flight.mcap docs/route.png
"""

import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mission.plan import Phase
from companion.records import TRACE
from protocol.flightlog import FlightLogError, LogReader
from studies.style import GREEN, INK, PALETTE, STONE, blank, save
from vehicle_sim.world import World

PATH, SETPOINT = PALETTE[:2]
PAGE = (10.0, 6.2)
COMMAND = "make demo; python -m studies.route logs/<flight>/flight.mcap docs/route.png"


def draw_world(axes: Any, world: World, height_m: float) -> None:
    """Obstacles as outlines, faint where they are lower or higher than the flight."""
    from matplotlib.patches import Circle, Polygon

    for (north, east, along, across, cos, sin, top, bottom), name in zip(world.boxes, world.names, strict=False):
        corners = [(along, across), (along, -across), (-along, -across), (-along, across)]
        outline = [(east + sin * a + cos * b, north + cos * a - sin * b) for a, b in corners]
        inside = top <= -height_m <= bottom
        axes.add_patch(Polygon(outline, facecolor=STONE, edgecolor=INK, lw=0.4, alpha=0.9 if inside else 0.25))
        if name == "customer's house":
            axes.annotate(name, (east, north + 6.0), ha="center", fontsize=7)
    for north, east, radius, top, bottom, sphere in world.cylinders:
        if sphere > 0.0:
            _draw_hill(axes, (north, east), radius, -top)
            continue
        inside = top <= -height_m <= bottom
        axes.add_patch(Circle((east, north), radius, facecolor=GREEN, ec=INK, lw=0.4, alpha=0.9 if inside else 0.25))


def _draw_hill(axes: Any, centre: tuple[float, float], radius: float, height: float) -> None:
    """Its foot, and a contour line at each metre."""
    from matplotlib.patches import Circle

    sphere = 0.5 * (radius**2 + height**2) / height
    for level in np.arange(0.0, height, 1.0):
        contour = float(np.sqrt(sphere**2 - (sphere - height + level) ** 2))
        axes.add_patch(Circle(centre[::-1], contour, facecolor=STONE, ec=INK, lw=0.3, alpha=0.15))


def draw(log: LogReader, target: Path, command: str) -> None:
    """Write the picture as .png and .svg, with the command that made it in its corner."""
    trace = log.array(TRACE.topic)
    trace = trace[trace["phase"] > Phase.PREPARE.value]
    world = World.from_tables(tomllib.loads(log.attachments["world.toml"].decode()), "world.toml")
    position: NDArray[np.float64] = trace["position_ned"]
    time = (trace["time_ns"] - trace["time_ns"][0]) * 1e-9
    figure = blank(*PAGE)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.7))
    above = figure.add_subplot(grid[:, 0])
    draw_world(above, world, 3.0)
    above.plot(position[:, 1], position[:, 0], color=PATH, lw=1.3, label="flown")
    targets = trace[trace["blocked"]]["target_ned"]
    above.plot(targets[::4, 1], targets[::4, 0], ".", color=SETPOINT, ms=2.5, label="avoidance setpoints")
    above.plot(0.0, 0.0, "^", color=INK, ms=6, label="home")
    door = position[trace["phase"] == Phase.RELEASE.value]
    if len(door):
        above.plot(door[0, 1], door[0, 0], "*", color=SETPOINT, ms=11, label="door")
    above.set(xlabel="east / m", ylabel="north / m", xlim=(-26, 26), ylim=(-32, 140), aspect="equal")
    above.legend(fontsize=6.5, loc="lower right")
    speed = np.linalg.norm(trace["velocity_ned"], axis=1)
    clearance = np.where(np.isfinite(trace["clearance"]), trace["clearance"], np.nan)
    error = 100.0 * np.linalg.norm(position - trace["reference_position_ned"], axis=1)
    rows = (
        ("height, speed", ((-position[:, 2], "height / m", INK), (speed, "speed / (m/s)", PATH))),
        ("clearance seen / m", ((clearance, None, GREEN),)),
        ("tracking error / cm", ((error, None, SETPOINT),)),
    )
    for index, (title, lines) in enumerate(rows):
        axes = figure.add_subplot(grid[index, 1])
        for values, label, color in lines:
            axes.plot(time, values, color=color, lw=1.0, label=label)
        axes.set_ylabel(title)
        axes.set_xlim(0.0, float(time[-1]))
        axes.set_ylim(bottom=0.0)
        if len(lines) > 1:
            axes.legend(loc="lower right")
    axes.set_xlabel("time since arming / s")
    save(figure, target.with_suffix(""), command)


def main() -> None:
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    try:
        draw(LogReader(sys.argv[1]), Path(sys.argv[2]), COMMAND)
    except FlightLogError as error:
        raise SystemExit(f"studies.route: {error}") from None


if __name__ == "__main__":
    main()
