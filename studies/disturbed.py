"""Hover in gusts, and the parcel's release."""

import numpy as np

from companion.mission.plan import Delivery, Mission, Phase, Waypoint
from companion.supervision.states import State
from protocol.arrays import Array
from studies import style
from studies.joined import Joined
from studies.paper_settings import NOTHING_ADDED
from studies.report import Report

NAME = "disturbed"
TITLE = "Gusts and the parcel"

_ALONE = 'avoidance.method="none"'
_ANYWHERE = ("trajectory.settled_distance=3.0", "trajectory.settled_speed=3.0")
"""The bare laws have a steady error in wind, and would never count as arrived at the waypoint."""
_SETTLING = 1250
"""Control steps, 5 s."""


def hover(seed: int, overrides: tuple[str, ...] = ()) -> Array:
    """(n, 3) error (m, NED) during a minute of hover at 10 m, in a wind of 6 m/s with Dryden turbulence of W20 = 6
    m/s."""
    mission = Mission("gusts", waypoints=[Waypoint(0.0, 0.0, 10.0, 65.0)], takeoff_height=10.0)
    wind = ("wind.mean_ned=[6.0, 0.0, 0.0]", "wind.turbulence_m_s=6.0")
    joined = Joined(mission, overrides=(_ALONE, *_ANYWHERE, *overrides), seed=seed, world_overrides=wind)
    joined.fly(until=lambda each: each.autopilot.navigator.phase is Phase.RETURN, limit_s=120.0)
    trace = joined.trace()[:-1]
    chosen = (trace["phase"] == Phase.ROUTE.value) & (trace["state"] == State.FLY.value)
    error: Array = joined.tracking_error()[chosen][_SETTLING:]
    return error


def release(overrides: tuple[str, ...] = ()) -> tuple[Array, Array]:
    """Time (n,) in s from the parcel's release on, and vertical error (n,) in m, positive downwards."""
    mission = Mission("parcel", waypoints=[Waypoint(4.0, 0.0, 3.0)], delivery=Delivery())
    joined = Joined(mission, overrides=(_ALONE, *overrides))
    joined.fly(until=lambda each: each.autopilot.navigator.phase is Phase.LAND, limit_s=120.0)
    trace = joined.trace()[:-1]
    climbing = np.flatnonzero(trace["phase"] == Phase.CLIMB.value)[0]
    window = slice(climbing - 50, climbing + 500)
    time: Array = 0.004 * (np.arange(550, dtype=np.float64) - 50.0)
    return time, joined.tracking_error()[window, 2]


def run(report: Report) -> None:
    report.text(
        "Hover 10 m up in a mean wind of 6 m/s from the south with Gaussian Dryden turbulence (MIL-F-8785C at low "
        "altitude, W20 = 6 m/s); one minute after 5 s, three seeds. Then the release of the parcel, 0.25 of 1.55 kg."
    )
    rows = []
    for name, overrides in (("default", ()), ("the paper's laws, drag made up for", NOTHING_ADDED)):
        for seed in report.progress((1, 2, 3), f"gusts, {name}"):
            size = np.linalg.norm(hover(seed, overrides), axis=1)
            rows.append((name, seed, 1e3 * float(np.sqrt((size**2).mean())), 1e3 * float(size.max())))
    report.table(("controller", "seed", "RMSE / mm", "peak / mm"), rows, "Hover in gusts")
    worst = max(row[2] for row in rows if row[0] == "default") * 1e-3
    report.check("gust: Dryden, 6 m/s mean, hover", "<= 0.10 m RMSE", f"{worst:.4f} m", worst <= 0.10)
    figure, axes = style.sheet(1, 1, height=2.6)
    bumps = {}
    for name, overrides in (("default", ()), ("the paper's laws", NOTHING_ADDED)):
        time, error = release(overrides)
        bumps[name] = float(np.abs(error).max())
        axes.plot(time, -1e3 * error, label=name)
    axes.set(xlabel="time since the release was confirmed / s", ylabel="height above the reference / mm")
    axes.legend()
    report.figure(figure, "release", "The parcel leaves.")
    report.check("the parcel's release is no bump", "<= 0.05 m", f"{bumps['default']:.4f} m", bumps["default"] <= 0.05)
