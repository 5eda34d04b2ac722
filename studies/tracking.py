"""Table 4: trajectories tracked under c = 1, 2.5, 5, with more and less of the reference fed forward.

The paper's trajectory is in a figure that its text does not contain, so other trajectories are flown here.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from companion.mission.plan import Mission, Phase, Waypoint
from companion.runtime.files import load_mission
from companion.state import Output
from companion.supervision.states import State
from protocol.arrays import Array
from studies import style
from studies.joined import Joined
from studies.paper_settings import paper_settings
from studies.report import Cell, Report
from vehicle_sim.timing import TICK_S

NAME = "tracking"
TITLE = "Table 4: trajectory tracking"

CONSTANTS = (1.0, 2.5, 5.0)
AXES = ("x", "y", "z")
FED_FORWARD = ("none", "velocity", "acceleration")
PRINTED = {"x": (0.4416, 0.2546, 0.1429), "y": (0.006, 0.0029, 0.0015), "z": (0.231, 0.1639, 0.1267)}
"""Table 4: MAE (m) for c = 1, 2.5, 5."""

RADIUS, PACE = 2.0, 1.0
"""m and rad/s of the circle."""
SHAPES: Mapping[str, tuple[str, ...]] = {
    "circle": (f"trajectory.radius={RADIUS}", f"trajectory.speed={RADIUS * PACE}", "trajectory.laps=4"),
    "helix": ("trajectory.speed=2.0", "trajectory.heading=fixed"),
    "lemniscate": ("trajectory.speed=2.0",),
    "square": (),
}
"""Missions, and what is changed in them."""
ROUTE = Mission(
    "courier_route",
    [Waypoint(20.0, 0.0, 3.0, 1.0), Waypoint(20.0, 15.0, 5.0, 1.0), Waypoint(40.0, 15.0, 3.0, 1.0)],
)
"""A courier's: straight legs at 4 m/s with a stop at each end, and back."""
TRAJECTORIES = (*SHAPES, "courier_route")
MATTERS = 0.02
"""m of MAE at c = 1 below which an axis is not judged: the trajectory does not move along it."""


@dataclass(frozen=True)
class Tracked:
    """A flight along a trajectory."""

    errors: Array
    """(n, 3) m, reference less position, NED, one each 4 ms."""
    reference_ned: Array
    """(n, 3)"""
    path_ned: Array
    """(n, 3)"""

    @property
    def mae(self) -> Array:
        """(3,) m"""
        mean: Array = np.abs(self.errors).mean(axis=0)
        return mean


Flown = Mapping[tuple[str, str, float], Tracked]
"""By trajectory, what is fed forward, and c."""


def mission_of(name: str) -> Mission:
    """One of SHAPES, or the route."""
    return load_mission(name, SHAPES[name])[0] if name in SHAPES else ROUTE


def fly(name: str, c: float, fed_forward: str) -> Tracked:
    """Fly a trajectory under the paper's laws, body rates commanded. Raises RuntimeError if the flight fails."""
    overrides = (*paper_settings(c), f'control.position.feedforward="{fed_forward}"')
    joined = Joined(mission_of(name), Output.RATES, overrides).fly()
    if joined.autopilot.supervisor.fault is not None:
        raise RuntimeError(f"{name}, c = {c:g}, {fed_forward}: {joined.autopilot.supervisor.fault}")
    trace = joined.trace()
    phases = [phase.value for phase in (Phase.TRACK, Phase.ROUTE, Phase.RETURN)]
    wanted = phases[:1] if name in SHAPES else phases[1:]
    trace = trace[(trace["state"] == State.FLY.value) & np.isin(trace["phase"], wanted)]
    path, reference = trace["position_ned"].copy(), trace["reference_position_ned"].copy()
    return Tracked(reference - path, reference, path)


def circle_mae(c: float, fed_forward: str) -> float:
    """MAE (m) of each axis on the circle for an ideal double integrator under the paper's law, c2 = 1.

    It is the transfer function from reference to error at s = i PACE: the derivatives that are not fed forward over
    s^2 + (1 + c) s + (1 + c).
    """
    s = 1j * PACE
    missing = {"none": s * s + (1.0 + c) * s, "velocity": s * s, "acceleration": 0.0}[fed_forward]
    return 2.0 / math.pi * RADIUS * abs(missing / (s * s + (1.0 + c) * s + (1.0 + c)))


def law_of_c(values: Sequence[float]) -> tuple[float, float, float]:
    """a, b of a + b / (1 + c) (m) that fit the three values best, and the largest residual (m)."""
    design = np.array([[1.0, 1.0 / (1.0 + c)] for c in CONSTANTS])
    (a, b), *_ = np.linalg.lstsq(design, np.asarray(values), rcond=None)
    return float(a), float(b), float(np.abs(design @ (a, b) - values).max())


def run(report: Report) -> None:
    """Fly all trajectories and compare them with the paper's column."""
    report.text(
        """
The trajectory of Table 4 is in a figure that the text does not carry, so its numbers can't be met one by one. Flown
here: a circle of 2 m at 1 rad/s, a helix, a lemniscate and a square with corners (`missions/`), and a courier's route
with stops; c = 1, 2.5, 5 with c2 = 1, and of the reference's derivatives none, the velocity, or velocity and
acceleration fed forward. In flight with motor lag, body rates commanded; x is north, y east, z down. The mean absolute
error is that of the whole trajectory, getting under way and stopping included.
"""
    )
    cases = list(product(TRAJECTORIES, FED_FORWARD, CONSTANTS))
    flown = {case: fly(case[0], case[2], case[1]) for case in report.progress(cases, "flights")}
    report.table(
        ("trajectory", "axis", *(f"c = {c:g}" for c in CONSTANTS), "a", "b", "largest residual"),
        [*_paper_rows(), *_law_rows(flown)],
        "MAE (m) with the velocity fed forward, and the law a + b/(1 + c) fitted to the three.",
    )
    report.text(
        """
**What the law means.** With c2 = 1 and the reference's velocity fed forward, but not its acceleration, the error is
that of `e'' + (1 + c) e' + (1 + c) e = x_d''`. Where the reference is slow compared with the loop, it is
`e = x_d''/(1 + c)`: the b of the law is the mean acceleration of the reference, and a is the part that no c removes.
The paper's z follows it to the last digit and its x within 3 % with a = 0, although its (23)-(25) contain the
acceleration. If the velocity were missing too, the error would hardly depend on c, unlike the paper's column. With the
acceleration fed forward, the attitude's lag is left. Its error shrinks with c in the same manner from a tenth of the
size: the column's shape alone does not distinguish the two, but its size does for any trajectory with accelerations of
about 1 m/s2.
"""
    )
    report.table(
        ("trajectory", "fed forward", *(f"c = {c:g}" for c in CONSTANTS)),
        [
            (name, fed, *(" / ".join(f"{value:.4f}" for value in flown[name, fed, c].mae) for c in CONSTANTS))
            for name, fed in product(TRAJECTORIES, ("none", "acceleration"))
        ],
        "MAE (m) of x / y / z with nothing and with all of it fed forward.",
    )
    report.figure(_from_above(flown), "tracking", "The trajectories, velocity fed forward")
    report.figure(_over_c(flown), "tracking-law", "MAE over 1/(1 + c): a straight line is the law")
    _check(report, flown)


def _paper_rows() -> list[Sequence[Cell]]:
    return [("the paper's", axis, *values, *_fit(values)) for axis, values in PRINTED.items()]


def _law_rows(flown: Flown) -> list[Sequence[Cell]]:
    rows: list[Sequence[Cell]] = []
    for name in TRAJECTORIES:
        for index, axis in enumerate(AXES):
            values = [float(flown[name, "velocity", c].mae[index]) for c in CONSTANTS]
            fit: Sequence[Cell] = _fit(values) if values[0] >= MATTERS else ("-", "-", "-")
            rows.append((name, axis, *(round(value, 4) for value in values), *fit))
    return rows


def _fit(values: Sequence[float]) -> tuple[Cell, Cell, Cell]:
    a, b, residual = law_of_c(values)
    return round(a, 4), round(b, 4), round(residual, 5)


def at_pace(tracked: Tracked, speed: float) -> Array:
    """(n, 3) errors while the reference has kept `speed` (m/s) for 3 s and keeps it."""
    speeds = np.hypot(*np.diff(tracked.reference_ned[:, :2], axis=0).T) / TICK_S
    fast = np.flatnonzero(np.abs(speeds - speed) < 1e-3 * speed)
    return tracked.errors[fast[0] + round(3.0 / TICK_S) : fast[-1]]


def _check(report: Report, flown: Flown) -> None:
    residual = law_of_c(PRINTED["z"])[2]
    report.check("the paper's z follows a + b/(1 + c)", "within 0.0001 m", f"{residual:.2g} m", residual <= 1e-4)
    shares = []
    for fed, c in product(("none", "velocity"), CONSTANTS):
        measured = np.abs(at_pace(flown["circle", fed, c], RADIUS * PACE)[:, :2]).mean(axis=0)
        shares.append(float(np.abs(measured / circle_mae(c, fed) - 1.0).max()))
    report.check(
        "MAE on the circle at constant pace, x and y, beside the ideal double integrator's",
        "within 10 %", f"within {100.0 * max(shares):.1f} %", max(shares) <= 0.1,
    )  # fmt: skip
    worst = 0.0
    for name in TRAJECTORIES:
        for index in range(3):
            values = [float(flown[name, "velocity", c].mae[index]) for c in CONSTANTS]
            if values[0] >= MATTERS:
                worst = max(worst, law_of_c(values)[2] / values[0])
    report.check(
        "velocity fed forward, every trajectory and axis: residual of a + b/(1 + c)",
        "5 % of the MAE at c = 1", f"{100.0 * worst:.1f} %", worst <= 0.05,
    )  # fmt: skip
    curves = product(("circle", "helix", "lemniscate", "courier_route"), CONSTANTS)
    gains = [
        float(np.sum(flown[name, "velocity", c].mae) / np.sum(flown[name, "acceleration", c].mae)) for name, c in curves
    ]
    report.check(
        "acceleration fed forward too, trajectories without corners: MAE smaller by a factor of",
        "5 at least", f"{min(gains):.1f} to {max(gains):.1f}", min(gains) >= 5.0,
    )  # fmt: skip


def _from_above(flown: Flown) -> Any:
    names = TRAJECTORIES
    figure, axes = style.sheet(2, 3, height=4.6)
    for panel, name in zip(axes.flat, names, strict=False):
        for c in CONSTANTS:
            path = flown[name, "velocity", c].path_ned
            panel.plot(path[:, 1], path[:, 0], lw=0.9, label=f"c = {c:g}")
        reference = flown[name, "velocity", 1.0].reference_ned
        panel.plot(reference[:, 1], reference[:, 0], color=style.INK, lw=0.8, ls="--", label="reference")
        panel.set(title=name.replace("_", " "), xlabel="east / m", ylabel="north / m")
        panel.set_aspect("equal", adjustable="datalim")
    last = axes.flat[-1]
    for c in CONSTANTS:
        tracked = flown["circle", "velocity", c]
        time = np.arange(len(tracked.errors)) * TICK_S
        last.plot(time, tracked.path_ned[:, 0], lw=0.9)
    last.plot(time, tracked.reference_ned[:, 0], color=style.INK, lw=0.8, ls="--")
    last.set(title="circle: x over time, as in Fig. 5", xlabel="time / s", ylabel="north / m", xlim=(0.0, 15.0))
    figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _over_c(flown: Flown) -> Any:
    figure, axes = style.sheet(1, 3, height=2.7)
    share = [1.0 / (1.0 + c) for c in CONSTANTS]
    for panel, fed in zip(axes, FED_FORWARD, strict=True):
        for name in TRAJECTORIES:
            maes = [float(flown[name, fed, c].mae[0]) for c in CONSTANTS]
            panel.plot(share, maes, marker="o", ms=3, label=name.replace("_", " "))
        for axis in ("x", "z"):
            panel.plot(share, PRINTED[axis], **style.PUBLISHED)
            panel.annotate(axis, (share[0], PRINTED[axis][0]), xytext=(4, 0), textcoords="offset points")
        panel.set(title=f"fed forward: {fed}", xlabel="1/(1 + c)", xlim=(0.0, 0.56))
        panel.set_ylim(bottom=0.0)
    axes[0].set_ylabel("MAE of x / m")
    axes[-1].plot([], [], **style.PUBLISHED, label="Table 4: x, z")
    figure.legend(*axes[-1].get_legend_handles_labels(), loc="outside upper center", ncols=6)
    return figure
