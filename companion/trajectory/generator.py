"""The reference generator: jerk-limited motion to a target that may move at any time (ruckig), tracks, and steps of the
position as the paper's tests use them.

The motion waits for a vehicle that does not keep up with it, as that of PX4's trajectory generator does
(MPC_XY_ERR_MAX): its time passes the slower the farther away the vehicle is. It leads through the same places, later.
"""

import math

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Synchronization
from ruckig import Trajectory as Profile

from companion.config import Trajectory as TrajectorySettings
from companion.state import Reference
from companion.trajectory.track import Track
from protocol.arrays import Array
from protocol.frames import wrap

_LEAST_SPEED = 0.05
"""Least limit on the speed (m/s): ruckig needs one above 0."""
_DIFFERENCE_S = 1e-5
"""Step of the difference quotient that gives the jerk."""
_ACCELERATION_TOLERANCE = 1e-6
"""m/s2 by which an acceleration may be above its limit through rounding."""
_SAME = 0.02
"""A target that differs from the present one by less than this share of the distance to it is the same target. A speed
that differs by less than this share is the same speed."""
_UNWINDING_S = 0.25
"""Time in which braking may reduce the present acceleration to zero."""
_LEAST_SHARE = 0.35
"""Share of the speed that each horizontal axis keeps where the motion is along the other one, so that it can turn."""
_LEAVING_M = 0.3
"""m above where the reference stood: up to there a vehicle leaves the ground."""
_WAITS_FROM = 0.5
"""Share of the greatest lead up to which the motion does not wait."""


_Moment = tuple[list[float], list[float], list[float]]
"""Position, velocity and acceleration of some axes."""


class _Motion:
    """A motion of some axes: at rest, or along the profile that was calculated last."""

    def __init__(self, axes: int) -> None:
        self._axes = axes
        self._generator = Ruckig(axes)
        self._start_ns = 0
        self._profile: Profile | None = None
        self.end: _Moment | None = None
        """What `at` returns at rest: without a profile always, with one after its end."""
        self.hold_at([0.0] * axes)

    def hold_at(self, position: list[float]) -> None:
        """Rest at a position from now on."""
        self._profile = None
        zero = [0.0] * self._axes
        self.end = position, zero, zero

    def at(self, time_ns: int) -> _Moment:
        """Position, velocity and acceleration; the same object as long as the motion rests."""
        if self._profile is not None:
            time_s = (time_ns - self._start_ns) * 1e-9
            if time_s < self._profile.duration or self.end is None:
                position, velocity, acceleration = self._profile.at_time(time_s)
                moment = position, velocity, acceleration
                if time_s < self._profile.duration:
                    return moment
                self.end = moment
        assert self.end is not None
        return self.end

    def jerk(self, time_ns: int, acceleration: list[float]) -> list[float]:
        """The jerk, which is constant between the profile's corners. `acceleration` is that of `at` for the same
        time."""
        if self._profile is None or self.ended(time_ns):
            return [0.0] * self._axes
        after = self._profile.at_time((time_ns - self._start_ns) * 1e-9 + _DIFFERENCE_S)[2]
        return [(late - early) / _DIFFERENCE_S for early, late in zip(acceleration, after, strict=True)]

    def ended(self, time_ns: int) -> bool:
        """The motion is at rest from that time on."""
        return self._profile is None or (time_ns - self._start_ns) * 1e-9 >= self._profile.duration

    def replan(self, inputs: InputParameter, time_ns: int) -> bool:
        """Replace the motion from a time on. Without a solution the old one continues to its end, which is a
        standstill, and the result is False."""
        profile = Profile(self._axes)
        try:
            if self._generator.calculate(inputs, profile) not in (Result.Working, Result.Finished):
                return False
        except (ValueError, RuckigError):  # ValueError: a result that ruckig's Python binding does not know
            return False
        self._profile = profile
        self._start_ns = time_ns
        self.end = None
        return True


class _MotionTime:
    """The time of the motion, which passes at most as fast as the companion's."""

    def __init__(self) -> None:
        self.share = 1.0
        """How fast it passes, of the companion's."""
        self._since_ns = 0
        self._behind_ns = 0
        """By which it was behind the companion's then."""

    def at(self, time_ns: int) -> int:
        """It (ns) at a time of the companion's."""
        waits = 0 if self.share == 1.0 else round((1.0 - self.share) * (time_ns - self._since_ns))
        return time_ns - self._behind_ns - waits

    def go_on(self, time_ns: int, share: float) -> None:
        """It passes so fast from now on."""
        self._behind_ns, self._since_ns, self.share = time_ns - self.at(time_ns), time_ns, share


def _present(reference: Reference) -> InputParameter:
    """Inputs of a calculation that starts from a motion."""
    inputs = InputParameter(3)
    inputs.current_position = reference.position_ned.tolist()
    inputs.current_velocity = reference.velocity_ned.tolist()
    inputs.current_acceleration = reference.acceleration_ned.tolist()
    return inputs


def _braking(inputs: InputParameter, acceleration: float, jerk: float) -> InputParameter:
    """Brake to a standstill at any position, within limits on acceleration (m/s2) and jerk (m/s3), which grow to what
    the present motion needs."""
    axes = len(inputs.current_position)
    present = math.hypot(*inputs.current_acceleration)
    acceleration, jerk = max(acceleration, present), max(jerk, present / _UNWINDING_S)
    inputs.control_interface = ControlInterface.Velocity
    inputs.target_velocity = [0.0] * axes
    inputs.max_acceleration = [acceleration] * axes
    inputs.max_jerk = [jerk] * axes
    return inputs


class ReferenceGenerator:
    """Generates the reference. All times are the companion's (ns), positions NED (m)."""

    def __init__(self, settings: TrajectorySettings) -> None:
        self._settings = settings
        self._translation = _Motion(3)
        self._heading = _Motion(1)
        self._stood_down = 0.0
        """m; where the reference was held last."""
        self._goal: tuple[float, ...] | None = None
        self._yaw_goal: float | None = 0.0
        self._track: Track | None = None
        self._track_ns = 0
        """The motion's time at its beginning."""
        self._time = _MotionTime()
        self._rest: tuple[_Moment | None, _Moment | None, Array] = None, None, np.zeros((6, 3))
        """Translation, heading and the reference's rows from when both rested last."""

    def keep_pace(self, time_ns: int, lead: float) -> float:
        """Go on as fast as a lead (m) over the vehicle allows: the share of the speed that was asked for. Who brakes
        waits for nobody."""
        share = min(1.0, max(0.0, (1.0 - lead / self._settings.max_lead) / (1.0 - _WAITS_FROM)))
        share = 1.0 if self.brakes else share
        if share != self._time.share:
            self._time.go_on(time_ns, share)
        return share

    def hold_at(self, position_ned: Array, yaw: float | None = None) -> None:
        """Hold at a position (3,) from now on: a step of the reference. The heading stays unless `yaw` (rad) is
        given."""
        self._translation.hold_at(position_ned.tolist())
        self._stood_down = float(position_ned[2])
        self._goal = None
        self._track = None
        if yaw is not None:
            self._heading.hold_at([yaw])
            self._yaw_goal = yaw

    def move_to(self, time_ns: int, target_ned: Array, speed: float, vertical_speed: float) -> None:
        """Move from the present motion to a stop at the target (3,), straight if the motion allows it, at about `speed`
        (m/s), vertically at most at `vertical_speed` (m/s)."""
        goal = (*target_ned.tolist(), speed, vertical_speed)
        if goal == self._goal or self._moves_to(goal, time_ns):
            return
        inputs = _present(self._at(time_ns))
        if max(map(abs, inputs.current_acceleration)) > self._settings.acceleration + _ACCELERATION_TOLERANCE:
            # The acceleration on a track may be above the limit of this motion: brake until it is not.
            self.brake(time_ns)
            return
        offset = target_ned - np.array(inputs.current_position)
        distance = math.hypot(*offset.tolist())
        # Each axis gets its share of the speed, so that the whole velocity keeps to the limit; each may brake fully.
        share = np.maximum(np.abs(offset) / distance, _LEAST_SHARE) if distance > 1e-6 else np.ones(3)
        limits = max(speed, _LEAST_SPEED) * share
        limits[2] = max(min(vertical_speed, speed), _LEAST_SPEED)
        inputs.target_position = target_ned.tolist()
        inputs.max_velocity = limits.tolist()
        inputs.max_acceleration = [self._settings.acceleration] * 3
        inputs.max_jerk = [self._settings.jerk] * 3
        inputs.synchronization = Synchronization.Phase
        if not self._change(inputs, time_ns, goal):
            inputs.synchronization = Synchronization.Time
            self._change(inputs, time_ns, goal)

    def _moves_to(self, goal: tuple[float, ...], time_ns: int) -> bool:
        """The motion leads to almost the same goal: a new one would only turn the vehicle again and again."""
        if not self._goal:
            return False
        *target, speed, vertical_speed = self._goal
        position, _, _ = self._translation.at(self._time.at(time_ns))
        near = math.dist(target, goal[:3]) < _SAME * math.dist(target, position)
        return near and abs(goal[3] - speed) < _SAME * speed and goal[4] == vertical_speed

    def brake(self, time_ns: int) -> None:
        """Brake to a standstill at any position. Out of a track, braking may be as hard as the track was."""
        if self._track is None and (self._goal is None or self.brakes):
            return
        inputs = _braking(_present(self.at(time_ns)), self._settings.acceleration, 2.0 * self._settings.jerk)
        self._change(inputs, time_ns, ())

    def brake_from(
        self, time_ns: int, position_ned: Array, velocity_ned: Array, acceleration_ned: Array, braking: float = 0.0
    ) -> None:
        """Take over a given motion ((3,) each; m, m/s, m/s2) and brake to a standstill, with the acceleration of the
        settings or `braking` (m/s2), whichever is more."""
        inputs = InputParameter(3)
        inputs.current_position = position_ned.tolist()
        inputs.current_velocity = velocity_ned.tolist()
        inputs.current_acceleration = acceleration_ned.tolist()
        acceleration = max(self._settings.acceleration, braking)
        self._change(_braking(inputs, acceleration, 2.0 * self._settings.jerk), time_ns, ())

    def rise_with(self, time_ns: int, position_ned: Array, velocity_ned: Array) -> None:
        """Go along with a vehicle ((3,) each; m, m/s) that leaves the ground faster than the reference: how it got
        loose was not commanded, and the estimate of its speed may have lagged."""
        here = self.at(time_ns)
        if self._stood_down - position_ned[2] < _LEAVING_M and velocity_ned[2] < here.velocity_ned[2]:
            self.brake_from(time_ns, position_ned, velocity_ned, here.acceleration_ned)

    def turn_to(self, time_ns: int, yaw: float) -> None:
        """Turn to a heading (rad) the shorter way."""
        if self._yaw_goal is None and not self._heading.ended(time_ns):
            return  # the heading still brakes after a track
        if self._yaw_goal is not None and abs(wrap(yaw - self._yaw_goal)) < 1e-3:
            return
        inputs = self._present_heading(time_ns)
        present = inputs.current_position[0]
        inputs.target_position = [present + wrap(yaw - present)]
        inputs.max_velocity = [math.radians(self._settings.yaw_rate_deg)]
        inputs.max_acceleration = [math.radians(self._settings.yaw_acceleration_deg)]
        inputs.max_jerk = [10.0 * math.radians(self._settings.yaw_acceleration_deg)]
        if self._heading.replan(inputs, time_ns):
            self._yaw_goal = yaw

    def follow(self, time_ns: int, track: Track) -> None:
        """Fly a track from its beginning, where the reference should be at rest."""
        self._track = track
        self._track_ns = self._time.at(time_ns)
        self._goal = None

    def end_track(self, time_ns: int) -> None:
        """Hold at the place that the track has led to."""
        end = self.at(time_ns)
        along = self._track is not None and self._track.along
        self.hold_at(end.position_ned, end.yaw if along else None)

    @property
    def following(self) -> bool:
        """A track is followed, not a target."""
        return self._track is not None

    @property
    def brakes(self) -> bool:
        """The motion leads, or has led, to a standstill at any position."""
        return self._goal == ()

    def remaining_track(self, time_ns: int) -> Track | None:
        """The rest of the track that is followed; None if there is none."""
        return None if self._track is None else self._track.resumed_at(self._along_track_s(time_ns))

    def at_rest(self, time_ns: int) -> bool:
        """The reference does not move from that time on."""
        if self._track is not None:
            return self._along_track_s(time_ns) >= self._track.duration_s
        return self._translation.ended(self._time.at(time_ns)) and self._heading.ended(time_ns)

    def at(self, time_ns: int) -> Reference:
        """The reference at a time, which is not before that of the last change."""
        reference, share = self._at(time_ns), self._time.share
        if share != 1.0:
            reference.rows[1:5] *= np.array((share, share**2, share**3, share**4))[:, None]
            if self._track is not None and self._track.along:
                reference.rows[5] *= (1.0, share, share**2)
        return reference

    def _along_track_s(self, time_ns: int) -> float:
        return (self._time.at(time_ns) - self._track_ns) * 1e-9

    def _at(self, time_ns: int) -> Reference:
        """Where the motion is then, and how it goes on if it does not wait."""
        track = self._track
        if track is not None:
            rows = track.at(self._along_track_s(time_ns))
            if not track.along:
                rows[5] = self._heading_at(time_ns)
            return Reference(rows)
        moment_ns = self._time.at(time_ns)
        motion, turning = self._translation.at(moment_ns), self._heading.at(time_ns)
        rested_motion, rested_heading, rows = self._rest
        if motion is rested_motion and turning is rested_heading:
            return Reference(rows.copy())
        (position, velocity, acceleration), ((yaw,), (rate,), (yaw_acceleration,)) = motion, turning
        jerk = self._translation.jerk(moment_ns, acceleration)
        rows = np.array((*position, *velocity, *acceleration, *jerk, 0.0, 0.0, 0.0, yaw, rate, yaw_acceleration))
        rows = rows.reshape(6, 3)
        if motion is self._translation.end and turning is self._heading.end:
            self._rest = motion, turning, rows.copy()
        return Reference(rows)

    def _heading_at(self, time_ns: int) -> tuple[float, float, float]:
        yaw, rate, acceleration = self._heading.at(time_ns)
        return yaw[0], rate[0], acceleration[0]

    def _present_heading(self, time_ns: int) -> InputParameter:
        present = self.at(time_ns)
        inputs = InputParameter(1)
        inputs.current_position = [present.yaw]
        inputs.current_velocity = [present.yaw_rate]
        inputs.current_acceleration = [present.yaw_acceleration]
        return inputs

    def _change(self, inputs: InputParameter, time_ns: int, goal: tuple[float, ...]) -> bool:
        """Replace the motion, and leave the track if there was one; False without a solution."""
        heading = self._present_heading(time_ns)
        if not self._translation.replan(inputs, self._time.at(time_ns)):
            return False
        if not goal:  # it brakes from the motion as it was, however slow
            self._time.go_on(time_ns, 1.0)
        self._goal = goal
        track, self._track = self._track, None
        if track is not None and track.along:
            acceleration = math.radians(self._settings.yaw_acceleration_deg)
            self._heading.replan(_braking(heading, acceleration, 10.0 * acceleration), time_ns)
            self._yaw_goal = None
        return True
