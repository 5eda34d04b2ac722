"""The route: a TOML file of waypoints and a delivery, turned into the steps that are flown one after the other."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

import msgspec
import numpy as np

from companion.config_types import Height, Metres, NotNegative, Speed, Table
from companion.curves import Curve, Route, Shape
from protocol.arrays import Array

_AS_NEAR_M = 1.0
BESIDE_M = 2.0
"""A vehicle that is farther beside a place is not above or below it."""


class Waypoint(Table, frozen=True):
    """A place on the way."""

    north: Metres
    """m north of the take-off point."""
    east: Metres
    """m east of it."""
    height: Height
    """m above it."""
    hold_s: NotNegative = 0.0
    """Stop there for so long; 0: pass through."""
    speed: Speed | None = None
    """m/s on the way there; left out, the mission's."""
    yaw_deg: float | None = None
    """Heading to turn to while it holds there, clockwise from north."""
    release: bool = False
    """Stop there, and release the parcel."""


class Delivery(Table, frozen=True):
    """At the last waypoint: descend, release the parcel, climb."""

    release_height: Height = 0.5
    """m above the take-off point."""


class Mission(Table, frozen=True):
    """What is flown: a file in `missions/`, or made in code."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]+\Z")]
    """Letters, digits, - and _: the log's folder carries it."""
    waypoints: list[Waypoint] = msgspec.field(default_factory=list)
    """In the order in which they are flown."""
    trajectory: Shape | None = None
    """In place of waypoints."""
    world: str = "empty"
    """Name or path of the file of the world that a simulator flies in."""
    vehicle: str = "paper_quad"
    """Name or path of the vehicle's file."""
    description: str = ""
    """For people."""
    takeoff_height: Height = 3.0
    """m; to where the vehicle climbs first."""
    speed: Speed = 4.0
    """m/s, at most."""
    delivery: Delivery | None = None
    """Delivery of a parcel at the last waypoint; None: there is none."""
    return_home: bool = True
    """Back along the route after the last waypoint; otherwise land there."""
    waits: bool = False
    """Stay at the last waypoint, or above the take-off point, and wait for orders (`companion.mission.orders`)."""
    profile: str = "smooth"
    """"smooth": jerk-limited references; "step": the reference jumps, as in the paper's closed-loop tests;
    "minimum_snap": one curve through the waypoints up to each hold, at up to `speed` and within the settings' limits of
    acceleration and tilt. It goes nowhere else: obstacles are not avoided on it."""

    @property
    def parcels(self) -> int:
        """How many it is to release."""
        return (self.delivery is not None) + sum(waypoint.release for waypoint in self.waypoints)

    def __post_init__(self) -> None:
        if self.profile != "smooth" and any(w.release or w.speed or w.yaw_deg is not None for w in self.waypoints):
            raise ValueError('waypoints: speed, yaw_deg and release are for the profile "smooth"')
        if self.profile not in ("smooth", "step", "minimum_snap"):
            raise ValueError(f'profile {self.profile!r}: there are "smooth", "step" and "minimum_snap"')
        if self.waits and (self.trajectory is not None or self.profile != "smooth"):
            raise ValueError('waits: it is for waypoints with the profile "smooth"')
        if bool(self.waypoints) == (self.trajectory is not None) and not self.waits:
            raise ValueError("waypoints: a mission has either these or a [trajectory]")
        if self.trajectory is not None and self.profile != "smooth":
            raise ValueError(f"profile {self.profile!r}: it is for waypoints, a [trajectory] has its own")
        if self.trajectory is not None and self.delivery is not None:
            raise ValueError("delivery: it is at the last waypoint, and a [trajectory] has none")
        height = self.waypoints[-1].height if self.waypoints else self.takeoff_height
        if self.delivery is not None and self.delivery.release_height > height:
            raise ValueError(
                f"delivery.release_height {self.delivery.release_height:g}: above the last waypoint, at {height:g}"
            )


class Phase(IntEnum):
    """What the flight is about at the moment; the numbers go into the log."""

    PREPARE = 0
    """On the ground, before the take-off."""
    TAKEOFF = 1
    """Up to the height of the mission."""
    ROUTE = 2
    """To a waypoint."""
    DESCEND = 3
    """Down to where the parcel is released."""
    RELEASE = 4
    """The parcel is let go."""
    CLIMB = 5
    """Up again, without the parcel."""
    RETURN = 6
    """Back to above the take-off point."""
    LAND = 7
    """Down to the ground."""
    DONE = 8
    """Nothing is left to do."""
    TRACK = 9
    """Along a curve: a shape, or a spline through waypoints."""
    WAIT = 10
    """In the air, for orders."""


@dataclass(frozen=True, slots=True)
class Step:
    """One thing to do. `target_ned` is None where nothing is flown to (release, land)."""

    phase: Phase
    target_ned: Array | None = None
    hold_s: float = 0.0
    passes: bool = False
    """Goes on to the next step without stopping."""
    avoids: bool = False
    """Obstacles are flown around."""
    speed: float | None = None
    """m/s on the way; None: the mission's."""
    yaw: float | None = None
    """Heading (rad) to turn to at the target; None: as it came."""
    curve: Curve | None = None
    """Flown once the vehicle stands at `target_ned`, where it begins."""


def steps(mission: Mission, start_ned: Array) -> tuple[Step, ...]:
    """The whole flight for a take-off from `start_ned` (on the ground)."""

    def point(north: float, east: float, height: float) -> Array:
        return np.add(start_ned, (north, east, -height))

    over_home = point(0.0, 0.0, mission.takeoff_height)
    plan = [Step(Phase.TAKEOFF, over_home)]
    shape = mission.trajectory
    if shape is not None:
        height = mission.takeoff_height if shape.height is None else shape.height
        plan.append(Step(Phase.TRACK, point(shape.north, shape.east, height), curve=shape))
    targets = [point(waypoint.north, waypoint.east, waypoint.height) for waypoint in mission.waypoints]
    holds = [waypoint.hold_s for waypoint in mission.waypoints]
    curved = mission.profile == "minimum_snap"
    if curved:
        plan += _curves(Phase.TRACK, [over_home, *targets], holds, mission.speed)
    else:
        for waypoint, target in zip(mission.waypoints, targets, strict=True):
            yaw = None if waypoint.yaw_deg is None else math.radians(waypoint.yaw_deg)
            passes = waypoint.hold_s == 0.0 and target is not targets[-1] and yaw is None and not waypoint.release
            plan.append(Step(Phase.ROUTE, target, waypoint.hold_s, passes, True, waypoint.speed, yaw))
            if waypoint.release:
                plan.append(Step(Phase.RELEASE))
    if mission.delivery is not None:
        plan += delivery(mission.delivery, [over_home, *targets][-1], start_ned)
    if mission.waits:
        plan.append(wait([over_home, *targets][-1]))
    elif mission.return_home:
        if curved:
            plan += _curves(Phase.RETURN, [*reversed(targets), over_home], [0.0] * len(targets), mission.speed)
        else:
            plan += [Step(Phase.RETURN, target, passes=True, avoids=True) for target in reversed(targets[:-1])]
        plan.append(Step(Phase.RETURN, over_home, avoids=not curved))
    plan.append(Step(Phase.LAND))
    return tuple(plan)


def delivery(wanted: Delivery, above_ned: Array, start_ned: Array) -> list[Step]:
    """The delivery below a place (3,), and back to it."""
    low = np.array([*above_ned[:2], start_ned[2] - wanted.release_height])
    return [Step(Phase.DESCEND, low), Step(Phase.RELEASE), Step(Phase.CLIMB, above_ned)]


def all_delivered(mission: Mission, flown: Sequence[Step], released: int) -> bool | None:
    """Whether as many parcels were `released` as the mission has, or one if its release was ordered; None if there was
    none to release."""
    parcels = max(mission.parcels, any(step.phase is Phase.RELEASE for step in flown))
    return released >= parcels if parcels else None


def wait(place_ned: Array) -> Step:
    """Stay at a place (3,), out of the way of what comes near."""
    return Step(Phase.WAIT, place_ned, hold_s=math.inf, avoids=True)


def is_beside(place_ned: Array, here_ned: Array) -> bool:
    """Whether `here_ned` (3,) is neither above nor below a place (3,)."""
    return math.dist(place_ned[:2].tolist(), here_ned[:2].tolist()) > BESIDE_M


def nearest_step(plan: Sequence[Step], start_ned: Array, here_ned: Array) -> int:
    """The step that is flown from `here_ned` (3,) on: the one whose way, from the place before to its own, is nearest.

    Of ways that are as near to within a metre (out and back along the same route) it is the first: rather a part of the
    mission twice than left out. A track counts as the way to its beginning, from where all of it is flown. The take-off
    is for a vehicle above its start alone.
    """
    before, distances = start_ned, []
    for step in plan:
        if step.target_ned is None or (step.phase is Phase.TAKEOFF and is_beside(start_ned, here_ned)):
            distances.append(math.inf)
            before = before if step.target_ned is None else step.target_ned
            continue
        way = step.target_ned - before
        length = float(way @ way)
        share = min(max(float((here_ned - before) @ way) / length, 0.0), 1.0) if length else 0.0
        distances.append(math.dist((before + share * way).tolist(), here_ned.tolist()))
        before = step.target_ned
    nearest = min(distances)
    return next(index for index, distance in enumerate(distances) if distance <= nearest + _AS_NEAR_M)


def _curves(phase: Phase, places: list[Array], holds: list[float], speed: float) -> list[Step]:
    """From the first place through the others, as one curve up to each hold."""
    plan: list[Step] = []
    points = places[:1]
    for place, hold_s in zip(places[1:], holds, strict=True):
        if not np.array_equal(place, points[-1]):
            points.append(place)
        if hold_s == 0.0 and place is not places[-1]:
            continue
        if len(points) > 1:
            plan.append(Step(phase, points[0], curve=Route(np.array(points) - points[0], speed)))
        if hold_s > 0.0:
            plan.append(Step(Phase.ROUTE, place, hold_s))
        points = [place]
    return plan
