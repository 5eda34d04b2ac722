"""Where the vehicle should be: the mission's leg, a track, the way over the map or a method that steers by returns, as
one reference.

A leg is flown to by the jerk-limited generator, along a track, or over the map by the course, whose horizontal motion
takes the generator's place while altitude and heading stay with the generator.
"""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from companion.avoidance.drift_margin import DriftMargin
from companion.avoidance.guard import Guard, Verdict
from companion.avoidance.methods import goal_rule
from companion.avoidance.path import NO_PATH
from companion.avoidance.planner import PlanRequest, PlanResult
from companion.avoidance.steering import Course, approached, limited, steer
from companion.config import Settings
from companion.config_limits import Geofence
from companion.fence import Fence, fence_of, first_beyond
from companion.mission.navigator import NEAR_M, Arrival, Leg
from companion.mission.plan import Mission, Phase, Step, steps
from companion.perception.fence_band import Walls
from companion.perception.recent_returns import RecentReturns
from companion.perception.scans import obstacle_points
from companion.reports import LinkDelay, MotionReport
from companion.state import NO_FENCE, AvoidanceDecision, OwnFence, Pose, Reference, Scan, VehicleState
from companion.trajectory import ReferenceGenerator, Track, track_of
from protocol.arrays import Array
from protocol.frames import yaw_of

_STEER_EVERY_NS = 15_000_000
"""At least, between two looks along the way over the map: each fourth control step. Course and guard's filter go on at
each one."""
_APPROACH_M = 1.0
"""A goal that is stopped at is approached by the generator from this distance on, not along the map's way, until it is
farther than NEAR_M again, or than this with something in the way."""
_APPROACH_SPEED = 1.0
"""m/s: the vehicle must be slower for that."""
_TURN_M = 1.0
"""The heading follows the way to a target that is farther than this."""
_SAMPLES = 500
"""Places of a track that are looked at for the fence."""
_TURN_SPEED = 1.0
"""m/s: the heading follows the way over the map at a higher wanted speed."""


class Guidance:
    """The reference of one flight."""

    def __init__(self, settings: Settings, mission: Mission, guard: Guard | None) -> None:
        avoidance = settings.avoidance
        self._settings = settings
        self._mission = mission
        self._guard = guard
        self._generator = ReferenceGenerator(settings.trajectory)
        self._tracks = tuple(
            None if step.curve is None else track_of(step.curve, settings.trajectory, settings.limits.tilt)
            for step in steps(mission, np.zeros(3))
        )
        self._judged: tuple[OwnFence, str | None] | None = None
        """The vehicle's own fence, and how the mission leaves the whole."""
        self._fence: Fence | None = None
        """What the reference keeps to, once the place of the start is known."""
        self._walls: Walls | None = None
        """It as the planner gets it."""
        self._outside = False
        """The reference was begun outside of it, and comes back."""
        self._rest_of_track: Track | None = None
        """What is left of the track that was being followed when the flight was held."""
        self._jumps = mission.profile == "step"
        self.over_map = avoidance.mapped and not self._jumps
        """Ways over the map are flown."""
        self._guarded = avoidance.guarded and not self._jumps
        self._course = Course(avoidance.course)
        self._course_start_ned: Sequence[float] = (0.0, 0.0)
        """Where the course began (north, east) and the generator waits for its end."""
        self._wanted = np.zeros(2), np.zeros(2)
        """Velocity (m/s) that the course takes up, and acceleration (m/s2) by which that changes, north and east."""
        self._steer_at_ns = 0
        self._path = NO_PATH
        self.free_distance = math.inf
        """m of the way that is seen free; inf where none is flown over the map."""
        self.method = goal_rule(avoidance)
        self._returns = RecentReturns(avoidance.memory_s, avoidance.merge_distance)
        self.margin = DriftMargin(avoidance.velocity_error_s)
        self._asked = 0
        self._mapped_ns: int | None = None
        self.decision = AvoidanceDecision(np.zeros(3), mission.speed, math.inf, False)

    @property
    def durations(self) -> tuple[float | None, ...]:
        """s that the track of each step of the mission takes; None for a step without one."""
        return tuple(None if track is None else track.duration_s for track in self._tracks)

    @property
    def fence(self) -> Fence | None:
        """What the reference keeps to, once the place of the start is known."""
        return self._fence

    def outside(self, own: OwnFence) -> str | None:
        """The first place of the mission beyond the fence, of which the vehicle's own is a part, in words; None if it
        keeps inside."""
        if self._judged is None or self._judged[0] != own:
            self._judged = own, _leaves(self._settings.geofence, own, _places(self._mission, self._tracks))
        return self._judged[1]

    def follow(self, late: LinkDelay, pace: float) -> None:
        """The link is so late from now on, and the vehicle is flown at this pace."""
        if self._guard is not None:
            self._guard.follow(late.total, pace)

    # -- begin and end -------------------------------------------------------------------------------------------------

    def begin(self, state: VehicleState, home_ned: Array, own: OwnFence = NO_FENCE) -> None:
        """The reference stands where the vehicle is, and keeps within the fence around its home (3,)."""
        fence = fence_of(self._settings.geofence, home_ned, own)
        if fence is not None:
            self._fence = fence.shrunk(self._settings.geofence.margin)
            self._walls = Walls(self._fence, self._settings.avoidance)
        self.hold_at(state)
        self.decision = AvoidanceDecision(state.position_ned, self._mission.speed, math.inf, False)

    def begin_leg(self, leg: Leg, now_ns: int) -> None:
        """Another leg than before is flown from now on."""
        self._rest_of_track = None
        self._steer_at_ns = now_ns
        self.decision = AvoidanceDecision(_target_of(leg), leg.speed, self.decision.clearance, False)

    def hold_at(self, state: VehicleState) -> None:
        """The reference stands where the vehicle is now, with its heading."""
        self._generator.hold_at(state.position_ned, yaw_of(state.attitude_ned_frd))
        self._begins_at(state.position_ned)

    def halt(self, now_ns: int) -> None:
        """Brake to a standstill; a track is taken up later where it was left."""
        self._leave_course(now_ns)
        self._rest_of_track = self._generator.remaining_track(now_ns) or self._rest_of_track
        self._generator.brake(now_ns)

    def brake_from(self, state: VehicleState, now_ns: int) -> None:
        """Brake from the vehicle's own motion: others flew it."""
        self._generator.brake_from(now_ns, state.position_ned, state.velocity_ned, np.zeros(3))
        self._begins_at(state.position_ned)

    def keep_pace(self, now_ns: int, lead: float) -> float:
        """See `ReferenceGenerator.keep_pace`; what jumps waits for nobody."""
        return 1.0 if self._jumps else self._generator.keep_pace(now_ns, lead)

    def _begins_at(self, place: Array) -> None:
        """The reference begins at a place: from outside of the fence it comes back without a jump."""
        self._outside = self._fence is not None and self._fence.room(place) < 0.0

    def reference(self, time_ns: int) -> Reference:
        """The generator's; on a course only its altitude and heading."""
        reference = self._generator.at(time_ns)
        if self._course.active:
            reference = self._course.put(time_ns, reference)
        if self._fence is not None and not self._outside:
            self._fence.keep(reference.rows)
        return reference

    # -- along a leg ---------------------------------------------------------------------------------------------------

    def steer(self, leg: Leg, state: VehicleState, now_ns: int) -> MotionReport:
        """Move the reference along the leg, which has a target."""
        generator, step = self._generator, leg.step
        if self._outside:  # until the reference of now is inside: those that are asked for are of later times
            self._begins_at(self.reference(now_ns).position_ned)
        following, over_map = generator.following, False
        if self._jumps and step.phase is not Phase.TAKEOFF:
            assert step.target_ned is not None
            generator.hold_at(step.target_ned)
        elif not following:
            if self.over_map and step.avoids and not self._arrives(step, state):
                over_map = self._steer_over_map(leg, state, now_ns)
            else:
                self._leave_course(now_ns)
                if step.phase is Phase.TAKEOFF:
                    generator.rise_with(now_ns, state.position_ned, state.velocity_ned)
                if not _stops_first(generator, step, now_ns):
                    self._move_straight(leg, state, now_ns)
        track = None if following else self._track_to_join(leg)
        start_ned = None if track is None else track.start_ned
        return MotionReport(following, generator.at_rest(now_ns), start_ned, over_map)

    def arrive(self, arrival: Arrival, leg: Leg, now_ns: int) -> None:
        """Join the track at whose start the vehicle is at rest, or leave the one that has been flown."""
        if arrival is Arrival.AT_TRACK:
            track = self._track_to_join(leg)
            assert track is not None
            self._generator.follow(now_ns, track)
        elif arrival is Arrival.DONE and self._generator.following:
            self._generator.end_track(now_ns)

    def _track_to_join(self, leg: Leg) -> Track | None:
        """The step's, from its beginning or, after a hold, from where it was left."""
        step = leg.step
        track = None if step.curve is None else self._tracks[leg.index]
        if track is None or self._rest_of_track is not None:
            return self._rest_of_track
        assert step.target_ned is not None
        return track.shifted(step.target_ned)

    def _move_straight(self, leg: Leg, state: VehicleState, now_ns: int) -> None:
        """By the generator, to the leg's target, to the start of its track or where the method says."""
        step, settings, generator = leg.step, self._settings.trajectory, self._generator
        assert step.target_ned is not None
        track, target, speed = self._track_to_join(leg), step.target_ned, leg.speed
        if track is not None:
            target = track.start_ned
            if track.start_yaw is not None:
                generator.turn_to(now_ns, track.start_yaw)
        if step.avoids and not self.over_map:
            if self._settings.avoidance.needs_scan:  # without, there may be none, and no decision for this leg
                target, speed = self.decision.target_ned, min(speed, self.decision.speed_limit)
            way = target - state.position_ned
            if math.hypot(way[0], way[1]) > _TURN_M:
                generator.turn_to(now_ns, math.atan2(way[1], way[0]))
        if step.yaw is not None:
            generator.turn_to(now_ns, step.yaw)
        target = _at_height(target, leg, state.position_ned)
        if self._fence is not None:
            target = self._fence.nearest(target)
        climbs = target[2] < state.position_ned[2]
        generator.move_to(now_ns, target, speed, settings.climb_speed if climbs else settings.descent_speed)

    def _arrives(self, step: Step, state: VehicleState) -> bool:
        """So near to a goal that is stopped at and led to that no way over the map is needed; nearer with something in
        the way."""
        assert step.target_ned is not None
        here, target, active = state.position_ned[:2], step.target_ned[:2], self._course.active
        reach = _APPROACH_M if active or self.decision.blocked else NEAR_M
        near = not step.passes and math.dist(target.tolist(), here.tolist()) < reach
        slow = near and (not active or math.hypot(*state.velocity_ned[:2].tolist()) < _APPROACH_SPEED)
        return slow and approached(self._path, here, target, self._settings.avoidance) is target

    # -- over the map --------------------------------------------------------------------------------------------------

    def _steer_over_map(self, leg: Leg, state: VehicleState, now_ns: int) -> bool:
        """Move the course along the way; whether the way was looked at anew."""
        if not self._course.active:
            base = self._generator.at(now_ns)
            self._course.start(now_ns, base.position_ned, base.velocity_ned, base.acceleration_ned)
            self._course_start_ned = base.position_ned[:2].tolist()
            self._steer_at_ns = now_ns
        looks = now_ns >= self._steer_at_ns
        if looks:
            self._steer_at_ns = now_ns + _STEER_EVERY_NS
            self._wanted = self._motion_over_map(leg, state, now_ns)
        self._course.advance(now_ns, *self._wanted, state.position_ned[:2])
        return looks

    def _motion_over_map(self, leg: Leg, state: VehicleState, now_ns: int) -> tuple[Array, Array]:
        """Velocity (2,) (m/s) that is wanted of the course, no faster than it can stop within what was seen free, and
        the acceleration (2,) (m/s2) by which it changes; heading and altitude follow."""
        assert self._guard is not None
        settings, generator, goal = self._settings.avoidance, self._generator, leg.goal_ned
        here, velocity = state.position_ned, state.velocity_ned
        steering = steer(self._path, here[:2], velocity[:2], goal[:2], leg.speed, settings)
        wanted, onward, speed = steering.velocity, steering.acceleration, math.hypot(*steering.velocity.tolist())
        if leg.waits:
            wanted, onward, speed = np.zeros(2), np.zeros(2), 0.0
        limit = self._guard.limit(here, velocity, steering.path, speed)
        self.free_distance = limit.free
        if speed > limit.speed:
            wanted = wanted * (limit.speed / speed)
        if self._fence is not None:
            wanted = self._fence.slowed(here, wanted)
        if speed > _TURN_SPEED:
            generator.turn_to(now_ns, math.atan2(steering.velocity[1], steering.velocity[0]))
        down = float(goal[2])
        climbs, trajectory = down < generator.at(now_ns).position_ned[2], self._settings.trajectory
        vertical_speed = trajectory.climb_speed if climbs else trajectory.descent_speed
        generator.move_to(now_ns, np.array((*self._course_start_ned, down)), self._mission.speed, vertical_speed)
        target = np.array((*steering.path[0].tolist(), down))
        self.decision = AvoidanceDecision(target, limit.speed, self.decision.clearance, self.decision.blocked)
        return wanted, onward

    def _leave_course(self, now_ns: int) -> None:
        """The generator takes the course's motion over, and brakes."""
        if not self._course.active:
            return
        motion = self.reference(now_ns)
        self._course.stop()
        self.free_distance = math.inf
        braking = self._settings.avoidance.guard.braking
        self._generator.brake_from(now_ns, motion.position_ned, motion.velocity_ned, motion.acceleration_ned, braking)

    def take_up(self, result: PlanResult, leg: Leg, now_ns: int) -> None:
        """What the map shows free counts for the guard from now on, and the planner's way is flown along."""
        assert self._guard is not None
        self._guard.look(result.space)
        self._mapped_ns = result.asked_ns
        if not self.over_map:
            return
        self._path = result.path
        self._steer_at_ns = now_ns
        avoids, before = leg.step.avoids, self.decision
        limit, target = (before.speed_limit, before.target_ned) if avoids else (self._mission.speed, leg.goal_ned)
        self.decision = AvoidanceDecision(target, limit, result.clearance, result.blocked)

    # -- by returns, and what the guard makes of it --------------------------------------------------------------------

    def look(
        self, scan: Scan, pose: Pose, ground_down: float, state: VehicleState, leg: Leg, now_ns: int
    ) -> PlanRequest | None:
        """A scan goes to the method that steers by its returns; and what is to be asked of map and planner about it.

        `pose`: position (3,) and attitude (4,) of the scan; what it shows below `ground_down` (m, NED) is the ground.
        """
        motion = place, velocity = state.position_ned, state.velocity_ned
        if not self.over_map:
            points = self._returns.add(obstacle_points(scan, *pose, ground_down), now_ns)
            self.decision = self.method.decide(points, place, velocity, leg.goal_ned, leg.speed)
        if self._guard is None:
            return None
        self._guard.view_ahead.look(pose[1], velocity[:2], ground_down - float(pose[0][2]), now_ns)
        self._asked, self._mapped_ns = self._asked + 1, self._mapped_ns or now_ns
        goal = leg.goal_ned if self.over_map and leg.step.avoids else None
        flat = None if self._walls is None else self._walls.around(place)
        asked = self._asked, now_ns, scan, pose, ground_down, *motion, goal, leg.speed, flat, leg.in_the_way
        return PlanRequest(*asked, self.margin.follow(state.certainty.velocity_variance))

    def map_age(self, now_ns: int) -> float:
        """Age (s) of the scan that is the latest in the guard's map; before the first, since that was asked for."""
        return 0.0 if self._mapped_ns is None else (now_ns - self._mapped_ns) * 1e-9

    def guarded(self, wanted: Array, state: VehicleState, step: Step, now_ns: int, *, held: bool) -> Verdict | None:
        """What the guard makes of an acceleration (3,): on a vertical step, and `held`, it only evades what moves; on
        tracks and where the reference jumps it has no say."""
        only = held or not step.avoids
        if self._guard is None or not self._guarded or (self._generator.following and only):
            return None
        return self._guard.filter(state.position_ned, state.velocity_ned, wanted, now_ns, evades_only=only)

    def yield_to(self, verdict: Verdict, state: VehicleState, now_ns: int) -> None:
        """Where the guard changes much of what the reference asks for, the reference gives in, or it would wind up."""
        if verdict.changed <= self._settings.avoidance.course.yield_threshold:
            return
        here, velocity = state.position_ned[:2], state.velocity_ned[:2]
        allowed = limited(verdict.acceleration_ned[:2], self._settings.avoidance.course.max_yield)
        if self._course.active:
            self._course.yield_to(here, velocity, allowed)
            return
        rest = self.reference(now_ns).rows[:3, 2:]  # of now: of when a command takes effect, it would run ahead
        self._generator.brake_from(now_ns, *np.hstack(([here, velocity, allowed], rest)))


def _at_height(target: Array, leg: Leg, here: Array) -> Array:
    """A target (3,) of a leg at the height that is flown; near to where the vehicle stops, at the step's own."""
    step, goal = leg.step, leg.goal_ned
    if not step.avoids or step.target_ned is None or goal is step.target_ned:  # almost always
        return target
    far = step.passes or math.dist(goal[:2].tolist(), here[:2].tolist()) > NEAR_M
    return np.array((target[0], target[1], (goal if far else step.target_ned)[2]))


def _stops_first(generator: ReferenceGenerator, step: Step, now_ns: int) -> bool:
    """Where the guard does not brake, what brakes goes on until it is slow: the way over the map was as fast as it can
    stop with the guard's braking, which is harder than the generator turns round."""
    if step.avoids or step.phase is Phase.TAKEOFF or not generator.brakes:
        return False
    return math.hypot(*generator.at(now_ns).velocity_ned[:2].tolist()) > _APPROACH_SPEED


def _leaves(settings: Geofence, own: OwnFence, places: Iterable[tuple[str, Array]]) -> str | None:
    """The first of the places beyond the fence, in words."""
    fence = fence_of(settings, np.zeros(3), own, floor=True)
    return None if fence is None else first_beyond(fence.shrunk(settings.margin), places)


def _places(mission: Mission, tracks: Sequence[Track | None]) -> Iterator[tuple[str, Array]]:
    """What the mission does where (3,) (m, NED from its start), along its tracks too."""
    for step, track in zip(steps(mission, np.zeros(3)), tracks, strict=True):
        if step.target_ned is None:
            continue
        yield step.phase.name.lower(), step.target_ned
        if track is not None:
            for time in np.linspace(0.0, track.duration_s, _SAMPLES).tolist():
                yield step.phase.name.lower(), track.at(time)[0] + step.target_ned


def _target_of(leg: Leg) -> Array:
    """The step's own, whatever the altitude that is flown."""
    return leg.goal_ned if leg.step.target_ned is None else leg.step.target_ned
