"""Paths to estimate along, motions without a vehicle; and the sensors to do it with."""

import math
from collections.abc import Iterator

import numpy as np

from protocol.arrays import Array
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import airframe_with
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.settings import SensorSettings
from vehicle_sim.timing import TICK_NS

_WIDTH_M, _PERIOD_S, _YAW_RATE = 8.0, 10.0, 0.3
_STEP_S = 1e-3
"""Step (s) of differences."""


def _lemniscate(time_s: float) -> Array:
    """A lemniscate of 5 m/s on average."""
    phase = 2.0 * math.pi * time_s / _PERIOD_S
    return np.array((_WIDTH_M * math.sin(phase), _WIDTH_M * math.sin(phase) * math.cos(phase), -3.0))


def _attitude(acceleration_ned: Array, yaw: float) -> tuple[float, float, float, float]:
    """The attitude of a body whose thrust gives the acceleration, with its nose to `yaw`."""
    down = np.array((0.0, 0.0, GRAVITY)) - acceleration_ned
    down /= np.linalg.norm(down)
    right = np.cross(down, (math.cos(yaw), math.sin(yaw), 0.0))
    right /= np.linalg.norm(right)
    R = np.array((np.cross(right, down), right, down)).T
    K = np.array(  # its eigenvector of 1 is the quaternion: I. Bar-Itzhack, J. Guidance 23(6), 2000
        (
            (R.trace(), R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]),
            (R[2, 1] - R[1, 2], R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]),
            (R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1]),
            (R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1]),
        )
    )
    q0, q1, q2, q3 = np.linalg.eigh(K)[1][:, 3].tolist()
    return q0, q1, q2, q3


def _moving(tick: int) -> Motion:
    time_s = tick * TICK_NS * 1e-9
    before, here, after = (_lemniscate(time_s + step) for step in (-_STEP_S, 0.0, _STEP_S))
    velocity, acceleration = (after - before) / (2.0 * _STEP_S), (after - 2.0 * here + before) / _STEP_S**2
    return _motion(tick, here, velocity, _attitude(acceleration, _YAW_RATE * time_s))


def _motion(tick: int, position: Array, velocity: Array, attitude: tuple[float, float, float, float]) -> Motion:
    none = (0.0, 0.0, 0.0)
    place, speed = tuple(position.tolist()), tuple(velocity.tolist())
    return Motion(tick * TICK_NS, place, speed, attitude, none, (0.0,) * 4, False, 0.0, none, none, 0.0)


def hover(duration_s: float) -> Iterator[Motion]:
    """Level, 3 m up, nose to the north; from time 0 on."""
    for tick in range(round(duration_s * 1e9) // TICK_NS + 1):
        yield _motion(tick, np.array((0.0, 0.0, -3.0)), np.zeros(3), (1.0, 0.0, 0.0, 0.0))


def lemniscate(duration_s: float) -> Iterator[Motion]:
    """At 5 m/s, turning."""
    for tick in range(round(duration_s * 1e9) // TICK_NS + 1):
        yield _moving(tick)


def settings_of(level: str) -> SensorSettings:
    found = airframe_with(f'estimator.sensors="{level}"').sensors()
    assert found is not None
    return found
