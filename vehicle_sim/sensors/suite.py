"""Gyroscope, accelerometer, barometer, magnetometer and satellite receiver: the truth with each one's errors."""

import math
from typing import NamedTuple

import numpy as np

from protocol.arrays import Array
from protocol.frames import multiply, to_rotation_vector
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.physics.motion import Motion
from vehicle_sim.physics.rigid_body import to_world
from vehicle_sim.sensors.settings import SensorSettings, Wander
from vehicle_sim.timing import TICK_NS

TICK_S = TICK_NS * 1e-9
POSITION, HARD_IRON, BAROMETER = slice(6, 9), slice(9, 12), 12
"""Among the wandering errors (13,), after those of gyroscope and accelerometer."""
_WANDERS, _WHITE = 13, 6
_BLOCK = 250
"""Ticks for which noise is drawn at once."""
MOTION = 13
"""Velocity (3) in the world, position (3), attitude (4), rates (3)."""


class Fix(NamedTuple):
    """Of the satellite receiver."""

    time_ns: int
    position_ned: Array
    velocity_ned: Array


def field_ned(settings: SensorSettings) -> Array:
    """The earth's magnetic field (3,) in gauss."""
    s = settings.magnetometer
    declination, inclination = math.radians(s.declination_deg), math.radians(s.inclination_deg)
    level = s.strength * math.cos(inclination)
    return np.array((level * math.cos(declination), level * math.sin(declination), s.strength * math.sin(inclination)))


def wanders(settings: SensorSettings) -> list[Wander]:
    """Of each wandering error (13,)."""
    s, gnss = settings.inertial, settings.gnss
    return [
        *(s.gyro_bias,) * 3,
        *(s.accelerometer_bias,) * 3,
        *(gnss.horizontal_error,) * 2,
        gnss.vertical_error,
        *(settings.magnetometer.hard_iron,) * 3,
        settings.barometer.bias,
    ]


def as_row(motion: Motion) -> Array:
    """(13,), see MOTION."""
    return np.array((*motion.velocity_ned, *motion.position_ned, *motion.attitude_ned_frd, *motion.rates_frd))


@compiled
def gained(before: Array, now: Array, angle: Array, speed: Array) -> None:
    """What a perfect inertial unit reads in a tick between two motions (13,): the angle (3,) (rad) that the body turned
    and the speed (3,) (m/s) that the specific force gave, both in the axes at the tick's beginning.

    The mean of the force turns with the body: the speed is that which `angle` / 2 turns into the true one.
    """
    x, y, z = to_rotation_vector(multiply(np.array((before[6], -before[7], -before[8], -before[9])), now[6:10]))
    angle[0], angle[1], angle[2] = x, y, z
    u, v, w = to_world(
        before[6],
        -before[7],
        -before[8],
        -before[9],
        now[0] - before[0],
        now[1] - before[1],
        now[2] - before[2] - GRAVITY * TICK_S,
    )
    x, y, z = 0.5 * x, 0.5 * y, 0.5 * z  # solve s + h x s = (u, v, w)
    along, size = x * u + y * v + z * w, 1.0 + x * x + y * y + z * z
    speed[0] = (u - (y * w - z * v) + x * along) / size
    speed[1] = (v - (z * u - x * w) + y * along) / size
    speed[2] = (w - (x * v - y * u) + z * along) / size


@compiled
def _read(before: Array, now: Array, errors: Array, walk: Array, noise: Array, out: Array) -> None:
    """Let the errors (13,) wander, and read the inertial unit: angle and speed (6,).

    `walk` (2, 13) is what an error keeps in a tick and how far it walks, `noise` (19,) of unit deviation.
    """
    for i in range(_WANDERS):
        errors[i] = walk[0, i] * errors[i] + walk[1, i] * noise[i]
    gained(before, now, out[:3], out[3:])
    for i in range(6):
        out[i] += errors[i] * TICK_S


@compiled
def _add(white: Array, noise: Array, most: Array, out: Array) -> None:
    """Add white noise of these deviations (6,), and saturate at `most` (6,)."""
    for i in range(6):
        out[i] = min(max(out[i] + white[i] * noise[i], -most[i]), most[i])


class SensorSuite:
    """All sensors of a vehicle. Errors begin as the wander has them, but for the receiver's: its first fixes say where
    the origin is."""

    def __init__(self, settings: SensorSettings, start: Motion, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        self._field_ned = field_ned(settings)
        every = wanders(settings)
        deviation = np.array([each.deviation for each in every])
        keeps = np.array([math.exp(-TICK_S / each.time_s) for each in every])
        self.walk = np.array((keeps, deviation * np.sqrt(1.0 - keeps**2)))
        """(2, 13): what an error keeps in a tick, and how far it walks."""
        self.errors = deviation * rng.standard_normal(_WANDERS)
        """(13,): the wandering ones as they are."""
        self.errors[POSITION] = 0.0
        s = settings.inertial
        self._white = np.repeat((s.gyro_noise, s.accelerometer_noise), 3) * math.sqrt(TICK_S)
        self._most = np.repeat((s.gyro_range, s.accelerometer_range), 3) * TICK_S
        self._before = as_row(start)
        self._noise = np.empty((0, _WANDERS + _WHITE))
        self._next = 0
        self.gained = np.zeros(6)
        """(6,): angle (rad) and speed (m/s) of the last tick."""

    def advance(self, now: Array) -> None:
        """One more tick, at whose end the vehicle moves so (13,)."""
        if self._next == len(self._noise):
            self._noise, self._next = self._rng.standard_normal((_BLOCK, _WANDERS + _WHITE)), 0
        noise = self._noise[self._next]
        self._next += 1
        _read(self._before, now, self.errors, self.walk, noise, self.gained)
        _add(self._white, noise[_WANDERS:], self._most, self.gained)
        self._before = now

    def height(self) -> float:
        """The barometer's (m), above the origin."""
        s = self.settings.barometer
        return float(-self._before[5] + self.errors[BAROMETER] + s.noise * self._rng.standard_normal())

    def field_frd(self) -> Array:
        """The magnetometer's (3,), in gauss."""
        q0, q1, q2, q3 = self._before[6:10].tolist()
        field = np.array(to_world(q0, -q1, -q2, -q3, *self._field_ned.tolist()))
        noise = self.settings.magnetometer.noise * self._rng.standard_normal(3)
        return field + self.errors[HARD_IRON] + noise

    def fix(self, time_ns: int) -> Fix | None:
        """The receiver's; None in an outage."""
        s, noise = self.settings.gnss, self._rng.standard_normal(6)
        if any(begin <= time_ns * 1e-9 < end for begin, end in s.outages_s):
            return None
        (level, up), (slow, climbing) = s.position_noise, s.velocity_noise
        error = self.errors[POSITION] + np.array((level, level, up)) * noise[:3]
        return Fix(time_ns, self._before[3:6] + error, self._before[:3] + np.array((slow, slow, climbing)) * noise[3:])
