"""Moving picture of a flown route: the world from above, the path so far, and what the LiDAR sees.

python -m studies.film logs/<flight>/flight.mcap docs/flight.gif
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
from protocol.frames import yaw_of
from studies.route import PATH, SETPOINT, draw_world
from studies.style import INK, blank
from vehicle_sim.world import World

_INCHES = 6.4, 2.5
_FRAMES, _COLORS = 70, 32
_FRAME_MS, _LAST_MS = 90, 2000
_SCANS = "/mavlink/1/1/OBSTACLE_DISTANCE"


def returns(scan: np.void, place_ned: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """(m, 2) north and east (m) of what one OBSTACLE_DISTANCE shows."""
    ranges = scan["distances"] * 0.01
    bearings = yaw + np.radians(scan["angle_offset"] + scan["increment_f"] * np.arange(len(ranges)))
    seen = (scan["distances"] >= scan["min_distance"]) & (scan["distances"] < scan["max_distance"])
    around = place_ned[:2] + ranges[:, None] * np.column_stack((np.cos(bearings), np.sin(bearings)))
    return np.asarray(around[seen])


def draw(log: LogReader, target: Path) -> None:
    """Write the picture as .gif: north is to the right, so that a long street fits the page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.transforms import Affine2D
    from PIL import Image

    trace, scans = log.array(TRACE.topic), log.array(_SCANS)
    trace = trace[trace["phase"] > Phase.PREPARE.value]
    position: NDArray[np.float64] = trace["position_ned"]
    figure = blank(*_INCHES)
    figure.set_layout_engine("none")
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    draw_world(axes, World.from_tables(tomllib.loads(log.attachments["world.toml"].decode()), "world.toml"), 3.0)
    turned = Affine2D(np.array(((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))))
    for patch in axes.patches:
        patch.set_transform(turned + axes.transData)
    for text in list(axes.texts):
        text.remove()
    axes.set(xlim=(-14, 140), ylim=(-30, 30), aspect="equal")
    axes.axis("off")
    (path,) = axes.plot([], [], color=PATH, lw=1.6)
    (seen,) = axes.plot([], [], ".", color=SETPOINT, ms=3.5)
    (vehicle,) = axes.plot([], [], "o", color=INK, ms=7)
    words = axes.text(0.01, 0.03, "", transform=axes.transAxes, fontsize=9, family="monospace")
    canvas, frames = FigureCanvasAgg(figure), []
    for step in np.linspace(0, len(trace) - 1, _FRAMES).astype(int):
        row = trace[step]
        scan = scans[max(int(np.searchsorted(scans["time_ns"], row["time_ns"])) - 1, 0)]
        hits = returns(scan, row["position_ned"], yaw_of(row["attitude_ned_frd"]))
        path.set_data(position[: step + 1, 0], position[: step + 1, 1])
        seen.set_data(hits[:, 0], hits[:, 1])
        vehicle.set_data(position[step, :1], position[step, 1:2])
        seconds = (row["time_ns"] - trace["time_ns"][0]) * 1e-9
        speed = float(np.linalg.norm(row["velocity_ned"]))
        phase = Phase(int(row["phase"])).name.lower()
        words.set_text(f"{seconds:5.1f} s  {phase:8}  {speed:3.1f} m/s  {-row['position_ned'][2]:3.1f} m high")
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    palette = frames[len(frames) // 3].quantize(_COLORS)
    drawn = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    times = [_FRAME_MS] * (len(drawn) - 1) + [_LAST_MS]
    drawn[0].save(target, save_all=True, append_images=drawn[1:], duration=times, loop=0, optimize=True)


def main() -> None:
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    try:
        draw(LogReader(sys.argv[1]), Path(sys.argv[2]))
    except FlightLogError as error:
        raise SystemExit(f"studies.film: {error}") from None


if __name__ == "__main__":
    main()
