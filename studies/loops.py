"""Vertical loops, inverted at the top."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from companion.curves import Shape
from companion.mission.plan import Mission, Phase
from companion.state import Output
from protocol.arrays import Array
from protocol.frames import rotate
from studies import style
from studies.engine import on_all_cores
from studies.joined import Joined
from studies.report import Cell, Report
from studies.tracks import AGILE, Flight, fly

NAME = "loops"
TITLE = "Loops"

LOOP = Shape("loop", 7.0, radius=2.0, laps=3.0, ramp_s=0.8)
VEHICLE = "sun_quad"
FREE = ("limits.tilt_deg=180.0",)
OUTPUTS = (Output.RATES, Output.ACTUATORS)
CASES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "the truth": ((), ()),
    "rtk": (('estimator.sensors="rtk"',), ()),
    "gnss": (('estimator.sensors="gnss"',), ()),
    "gusts of 5 m/s": ((), ("wind.mean_ned=[5.0, 3.0, 0.0]", "wind.turbulence_m_s=5.0")),
    "10 % more mass": (("body.mass_kg=0.827",), ()),
}
"""Overrides of the simulated vehicle and of its world."""
FLOOR_M = 0.05
_EVERY = 12
"""Control steps from one arrow of the picture to the next."""


def plan(output: Output, case: str) -> Flight:
    """Three loops."""
    vehicle, world = CASES[case]
    return Flight(LOOP, VEHICLE, output, FREE, vehicle, world, height=10.0)


def run(report: Report) -> None:
    peak = LOOP.speed**2 / LOOP.size
    report.text(
        f"Three loops of {2.0 * LOOP.size:g} m at {LOOP.speed:g} m/s ({peak:.1f} m/s2), sideways, by `{VEHICLE}` with "
        "no limit on its tilt. RMSE in mm from one second after the beginning on, of the true place (*true*) and of "
        "the one that the vehicle believes (*told*). To see them: `companion demo loop --output rates --set "
        "limits.tilt_deg=180 --set limits.roll_pitch_rate_deg=600`."
    )
    cases = list(product(OUTPUTS, CASES))
    flown = dict(report.progress(zip(cases, on_all_cores(fly, [plan(*case) for case in cases]), strict=True), "loops"))
    rows: list[Sequence[Cell]] = [
        (case, output.value, 1e3 * tracked.rmse_m, 1e3 * tracked.told_rmse_m)
        for (output, case), tracked in flown.items()
    ]
    report.table(("what is sensed, or wrong", "output", "true / mm", "told / mm"), rows, "RMSE of position")
    _picture(report)
    worst = max(float(np.nan_to_num(tracked.told_rmse_m, nan=np.inf)) for tracked in flown.values())
    report.check("loops, told", f"<= {FLOOR_M:g} m", f"{worst:.4f} m", worst <= FLOOR_M)


def watched(output: Output = Output.RATES) -> tuple[Array, Array]:
    """Places (n, 3) (m, NED) and the body's upward axes (n, 3) on the loops."""
    mission = Mission("loop", trajectory=LOOP, vehicle=VEHICLE, takeoff_height=10.0)
    joined = Joined(mission, output, (*AGILE, *FREE), remembers=False).fly()
    on_it = joined.trace()["phase"] == Phase.TRACK.value
    states = np.array(joined.truths)[np.array(joined.trace_ticks)[on_it]]
    return states[:, :3], np.array([rotate(q, np.array((0.0, 0.0, -1.0))) for q in states[:, 6:10]])


def _picture(report: Report) -> None:
    places, up = (each[::_EVERY] for each in watched())
    figure, axes = style.sheet(1, 1, height=3.4)
    axes.plot(places[:, 1], -places[:, 2], lw=0.8)
    axes.quiver(
        places[:, 1], -places[:, 2], up[:, 1], -up[:, 2], color=style.PALETTE[1], angles="xy", scale=14.0, width=0.003
    )
    axes.set(xlabel="east / m", ylabel="height / m", aspect="equal")
    report.figure(figure, "loops", "Three loops from the north. Arrows: where the vehicle's upper side points.")
