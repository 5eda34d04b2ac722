"""The picture of where a flight of a campaign ended."""

import math
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Circle

from companion.perception.map_view import FREE, OCCUPIED
from protocol.arrays import Array
from protocol.frames import rotate
from studies import style
from studies.campaign import Job
from studies.joined import Joined
from studies.route import draw_world
from studies.worlds import HULL, Site
from vehicle_sim.sensors.lidar import beam_azimuths, sector_ranges


def of_the_end(job: Job, site: Site, joined: Joined) -> Any:
    """A matplotlib figure: the whole way, and what is near."""
    path = np.array([*joined.truths, joined.vehicle.state])[:, :3]
    figure, (whole, near) = style.sheet(1, 2, height=4.6, width=8.4)
    for axes in (whole, near):
        draw_world(axes, joined.vehicle.world, site.height)
        axes.plot(path[:, 1], path[:, 0], color=style.PALETTE[0], label="flown")
        axes.plot([0.0, *(e for _, e in site.waypoints)], [0.0, *(n for n, _ in site.waypoints)],
                  color=style.GREY, ls=":", lw=0.8)  # fmt: skip
        axes.set(xlabel="east / m", ylabel="north / m", aspect="equal")
    north, east = path[-1, :2]
    near.add_patch(Circle((east, north), HULL, facecolor="none", ec=style.PALETTE[1], lw=1.4))
    seen = _seen(joined)
    near.plot(seen[:, 1], seen[:, 0], ".", color=style.PALETTE[1], ms=3, label="last scan")
    draw_map(near, joined)
    near.set(xlim=(east - 4.0, east + 4.0), ylim=(north - 4.0, north + 4.0))
    near.legend(loc="lower right")
    whole.set_aspect("equal", adjustable="datalim")  # a way straight on has no width of its own
    whole.plot(site.goal[1], site.goal[0], "*", color=style.PALETTE[1], ms=9)
    whole.set_title(f"{site.name}, {job.method}, {job.speed:.3g} m/s, seed {job.seed}")
    near.set_title(f"after {joined.vehicle.time_ns * 1e-9:.2f} s")
    return figure


def draw_map(axes: Any, joined: Joined) -> None:
    """Draw the companion's map at the end; grey is free."""
    view = joined.planner.pipeline.local_map.view
    if view is None:
        return
    shades = np.where(view.states == OCCUPIED, 2, np.where(view.states == FREE, 1, 0))
    (south, west), size = view.cell * np.array(view.corner), view.cell * np.array(view.states.shape)
    axes.imshow(shades, cmap=ListedColormap(["#ffffff", "#e4e9ef", style.PALETTE[3]]), vmin=0, vmax=2, origin="lower",
                extent=(west, west + size[1], south, south + size[0]), interpolation="none", zorder=0.5)  # fmt: skip


def _seen(joined: Joined) -> Array:
    """(n, 2) north, east (m) of a scan's returns at the end, without noise."""
    vehicle, azimuths = joined.vehicle, beam_azimuths(1)
    cos, sin = np.cos(azimuths), np.sin(azimuths)
    ranges = sector_ranges(
        vehicle.world.boxes, vehicle.world.cylinders, vehicle.state[:3], vehicle.state[6:10], cos, sin,
        vehicle.airframe.lidar.max_range_m,
    )  # fmt: skip
    beams = [
        distance * rotate(vehicle.state[6:10], np.array([c, s, 0.0]))[:2]
        for distance, c, s in zip(ranges, cos, sin, strict=True)
        if math.isfinite(distance)
    ]
    points: Array = vehicle.state[:2] + np.array(beams).reshape(-1, 2)
    return points
