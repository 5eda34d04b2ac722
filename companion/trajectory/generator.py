"""References: jerk-limited motion to a target that may move at any time (ruckig), tracks, and steps as the paper's
tests use them."""

import math

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Synchronization
from ruckig import Trajectory as Profile

from companion.config import Trajectory as TrajectorySettings
from companion.state import Reference
from companion.trajectory.track import Track
from protocol.arrays import Array
from protocol.frames import wrap

_SLOWEST = 0.05
_INSTANT_S = 1e-5
_CLOSE = 1e-6
_SAME = 0.02
"""Targets that differ by less than this share of the way to them are one; so are speeds."""
_UNWINDING_S = 0.25
"""In which braking may take back the present acceleration."""
_LEAST_SHARE = 0.35
"""Of the speed that each horizontal axis keeps when the way is along the other: room to turn."""


_Moment = tuple[list[float], list[float], list[float]]
"""Position, velocity, acceleration of some axes."""


class _Motion:
    """A motion of some axes: at rest, or along the profile that was calculated last."""

    def __init__(self, axes: int) -> None:
        self._axes = axes
        self._generator = Ruckig(axes)
        self._start_ns = 0
        self._profile: Profile | None = None
        self.end: _Moment | None = None
        """What `at` gives at rest: without a profile, or from its end on once that was asked for."""
        self.rest([0.0] * axes)

    def rest(self, place: list[float]) -> None:
        self._profile = None
        zero = [0.0] * self._axes
        self.end = place, zero, zero

    def at(self, time_ns: int) -> _Moment:
        """Position, velocity, acceleration; the same object as long as it rests."""
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
        """It is constant between the profile's corners; from the acceleration then, which `at` gives."""
        if self._profile is None or self.ended(time_ns):
            return [0.0] * self._axes
        after = self._profile.at_time((time_ns - self._start_ns) * 1e-9 + _INSTANT_S)[2]
        return [(late - early) / _INSTANT_S for early, late in zip(acceleration, after, strict=True)]

    def ended(self, time_ns: int) -> bool:
        """It is at rest from then on."""
        return self._profile is None or (time_ns - self._start_ns) * 1e-9 >= self._profile.duration

    def follow(self, inputs: InputParameter, time_ns: int) -> bool:
        """Replace the motion; where there is no solution the old one goes on to its own end, a standstill."""
        profile = Profile(self._axes)
        try:
            if self._generator.calculate(inputs, profile) not in (Result.Working, Result.Finished):
                return False
        except (ValueError, RuckigError):  # of the errors that ruckig has, its Python binding does not know all
            return False
        self._profile = profile
        self._start_ns = time_ns
        self.end = None
        return True


def _braking(inputs: InputParameter, acceleration: float, jerk: float) -> InputParameter:
    """To a standstill, wherever that is; within these limits or those of the present motion."""
    axes = len(inputs.current_position)
    present = math.hypot(*inputs.current_acceleration)
    acceleration, jerk = max(acceleration, present), max(jerk, present / _UNWINDING_S)
    inputs.control_interface = ControlInterface.Velocity
    inputs.target_velocity = [0.0] * axes
    inputs.max_acceleration = [acceleration] * axes
    inputs.max_jerk = [jerk] * axes
    return inputs


class ReferenceGenerator:
    """The reference and its motion. All times are the companion's, ns; positions NED (m)."""

    def __init__(self, settings: TrajectorySettings) -> None:
        self._settings = settings
        self._translation = _Motion(3)
        self._heading = _Motion(1)
        self._goal: tuple[float, ...] | None = None
        self._yaw_goal: float | None = 0.0
        self._track: Track | None = None
        self._track_ns = 0
        self._rest: tuple[_Moment | None, _Moment | None, Array] = None, None, np.zeros((6, 3))
        """Translation, heading and the reference's rows where both rested last."""

    def place(self, position_ned: Array, yaw: float | None = None) -> None:
        """Stand there from now on: a step of the reference. The heading stays unless it is given."""
        self._translation.rest(position_ned.tolist())
        self._goal = None
        self._track = None
        if yaw is not None:
            self._heading.rest([yaw])
            self._yaw_goal = yaw

    def go(self, time_ns: int, target_ned: Array, speed: float, vertical_speed: float) -> None:
        """From the present motion to a stop at the target, straight if the motion allows it, about as fast as
        `speed`."""
        goal = (*target_ned.tolist(), speed, vertical_speed)
        if goal == self._goal or self._flies_there(goal, time_ns):
            return
        inputs = self._present(time_ns)
        if max(map(abs, inputs.current_acceleration)) > self._settings.acceleration + _CLOSE:
            self.stop(time_ns)  # out of a track that is harder than this motion may be; until it is not any more
            return
        offset = target_ned - np.array(inputs.current_position)
        distance = math.hypot(*offset.tolist())
        # Each axis has its share of the speed, so that the velocity as a whole keeps to the limit; all may brake fully.
        share = np.maximum(np.abs(offset) / distance, _LEAST_SHARE) if distance > 1e-6 else np.ones(3)
        limits = max(speed, _SLOWEST) * share
        limits[2] = max(min(vertical_speed, speed), _SLOWEST)
        inputs.target_position = target_ned.tolist()
        inputs.max_velocity = limits.tolist()
        inputs.max_acceleration = [self._settings.acceleration] * 3
        inputs.max_jerk = [self._settings.jerk] * 3
        inputs.synchronization = Synchronization.Phase
        if not self._change(inputs, time_ns, goal):
            inputs.synchronization = Synchronization.Time
            self._change(inputs, time_ns, goal)

    def _flies_there(self, goal: tuple[float, ...], time_ns: int) -> bool:
        """The motion is to almost the same target: another one would turn the vehicle again and again for nothing."""
        if not self._goal:
            return False
        *target, speed, vertical_speed = self._goal
        here, _, _ = self._translation.at(time_ns)
        near = math.dist(target, goal[:3]) < _SAME * math.dist(target, here)
        return near and abs(goal[3] - speed) < _SAME * speed and goal[4] == vertical_speed

    def stop(self, time_ns: int) -> None:
        """Brake to a standstill, wherever that is. What a track asks of the vehicle, braking may ask as well."""
        if self._track is None and (self._goal is None or self._goal == ()):
            return
        inputs = _braking(self._present(time_ns), self._settings.acceleration, 2.0 * self._settings.jerk)
        self._change(inputs, time_ns, ())

    def carry_on(
        self, time_ns: int, position_ned: Array, velocity_ned: Array, acceleration_ned: Array, braking: float = 0.0
    ) -> None:
        """From another motion than its own, and brake to a standstill, with `braking` (m/s2) if that is harder than
        the settings have it."""
        inputs = InputParameter(3)
        inputs.current_position = position_ned.tolist()
        inputs.current_velocity = velocity_ned.tolist()
        inputs.current_acceleration = acceleration_ned.tolist()
        acceleration = max(self._settings.acceleration, braking)
        self._change(_braking(inputs, acceleration, 2.0 * self._settings.jerk), time_ns, ())

    def turn(self, time_ns: int, yaw: float) -> None:
        """Turn to a heading (rad) the shorter way."""
        if self._yaw_goal is None and not self._heading.ended(time_ns):
            return  # it still brakes
        if self._yaw_goal is not None and abs(wrap(yaw - self._yaw_goal)) < 1e-3:
            return
        inputs = self._present_heading(time_ns)
        present = inputs.current_position[0]
        inputs.target_position = [present + wrap(yaw - present)]
        inputs.max_velocity = [math.radians(self._settings.yaw_rate_deg)]
        inputs.max_acceleration = [math.radians(self._settings.yaw_acceleration_deg)]
        inputs.max_jerk = [10.0 * math.radians(self._settings.yaw_acceleration_deg)]
        if self._heading.follow(inputs, time_ns):
            self._yaw_goal = yaw

    def follow(self, time_ns: int, track: Track) -> None:
        """Fly a track from its beginning, which is where the reference should be at rest."""
        self._track = track
        self._track_ns = time_ns
        self._goal = None

    def leave(self, time_ns: int) -> None:
        """Rest at the end of the track that has been followed."""
        end = self.at(time_ns)
        along = self._track is not None and self._track.along
        self.place(end.position_ned, end.yaw if along else None)

    @property
    def following(self) -> bool:
        """A track, and no target."""
        return self._track is not None

    def remaining(self, time_ns: int) -> Track | None:
        """What is left of the track that is being followed."""
        return None if self._track is None else self._track.after((time_ns - self._track_ns) * 1e-9)

    def rests(self, time_ns: int) -> bool:
        """Nothing moves from then on."""
        if self._track is not None:
            return (time_ns - self._track_ns) * 1e-9 >= self._track.duration_s
        return self._translation.ended(time_ns) and self._heading.ended(time_ns)

    def at(self, time_ns: int) -> Reference:
        """The reference at a time not before the last change."""
        track = self._track
        if track is not None:
            rows = track.at((time_ns - self._track_ns) * 1e-9)
            if not track.along:
                rows[5] = self._heading_at(time_ns)
            return Reference(rows)
        motion, turning = self._translation.at(time_ns), self._heading.at(time_ns)
        resting, still, rows = self._rest
        if motion is resting and turning is still:
            return Reference(rows.copy())
        (position, velocity, acceleration), ((yaw,), (rate,), (yawing,)) = motion, turning
        jerk = self._translation.jerk(time_ns, acceleration)
        rows = np.array((*position, *velocity, *acceleration, *jerk, 0.0, 0.0, 0.0, yaw, rate, yawing)).reshape(6, 3)
        if motion is self._translation.end and turning is self._heading.end:
            self._rest = motion, turning, rows.copy()
        return Reference(rows)

    def _heading_at(self, time_ns: int) -> tuple[float, float, float]:
        yaw, rate, acceleration = self._heading.at(time_ns)
        return yaw[0], rate[0], acceleration[0]

    def _present(self, time_ns: int) -> InputParameter:
        """A calculation that starts from the present motion."""
        present = self.at(time_ns)
        inputs = InputParameter(3)
        inputs.current_position = present.position_ned.tolist()
        inputs.current_velocity = present.velocity_ned.tolist()
        inputs.current_acceleration = present.acceleration_ned.tolist()
        return inputs

    def _present_heading(self, time_ns: int) -> InputParameter:
        present = self.at(time_ns)
        inputs = InputParameter(1)
        inputs.current_position = [present.yaw]
        inputs.current_velocity = [present.yaw_rate]
        inputs.current_acceleration = [present.yaw_acceleration]
        return inputs

    def _change(self, inputs: InputParameter, time_ns: int, goal: tuple[float, ...]) -> bool:
        """Take up another motion if there is one, and leave the track if there was one."""
        heading = self._present_heading(time_ns)
        if not self._translation.follow(inputs, time_ns):
            return False
        self._goal = goal
        track, self._track = self._track, None
        if track is not None and track.along:
            acceleration = math.radians(self._settings.yaw_acceleration_deg)
            self._heading.follow(_braking(heading, acceleration, 10.0 * acceleration), time_ns)
            self._yaw_goal = None
        return True
