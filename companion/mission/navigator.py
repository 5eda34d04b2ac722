"""The flight along the mission: which step is flown, and whether it is done, overdue or to be given up.

The navigator says where to go (`leg`) and is told how the motion goes (`advance`, `judge`). It moves and sends nothing.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import Enum
from typing import NamedTuple

import msgspec
import numpy as np

from companion.config import Settings
from companion.fence import Fence, fence_of
from companion.mission.altitude_search import AltitudeSearch, Place
from companion.mission.ground_following import GroundFollowing
from companion.mission.plan import Mission, Phase, Step, is_beside, nearest_step, steps
from companion.mission.stall import Progress
from companion.mission.step_time import StepTime
from companion.mission.taking_up import climb_first, taken_up, way_to
from companion.mission.wander import Settling
from companion.mission.way_home import WayHome
from companion.reports import CommandReport, MissionReport, MotionReport
from companion.state import EVERY_HEIGHT, NO_FENCE, Announcement, Ground, OwnFence, Severity, VehicleState
from protocol.arrays import Array

NEAR_M = 2.0
"""From a goal that is nearer than this, no way over the map is needed."""

_ALONG = (Phase.ROUTE, Phase.RETURN, Phase.TRACK)
"""Phases in which the trail is followed up."""


class Leg(msgspec.Struct, frozen=True, gc=False):
    """What is to be flown now."""

    step: Step
    index: int
    """Index of the step in the mission."""
    goal_ned: Array
    """(3,) m: the step's target at the altitude that is flown; the vehicle's place where the step has none."""
    speed: float
    """m/s, the highest."""
    waits: bool
    """The vehicle changes its altitude or looks around there: it does not go on along the way."""
    in_the_way: tuple[float, float] = EVERY_HEIGHT
    """m above and below the vehicle up to which returns are in the way."""


class Arrival(Enum):
    """What has become of a leg."""

    NOT_YET = "on the way"
    AT_TRACK = "at rest where a track begins"
    DONE = "done"


class Judgement(NamedTuple):
    """What follows from the progress towards the goal."""

    announcements: tuple[Announcement, ...] = ()
    failure: str | None = None
    """The goal was given up for this reason: another leg has begun."""


_GOING_ON = Judgement()


class Navigator:
    """One mission, step by step."""

    def __init__(
        self, settings: Settings, mission: Mission, durations: Sequence[float | None], *, lands: bool = False
    ) -> None:
        """`durations`: s that each step's track takes; None for a step without one. `lands`: a vehicle that is taken
        over in flight does nothing else."""
        self.mission = mission
        self.steps: tuple[Step, ...] = ()
        """Known from the place of the start on (`begin`)."""
        self.step_index = 0
        self.step: Step
        """The present one."""
        self.phase = Phase.PREPARE
        """Phase of the present step; PREPARE before the start, DONE after the end."""
        self.released = 0
        """Parcels that are delivered."""
        self.ground_down = 0.0
        """m, NED: the place of the start."""
        self._settings = settings
        self._top_speed = math.inf
        self.lands = lands
        """Nothing is left but the landing."""
        self._durations = tuple(durations)
        self._fence: Fence | None = None
        self._highest = -math.inf
        """m, NED: no higher within it."""
        self._search = AltitudeSearch(settings.avoidance.altitude_search, settings.avoidance.give_up_s)
        self._below = GroundFollowing(settings)
        self._way_home = WayHome(mission, settings.trajectory)
        self._progress = Progress()
        self._leg: Leg | None = None
        """As it was said last, until anything about it may have changed."""
        self._gave_up = False
        self.cut_short = False
        """What is left is the way home."""
        self._time = StepTime(settings)
        self._arrived_ns: int | None = None
        self._settling = Settling(settings.trajectory, at_once=mission.profile == "step")
        self._parts: tuple[Step, ...] = ()
        """What is left of the present step: itself, or what is flown in its place; over the ground of the start."""
        self._others_flew = False

    # -- where to go ---------------------------------------------------------------------------------------------------

    def begin(self, start_ned: Array, own: OwnFence = NO_FENCE) -> None:
        """The vehicle, with a fence of its own, stands at the place (3,) of the start."""
        self.ground_down = float(start_ned[2])
        self._fence = fence_of(self._settings.geofence, start_ned, own)
        self._highest = -math.inf if self._fence is None else self._fence.low[2] + self._settings.geofence.margin
        self._below.begin(self.ground_down, self._highest)
        self.steps = steps(self.mission, start_ned)
        assert self.steps[0].target_ned is not None
        self._way_home.begin(start_ned, self.steps[0].target_ned)
        self._enter(0, start_ned)

    def adopt(self, start_ned: Array, here_ned: Array, own: OwnFence, now_ns: int) -> Announcement:
        """The vehicle, which started at a place (3,), is taken over in flight at another (3,): what is left of the
        mission is flown from the nearest step on, or nothing but the landing."""
        self.begin(start_ned, own)
        self.step_index = len(self.steps) - 1 if self.lands else nearest_step(self.steps, start_ned, here_ned)
        self._others_flew = True
        self.go_on(here_ned, now_ns)
        self._time.begin(now_ns)
        return Announcement(Severity.INFO, f"from step {self.step_index + 1} of {len(self.steps)} on")

    def _enter(self, index: int, here_ned: Array | None = None, parts: tuple[Step, ...] = ()) -> None:
        """Begin the step of that index, or the parts in its place, from a place (3,) if that is known."""
        self.step_index, self._parts = index, parts or (self.steps[index],)
        self.step = self._below.shifted(self._parts[0])
        self.phase, self._leg = self.step.phase, None
        here = None if here_ned is None else self._below.planned(here_ned)
        self._time.way = way_to(self._parts[0], self.steps[:index], here)

    def go_on(self, here_ned: Array, now_ns: int) -> Announcement | None:
        """The mission is flown, with the vehicle at a place (3,). If others flew it until now, it is taken up where
        they left it; what is to be said if something else than the present step comes first."""
        if not self._others_flew:
            return None
        self._others_flew, before, took_s = False, self.step_index, self._time.way_s(self._speed)
        index, parts = taken_up(self.steps, before, self._below.planned(here_ned), self._settling.distance)
        self._enter(index, here_ned, parts)
        elsewhere = bool(parts) or index != before
        said = [f"the vehicle is elsewhere: {_title(self.step, index, self.steps)}"] if elsewhere else []
        down, target = max(float(here_ned[2]), self._highest), self.step.target_ned if self.step.avoids else None
        if self._search.resume(down, None if target is None else float(target[2])):
            said.append(f"keeping {self.ground_down - down:.1f} m of height: what is below was not seen")
        if elsewhere or self._time.way_s(self._speed) > took_s:
            self._time.begin(now_ns)
        return Announcement(Severity.INFO, ", ".join(said)) if said else None

    def end(self) -> None:
        """Nothing more is flown."""
        self.phase = Phase.DONE

    def leg(self, position_ned: Array) -> Leg:
        """What is to be flown now, from a place (3,)."""
        leg = self._leg
        if leg is None:
            step, waits = self.step, self._search.busy or self._below.too_low
            in_the_way = EVERY_HEIGHT if step.target_ned is None else self._search.in_the_way(float(step.target_ned[2]))
            leg = Leg(step, self.step_index, self._goal(position_ned), self._speed, waits, in_the_way)
            if step.target_ned is not None:  # otherwise the goal is wherever the vehicle is
                self._leg = leg
        return leg

    def planned(self, place_ned: Array) -> Array:
        """A place (3,) as `fly` takes it: as if the ground were that of the start."""
        return self._below.planned(place_ned)

    def follow(self, ground: Ground | None, here_ned: Array, now_ns: int) -> Announcement | None:
        """The ground below the vehicle, which is at a place (3,); what is to be said of it."""
        planned = self._parts[0]
        changed, said = self._below.follow(ground, planned, float(here_ned[2]), now_ns)
        if changed:
            self.step, self._leg = self._below.shifted(planned), None
        return said

    @property
    def _speed(self) -> float:
        """m/s, at most."""
        return min(self._search.slowed(self.step.speed or self.mission.speed), self._top_speed)

    def slow_down(self, late_s: float) -> None:
        """With a link that is so late, the vehicle flies so slowly that it comes no farther than `blind_way` blind."""
        self._top_speed = self._settings.trajectory.blind_way / late_s if late_s > 0.0 else math.inf
        self._leg = None

    def _goal(self, position_ned: Array) -> Array:
        target = self.step.target_ned
        if target is None:
            return position_ned
        down = self._search.flown(float(target[2]))
        return target if down == target[2] else np.array([*target[:2], down])

    @property
    def lowest_return(self) -> float:
        """m, NED: what a scan shows below this is the ground."""
        return self._below.lowest_return

    # -- time ----------------------------------------------------------------------------------------------------------

    def start_step(self, now_ns: int) -> None:
        """The time that the present step may take begins."""
        self._time.begin(now_ns)

    def pause(self, now_ns: int) -> None:
        """Others fly from now on."""
        self._time.pause(now_ns)

    def resume(self, now_ns: int) -> None:
        """Others flew since `pause`: that time counts for nothing, and the goal is approached afresh."""
        self._time.resume(now_ns)
        self._others_flew = True
        self._arrived_ns = None
        self._progress = Progress()
        self._leg = None

    def report(
        self, now_ns: int, state: VehicleState | None = None, outside: str | None = None, *, flying: bool
    ) -> MissionReport:
        """How far the mission is, with the vehicle in a `state` if that is known; a step is overdue only while the
        companion is `flying`. `outside`: the place of the mission that is beyond the fence, in words, if there is one.
        """
        done = bool(self.steps) and self.step.phase is Phase.LAND
        beyond = 0.0 if state is None or self._fence is None else -self._fence.room(state.position_ned)
        allowed = 0.0
        if self.steps:
            track_s, explored = self._durations[self.step_index], self._progress.explored(self.step_index)
            allowed = self._time.allowed(self.step.hold_s, track_s, self._speed, explored)
        overdue = self._time.overdue(allowed, now_ns) if flying else 0.0
        outside = None if self.lands else outside  # nothing of the mission is flown
        report = MissionReport(done, overdue, allowed, outside=outside, beyond=beyond)
        if not flying or state is None:
            return report
        homeward, landing_s = self._way_to_landing(state.position_ned, now_ns)
        return msgspec.structs.replace(report, homeward=homeward, landing_s=landing_s)

    def _way_to_landing(self, here: Array, now_ns: int) -> tuple[bool, float]:
        """Whether the mission leads straight to where it lands, and the time (s) to the nearest landing place known, as
        slowly as the vehicle came."""
        here = self._below.planned(here)
        if self.phase in _ALONG:
            self._way_home.trail.add(here, self._speed, now_ns)
        held_s = 0.0 if self._arrived_ns is None else (now_ns - self._arrived_ns) * 1e-9
        left = _left(self._parts, held_s, self.steps[self.step_index + 1 :])
        most = min(self._search.slowed(math.inf), self._top_speed)
        return self._way_home.to_landing(here, self.phase, left, most, cut_short=self.cut_short)

    # -- how it goes ---------------------------------------------------------------------------------------------------

    def advance(self, motion: MotionReport, state: VehicleState, now_ns: int) -> Arrival:
        """Judge the present step, which has a target, by the motion of the reference and the vehicle's own."""
        step, position = self.step, state.position_ned
        if motion.over_map and self._search.busy:
            speed = math.hypot(*state.velocity_ned[:2].tolist())
            self._search.advance(float(position[2]), speed, now_ns)
            self._leg = None
        if motion.following:
            return Arrival.DONE if motion.rests else Arrival.NOT_YET
        settings = self._settings.trajectory
        if step.passes:
            near = math.dist(self._goal(position).tolist(), position.tolist()) < settings.acceptance_radius
            return Arrival.DONE if near else Arrival.NOT_YET
        target = step.target_ned if motion.track_start_ned is None else motion.track_start_ned
        assert target is not None
        if self._arrived_ns is None and self._settling.reached(target, state, motion.rests):
            self._arrived_ns = now_ns
        if motion.track_start_ned is not None:
            if self._arrived_ns is None or not motion.rests:
                return Arrival.NOT_YET
            self._arrived_ns = None
            return Arrival.AT_TRACK
        held = self._arrived_ns is not None and now_ns - self._arrived_ns >= step.hold_s * 1e9
        return Arrival.DONE if held else Arrival.NOT_YET

    def tracked(self, errors: Array) -> None:
        """The errors (6,) from the reference of a control step in the air: position (m) and virtual rate (m/s)."""
        self._settling.wander.add(errors)

    def release(self, answer: CommandReport) -> tuple[Arrival, Announcement | None]:
        """What came of the release of the parcel so far. A parcel that the vehicle does not release is taken home."""
        if answer.accepted:
            self.released += 1
            return Arrival.DONE, Announcement(Severity.NOTICE, "parcel released")
        if answer.tries > self._settings.supervision.command_tries:
            return Arrival.DONE, Announcement(Severity.ERROR, f"parcel not released: {answer.answer}")
        return Arrival.NOT_YET, None

    def next_step(self, now_ns: int, here_ned: Array | None = None, *, done: bool = True) -> Announcement:
        """Go on to the next step, from a place (3,) if that is known. `done`: the present one was flown to its end."""
        self._search.next_leg(stopped=done and not self.step.passes)
        self._enter(self.step_index + (len(self._parts) < 2), here_ned, self._parts[1:])
        self._time.begin(now_ns)
        self._arrived_ns = None
        return Announcement(Severity.INFO, _title(self.step, self.step_index, self.steps))

    def judge(self, position_ned: Array, detour: float, now_ns: int) -> Judgement:
        """The progress from a place (3,), where the way costs `detour` (m) beyond the least that was to be expected:
        another altitude is tried, or the goal given up, if there has been none for too long."""
        goal = self._goal(position_ned)
        if self._search.busy:
            self._progress = Progress()
        away = math.hypot(*(goal - position_ned)[:2].tolist())
        stalled_s = self._progress.stalled_s(self.step_index, away, position_ned, now_ns)
        if away < NEAR_M:
            return _GOING_ON
        change = self._change_altitude(position_ned, detour, stalled_s, now_ns)
        if change is not None:
            return Judgement((change,))
        stuck = stalled_s > self._settings.avoidance.give_up_s
        return self._give_up(position_ned, now_ns) if stuck else _GOING_ON

    def _change_altitude(self, here: Array, detour: float, stalled_s: float, now_ns: int) -> Announcement | None:
        """Try another altitude that is allowed, if that may help."""
        target, settings = self.step.target_ned, self._settings.avoidance.altitude_search
        assert target is not None
        place = Place(here, float(target[2]), self.ground_down - settings.min_height, self._highest)
        change = self._search.consider(detour, stalled_s, place, now_ns)
        self._leg = None
        if change is None:
            return None
        self._progress = Progress()
        self._time.begin(now_ns)
        return Announcement(Severity.INFO, f"{change.why}: {self.ground_down - change.down:.1f} m of height")

    def go_home(self, here: Array, now_ns: int) -> Announcement:
        """Cut the rest of the mission: fly home from a place (3,) the way it came, and land there."""
        home, back, planned = self.steps[0].target_ned, list[Step](), self._below.planned(here)
        assert home is not None
        if self.phase is not Phase.TAKEOFF:  # which is above the landing place
            back = climb_first(self.steps[self.step_index :], self.phase, planned)
            back += _way_back(self._way_home.trail.corners(planned, home), home)
        self._search.forbid()
        return self._cut(back, here, now_ns)

    def _cut(self, rest: list[Step], here: Array, now_ns: int) -> Announcement:
        """Fly the `rest` in place of what was to follow the present step, and land."""
        self.cut_short = True
        return self.fly([*rest, Step(Phase.LAND)], now_ns, here)

    def fly(self, rest: Sequence[Step], now_ns: int, here_ned: Array) -> Announcement:
        """Fly the `rest`, which has no curves, in place of what was to follow the present step, from a place (3,)."""
        self._parts = self._parts[:1]
        self.steps = (*self.steps[: self.step_index + 1], *rest)
        self._durations = self._durations[: self.step_index + 1] + (None,) * len(rest)
        return self.next_step(now_ns, here_ned, done=False)

    def _give_up(self, here: Array, now_ns: int) -> Judgement:
        """Go home along the way flown, if that is where the mission ends and it is not tried already; else land."""
        back: list[Step] = []
        if (self.mission.return_home or _ends_at_its_start(self.steps)) and not self._gave_up:
            back = _way_back(self._way_home.trail.back(), self.steps[0].target_ned)
        way = "back the way it came" if back else "landing"
        text = f"no progress for {self._settings.avoidance.give_up_s:g} s: the goal is given up, {way}"
        self._gave_up = True
        self._search.forbid()
        return Judgement((Announcement(Severity.ERROR, text), self._cut(back, here, now_ns)), text)


def _title(step: Step, index: int, plan: Sequence[Step]) -> str:
    return f"{step.phase.name.lower()}, step {index + 1} of {len(plan)}"


def _left(parts: Sequence[Step], held_s: float, later: Sequence[Step]) -> Iterator[Step]:
    """What is left of a mission whose present step, of which these `parts` are left, has been held for so long (s)."""
    yield replace(parts[0], hold_s=max(parts[0].hold_s - held_s, 0.0))
    yield from parts[1:]
    yield from later


def _ends_at_its_start(plan: Sequence[Step]) -> bool:
    places = [step.target_ned for step in plan if step.target_ned is not None]
    return not is_beside(places[0], places[-1])


def _way_back(places: Sequence[Array], home: Array | None) -> list[Step]:
    """Through places (3,), and home."""
    through = [Step(Phase.RETURN, place, passes=True, avoids=True) for place in places]
    return [*through, Step(Phase.RETURN, home, avoids=True)]
