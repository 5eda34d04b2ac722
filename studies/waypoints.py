"""Figs. 6-9: waypoints with obstacles between them, under c = 1, 2.5, 5 and a yaw weight Q(5,5) of 1, 50, 125.

The text gives neither the places nor the LiDAR's field of view nor the speed; only the outcomes can be compared.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from companion.mission.plan import Mission, Phase
from companion.runtime.files import load_mission
from companion.state import Output
from companion.supervision.states import State
from protocol import toml_files
from protocol.arrays import Array
from protocol.frames import wrap, yaw_of
from studies import style
from studies.joined import Joined
from studies.paper_settings import paper_settings
from studies.report import Report
from vehicle_sim.airframe import Airframe
from vehicle_sim.timing import TICK_S
from vehicle_sim.world import World

NAME = "waypoints"
TITLE = "Figs. 6-9: obstacles between waypoints"

MISSION = "paper_fig6"
CONSTANTS = (1.0, 2.5, 5.0)
YAW_WEIGHTS = (1.0, 50.0, 125.0)
PUBLISHED = {1.0: False, 50.0: True, 125.0: True}
"""Whether the paper's vehicle passes the obstacles, by yaw weight, the same for every c."""
FIELD_OF_VIEW_DEG = 30.0
RANGE_M = 8.0
SPEED = 4.0
AT_ONCE_DEG = 1e12
MAP_FIELDS_DEG = (20.0, 40.0, 60.0, 90.0)
MAP_SPEEDS = (2.0, 4.0, 6.0)


Outcomes = Mapping[tuple[float, float], tuple[int, int]]
"""Field of view (deg) and speed (m/s) -> the result of `wrong_outcomes`."""


@dataclass(frozen=True)
class Sighting:
    """The moment on a leg at which the rule first reacts to the obstacle."""

    leg: int
    """Number of the leg's step in the flight; 1 is the leg to the first waypoint."""
    since_turn_s: float
    yaw_error: float
    """rad, between the nose and the leg's course."""
    distance: float
    """m along the leg from the vehicle to the obstacle's near face."""
    speed: float
    changes_of_side: int
    """How often the rule changed to the other side after that."""


@dataclass(frozen=True)
class Flight:
    """One of the nine."""

    c: float
    yaw_weight: float
    passed: bool
    """It passed all obstacles and landed at the last waypoint."""
    met: str | None
    """Name of the obstacle that it hit."""
    clearance: float
    """m; the least of the hull."""
    path_ned: Array
    """(n, 3)"""
    yaw_errors: tuple[Array, ...]
    """rad between the nose and the leg's course, of each leg that was begun, one each 4 ms."""
    sightings: tuple[Sighting, ...]

    @property
    def as_published(self) -> bool:
        return self.passed is PUBLISHED[self.yaw_weight]

    @property
    def latest(self) -> Sighting:
        """The sighting with the least way left, of the legs that begin with a turn."""
        return min(self.sightings[1:], key=lambda sighting: sighting.distance)


def overrides(c: float, yaw_weight: float) -> tuple[str, ...]:
    """The paper's laws and its rule; the reference of the heading jumps to the course, so that the LQR alone turns
    it."""
    return (
        *paper_settings(c, yaw_weight=yaw_weight),
        'avoidance.method="paper-literal"',
        f"trajectory.yaw_rate_deg={AT_ONCE_DEG}",
        f"trajectory.yaw_acceleration_deg={AT_ONCE_DEG}",
    )


def lidar_overrides(field_of_view_deg: float = FIELD_OF_VIEW_DEG) -> tuple[str, ...]:
    """Overrides of the vehicle's file."""
    return f"lidar.field_of_view_deg={field_of_view_deg}", f"lidar.max_range_m={RANGE_M}"


def command(c: float, yaw_weight: float) -> str:
    """The command for the same flight in two processes."""
    changes = (*overrides(c, yaw_weight), *(f"vehicle.{each}" for each in lidar_overrides()))
    options = "--output actuators --sensors perfect"
    return " ".join(("companion demo", MISSION, options, *(f"--set '{each}'" for each in changes)))


def fly(
    c: float, yaw_weight: float, *, field_of_view_deg: float = FIELD_OF_VIEW_DEG, speed: float = SPEED, seed: int = 1
) -> Flight:
    """Fly the mission, torques commanded, until it has landed or hit something."""
    mission, _ = load_mission(MISSION, [f"speed={speed}"])
    airframe = Airframe.load(toml_files.find("vehicles", mission.vehicle), lidar_overrides(field_of_view_deg))
    joined = Joined(mission, Output.ACTUATORS, overrides(c, yaw_weight), seed, airframe)
    joined.fly(limit_s=200.0, until=lambda flown: flown.vehicle.finished)
    summary = joined.vehicle.summary()
    trace = joined.trace()
    trace = trace[(trace["state"] == State.FLY.value) & (trace["phase"] == Phase.ROUTE.value)]
    legs = [trace[trace["step"] == 1 + index] for index in range(len(mission.waypoints))]
    courses = list(_courses(mission))
    return Flight(
        c,
        yaw_weight,
        summary.outcome == "landed" and joined.autopilot.supervisor.fault is None,
        summary.contact_with,
        summary.least_clearance_m or 0.0,
        trace["position_ned"].copy(),
        tuple(_yaw_errors(leg, course) for leg, course in zip(legs, courses, strict=True) if len(leg)),
        tuple(
            _sighting(number, leg, course, joined.vehicle.world)
            for number, (leg, course) in enumerate(zip(legs, courses, strict=True), start=1)
            if leg["blocked"].any()
        ),
    )


def _courses(mission: Mission) -> Iterator[float]:
    """The course of each leg, rad from north."""
    north, east = 0.0, 0.0
    for waypoint in mission.waypoints:
        yield math.atan2(waypoint.east - east, waypoint.north - north)
        north, east = waypoint.north, waypoint.east


def _yaw_errors(rows: Any, course: float) -> Array:
    return np.array([wrap(course - yaw_of(attitude)) for attitude in rows["attitude_ned_frd"]])


def _sighting(number: int, leg: Any, course: float, world: World) -> Sighting:
    first = int(np.argmax(leg["blocked"]))
    ahead = np.array([math.cos(course), math.sin(course)])
    place, half_along, half_across = world.boxes[number - 1, :2], world.boxes[number - 1, 2], world.boxes[number - 1, 3]
    depth = half_along * abs(ahead[0]) + half_across * abs(ahead[1])
    return Sighting(
        number,
        first * TICK_S,
        float(_yaw_errors(leg[first : first + 1], course)[0]),
        float((place - leg["position_ned"][first, :2]) @ ahead - depth),
        float(np.hypot(*leg["velocity_ned"][first, :2])),
        _changes_of_side(leg[leg["blocked"]], ahead),
    )


def _changes_of_side(rows: Any, ahead: Array) -> int:
    offset = rows["target_ned"][:, :2] - rows["position_ned"][:, :2]
    return int(np.count_nonzero(np.diff(np.sign(offset @ np.array([-ahead[1], ahead[0]])))))


def wrong_outcomes(field_of_view_deg: float, speed: float) -> tuple[int, int]:
    """How many of the nine flights do not end as published: those that pass and should not, and those that should pass
    and do not."""
    flights = [fly(c, q, field_of_view_deg=field_of_view_deg, speed=speed) for c, q in product(CONSTANTS, YAW_WEIGHTS)]
    wrong = [flight.passed for flight in flights if not flight.as_published]
    return sum(wrong), len(wrong) - sum(wrong)


def run(report: Report) -> None:
    """Fly the nine flights and the map, and report their outcomes."""
    report.text(
        f"""
The paper flies over several waypoints with obstacles between them; its Figs. 6-9, and with them all places, are not in
its text, nor are speed and field of view. What the text says is the outcome: with a yaw weight Q(5,5) of 1 the vehicle
"cannot avoid obstacles on time", with 50 and 125 it passes for c = 1, 2.5 and 5. The yaw can matter only where the
LiDAR looks ahead and not around, so here it does.

**What was chosen:** four legs of 18 m with a right angle at each waypoint, where the vehicle stops for 1 s
(`missions/{MISSION}.toml`); an obstacle of 2 m by 2 m that begins 5 m behind the start of each leg
(`worlds/{MISSION}.toml`); {FIELD_OF_VIEW_DEG:g} degrees of view and {RANGE_M:g} m of range, so that one obstacle is in
view at a time, since the rule has one box for all; {SPEED:g} m/s. The heading that is asked for jumps to the course at
each waypoint; the torques are the companion's LQR's. The rule is (26)-(31) as printed
(`companion/avoidance/paper_literal.py` has how it was read). Nothing else was tuned: weights of roll and pitch, limits
of tilt and torque, motor lag, noise and the memory of returns are those of every other flight.

The vehicle sets off at once and turns meanwhile. Under Q(5,5) = 1 the yaw error falls as exp(-t), poles at 1 and 48
1/s: the obstacle comes into view when the vehicle has its speed and a part of the way is gone, and then by one edge
alone. The rule takes what it sees for all that there is, and may go to the wrong side first. Under 50 and 125 the nose
is there before the vehicle has moved much. The torque that the rotors can give bounds these two: they are nearly alike.

One of them in two processes, with its log and report: `{command(2.5, 50.0)}`
"""
    )
    flights = [fly(c, q) for q, c in report.progress(list(product(YAW_WEIGHTS, CONSTANTS)), "flights")]
    report.table(
        ("Q(5,5)", "c", "paper", "here", "least clearance (m)", "leg", "first seen after (s)",
         "yaw error then (deg)", "way left to it (m)", "speed then (m/s)", "changes of side"),
        [_row(flight) for flight in flights],
        "The nine flights, and of their legs after a turn that on which the obstacle was seen the latest.",
    )  # fmt: skip
    report.figure(_from_above(flights), "waypoints", "Figs. 7, 8 and 9 in the world that stands for Fig. 6")
    report.figure(_first_seen(flights), "waypoints-first-seen", "When the obstacle is seen after a turn")
    met = sum(flight.as_published for flight in flights)
    report.check("outcomes of Figs. 7-9 as published", "9 of 9", f"{met} of 9", met == len(flights))
    cells = list(product(MAP_FIELDS_DEG, MAP_SPEEDS))
    outcomes = {cell: wrong_outcomes(*cell) for cell in report.progress(cells, "map")}
    report.figure(_map(outcomes), "waypoints-map", "Outcomes as published, of nine, over field of view and speed")
    report.text(_where(outcomes))


def _row(flight: Flight) -> tuple[str | float, ...]:
    paper = "passes" if PUBLISHED[flight.yaw_weight] else "too late"
    here = "passes" if flight.passed else f"hits {flight.met}" if flight.met else "lost"
    seen = flight.latest
    values = (seen.since_turn_s, abs(math.degrees(seen.yaw_error)), seen.distance, seen.speed)
    measured = (round(value, 2) for value in values)
    weight, c = f"{flight.yaw_weight:g}", f"{flight.c:g}"
    return (weight, c, paper, here, round(flight.clearance, 2), seen.leg, *measured, seen.changes_of_side)


def _where(outcomes: Outcomes) -> str:
    words = [
        f"{field:g} degrees and {speed:g} m/s ({passed} of 3 pass under 1, {failed} of 6 do not under 50 and 125)"
        for (field, speed), (passed, failed) in outcomes.items()
        if passed + failed
    ]
    whole = len(outcomes) - len(words)
    return (
        f"Of {len(outcomes)} pairs of field of view and speed, {whole} end as published in all nine flights. "
        f"Not so: {'; '.join(words) or 'none'}. Slow, with more than a narrow view, the vehicle sees the obstacle in "
        "time whatever the weight."
    )


def _from_above(flights: Sequence[Flight]) -> Any:
    from studies.route import draw_world

    mission, _ = load_mission(MISSION)
    world = World.load(toml_files.find("worlds", mission.world))
    figure, axes = style.sheet(1, len(YAW_WEIGHTS), height=3.6, sharey=True)
    for number, (panel, weight) in enumerate(zip(axes, YAW_WEIGHTS, strict=True), start=7):
        draw_world(panel, world, mission.takeoff_height)
        places = [(0.0, 0.0), *((point.east, point.north) for point in mission.waypoints)]
        panel.plot(*zip(*places, strict=True), ls=":", marker="o", ms=3, lw=0.8, color=style.GREY)
        for flight in flights:
            if flight.yaw_weight == weight:
                (line,) = panel.plot(flight.path_ned[:, 1], flight.path_ned[:, 0], label=f"c = {flight.c:g}")
                if flight.met is not None:
                    panel.plot(*flight.path_ned[-1, 1::-1], "x", ms=6, mew=1.6, color=line.get_color(), zorder=5)
        panel.set(title=f"Fig. {number}: Q(5,5) = {weight:g}", xlabel="east / m", aspect="equal")
    axes[0].set_ylabel("north / m")
    axes[-1].legend(loc="lower right")
    return figure


def _first_seen(flights: Sequence[Flight]) -> Any:
    figure, (left, right) = style.sheet(1, 2, height=2.8)
    shown = {flight.yaw_weight: flight for flight in flights if flight.c == 2.5}
    leg = min(len(flight.yaw_errors) for flight in shown.values())
    for (weight, flight), color in zip(shown.items(), style.PALETTE, strict=False):
        errors = np.degrees(flight.yaw_errors[leg - 1])
        left.plot(np.arange(len(errors)) * TICK_S, errors, color=color, label=f"Q(5,5) = {weight:g}")
        for seen in flight.sightings:
            if seen.leg == leg:
                left.plot(seen.since_turn_s, math.degrees(seen.yaw_error), "o", ms=6, color=color)
        after_turns = [seen for each in flights if each.yaw_weight == weight for seen in each.sightings[1:]]
        right.plot([seen.speed for seen in after_turns], [seen.distance for seen in after_turns], "o", color=color)
    left.axhspan(-0.5 * FIELD_OF_VIEW_DEG, 0.5 * FIELD_OF_VIEW_DEG, color=style.STONE, alpha=0.3, lw=0.0)
    left.set(xlabel="since the turn began / s", ylabel="yaw error to the course / deg", xlim=(0.0, 2.5))
    left.set_title(f"leg {leg}, c = 2.5; dots: first seen; band: the view")
    left.legend()
    right.set(xlabel="speed when first seen / (m/s)", ylabel="way left to the obstacle / m", xlim=(0.0, 4.6))
    right.set_ylim(bottom=0.0)
    right.set_title("all legs after a turn, all c")
    return figure


def _map(outcomes: Outcomes) -> Any:
    figure, axes = style.sheet(height=2.6, width=4.2)
    counts = np.array([[9 - sum(outcomes[field, speed]) for field in MAP_FIELDS_DEG] for speed in MAP_SPEEDS])
    axes.imshow(counts, cmap="Blues", vmin=0, vmax=16, aspect="auto", origin="lower")
    for (row, column), count in np.ndenumerate(counts):
        axes.text(column, row, f"{count:d}", ha="center", va="center", weight="bold" if count == 9 else "normal")
    axes.set_xticks(range(len(MAP_FIELDS_DEG)), [f"{each:g}" for each in MAP_FIELDS_DEG])
    axes.set_yticks(range(len(MAP_SPEEDS)), [f"{each:g}" for each in MAP_SPEEDS])
    axes.set(xlabel="field of view / deg", ylabel="speed / (m/s)")
    axes.grid(visible=False)
    return figure
