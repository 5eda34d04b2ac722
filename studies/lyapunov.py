"""The Lyapunov functions (13)-(22) along flights: where V falls, and why it rises in other places."""

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.mission.plan import Waypoint
from companion.supervision.states import State
from protocol.arrays import Array
from studies import style
from studies.joined import Joined, mission_of
from studies.paper_settings import paper_settings
from studies.report import Cell, Report

NAME = "lyapunov"
TITLE = "The Lyapunov functions in flight"

C = 2.5
PERIOD_S = 0.004
LEAST = 1e-5
"""m2; V below this counts as zero."""


@dataclass(frozen=True)
class Flight:
    """A step to the north."""

    metres: float = 1.0
    angle_weight: float = 400.0
    air: tuple[str, ...] = ()
    """Overrides of the world."""
    shown_s: float = 5.0


FLIGHTS = {
    "1 m": Flight(),
    "15 m": Flight(metres=15.0, shown_s=8.0),
    "1 m, Q = 10": Flight(angle_weight=10.0, shown_s=8.0),
    "1 m in wind": Flight(air=("wind.mean_ned=[-4.0, 3.0, 0.0]", "wind.turbulence_m_s=5.0"), shown_s=12.0),
}


@dataclass(frozen=True)
class Course:
    """V along a flight after its step, all axes together; (n,) each."""

    time: Array
    """s since the step."""
    v1: Array
    """(13), m2."""
    v: Array
    """(19), m2."""
    rate: Array
    """V' as it was, m2/s."""
    promised: Array
    """(22): V' if the acceleration is the commanded one, m2/s."""
    missed: Array
    """e2 (a - a_c): the part of V' from the acceleration's deviation from its command, m2/s."""
    limited: NDArray[np.bool_]
    """A limit on thrust or tilt was reached."""

    @property
    def must_fall(self) -> NDArray[np.bool_]:
        """The law promises a larger decrease than the acceleration's deviation takes away, and V is not zero."""
        return (self.promised + self.missed < 0.0) & (self.v > LEAST)

    @property
    def rises(self) -> NDArray[np.bool_]:
        return (self.rate > 0.0) & (self.v > LEAST)


def course(trace: NDArray[np.void]) -> Course:
    """The course of V over the records (n + 1,) of a trace that follow a step. Each value is the mean over 4 ms; V' and
    the acceleration are difference quotients."""

    def middle(values: Array) -> Array:
        return 0.5 * (values[1:] + values[:-1])

    e1, e2, v = trace["e1"], trace["e2"], trace["lyapunov"].sum(axis=1)
    acceleration = np.diff(trace["velocity_ned"], axis=0) / PERIOD_S
    missed = middle(e2) * (acceleration - middle(trace["acceleration_command_ned"]))
    return Course(
        time=np.linspace(0.5, len(v) - 1.5, len(v) - 1) * PERIOD_S,
        v1=middle(0.5 * (e1 * e1).sum(axis=1)),
        v=middle(v),
        rate=np.diff(v) / PERIOD_S,
        promised=middle(trace["lyapunov_rate"].sum(axis=1)),
        missed=missed.sum(axis=1),
        limited=trace["limited"][1:],
    )


def fly(flight: Flight) -> Course:
    """Fly the step under the paper's law, over the wire."""
    start = Waypoint(north=0.0, east=0.0, height=3.0, hold_s=4.0)
    end = msgspec.structs.replace(start, north=flight.metres, hold_s=12.0)
    mission = msgspec.structs.replace(mission_of("step"), waypoints=[start, end], return_home=False)
    joined = Joined(mission, overrides=paper_settings(C, flight.angle_weight), world_overrides=flight.air)
    joined.fly(until=lambda under_way: under_way.autopilot.navigator.step_index > 2)
    trace = joined.trace()
    return course(trace[(trace["step"] == 2) & (trace["state"] == State.FLY.value)][1:])


def run(report: Report) -> None:
    """Section 2.2 of the paper."""
    names = report.progress(FLIGHTS, "steps, calm and in wind")
    courses = {name: fly(FLIGHTS[name]) for name in names}
    report.text(INTRODUCTION)
    rows: list[tuple[Cell, ...]] = []
    worst = 0.0
    for name, each in courses.items():
        alive = each.v > LEAST
        seconds = (PERIOD_S * float(count.sum()) for count in (alive, each.rises, each.limited))
        rows.append((name, float(each.v[0]), f"{each.v[-1]:.1e}", *seconds))
        off = np.abs(each.rate - each.promised - each.missed).max() / np.abs(each.promised).max()
        worst = max(worst, float(off))
    headers = (
        "flight",
        "V at first / m2",
        "V after 12 s / m2",
        "V > 1e-5 m2 for / s",
        "V rises for / s",
        "limited for / s",
    )
    report.table(headers, rows)
    report.check(
        "V' as it was against (22) + e2 (a - a_c), of the largest V'", "<= 0.1 %", f"{worst:.3%}", worst <= 1e-3
    )
    must = sum(int(each.must_fall.sum()) for each in courses.values())
    fell = sum(int((each.must_fall & ~each.rises).sum()) for each in courses.values())
    report.check("control steps at which V falls, of those at which it must", "all", f"{fell} of {must}", fell == must)
    rising = PERIOD_S * float(courses["1 m"].rises.sum())
    report.check("a step of 1 m in calm air: V rises for", "0 s", f"{rising:g} s", rising == 0.0)
    _picture(report, courses)


def _picture(report: Report, courses: dict[str, Course]) -> None:
    figure, grid = style.sheet(2, len(courses), height=4.4)
    every = slice(None, None, 8)
    for (upper, lower), (name, each) in zip(grid.T, courses.items(), strict=True):
        time = each.time[every]
        upper.semilogy(time, each.v[every], label="V (19)")
        upper.semilogy(time, each.v1[every], lw=0.9, label="V1 (13)")
        lower.plot(time, each.rate[every], label="V' as it was", lw=2.2)
        lower.plot(time, each.promised[every], color=style.PALETTE[3], lw=1.0, label="promised (22)")
        lower.plot(time, each.missed[every], color=style.PALETTE[2], lw=1.0, label="e2 (a - a_c)")
        lower.set_yscale("symlog", linthresh=0.1)
        for axes in (upper, lower):
            bounds = {"transform": axes.get_xaxis_transform(), "lw": 0.0}
            axes.fill_between(each.time, 0.0, 1.0, where=each.limited, color="#d9d9d9", label="limited", **bounds)
            axes.fill_between(each.time, 0.0, 1.0, where=each.rises, color="#f6cfd2", label="V rises", **bounds)
            axes.set_xlim(0.0, FLIGHTS[name].shown_s)
        upper.set(title=name, ylim=(LEAST, 2.0 * float(each.v.max())))
        lower.set_xlabel("time / s")
    grid[0, 0].set_ylabel("m2")
    grid[1, 0].set_ylabel("m2/s")
    handles = [*grid[0, 0].get_lines(), *grid[1, 0].get_lines(), *grid[0, 0].collections]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    report.figure(figure, "lyapunov", "V and V' after steps; all axes together, c = 2.5.")


INTRODUCTION = """
V of (13) and (19) is in the trace of every flight, with the V' that (22) promises. With a the vehicle's acceleration
and a_c the commanded one, V' = -c1 e1^2 - c2 e2^2 + e2 (a - a_c) without any approximation. So V falls wherever
the last term is smaller than the decrease that (22) promises, and where V rises, the last term says why:

- *A step of 1 m in calm air*: at first V is constant because the attitude has not turned yet (with a = 0 the last term
  cancels the promised decrease). Then it falls all the way.
- *15 m*: the limit on the tilt is reached (grey). V still falls, but not as fast as promised: the acceleration has the
  right direction and is as large as possible.
- *Angle weight 10*: the attitude is late, and so is the acceleration. Whenever e2 has changed its sign and the
  acceleration has not, V rises (red): the oscillation of a cascade whose loops are too close in bandwidth.
- *In wind* (5 m/s on average with turbulence, and no part of the controller compensates it): the command lacks the drag
  of the moving air all the time. V falls until the error is d / (1 + c1 c2) for a disturbance d and then rises and
  falls with the gusts. The adaptive part of the default controller removes this error.
"""
