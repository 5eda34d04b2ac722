"""Gyroscope, accelerometer, barometer, magnetometer, and satellite receiver or visual odometry: the truth with each
one's errors."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from protocol.arrays import Array
from protocol.frames import multiply, to_rotation_vector
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.physics.motion import Motion
from vehicle_sim.physics.rigid_body import to_world
from vehicle_sim.sensors.faults import Fault
from vehicle_sim.sensors.settings import DRIFT_TIME_S, Satellites, SensorSettings, Wander
from vehicle_sim.timing import TICK_S

POSITION, HARD_IRON, BAROMETER = slice(6, 9), slice(9, 12), 12
"""Among the wandering errors (13,), after those of gyroscope and accelerometer."""
_WANDERS, _WHITE = 13, 6
_BLOCK = 250
"""Ticks for which noise is drawn at once."""
MOTION = 13
"""Velocity (3) in the world, position (3), attitude (4), rates (3)."""
_WRONG_HEIGHT_M = 20.0
_WRONG_FIELD_GAUSS = 0.3
_WRONG_FIX = (20.0, 20.0, 20.0, 2.0, 2.0, 2.0)
"""By how much a failed sensor is wrong: position (m) and velocity (m/s) of a fix."""
_SPINS = np.array((-1.0, 1.0, -1.0, 1.0))
"""Directions in which the rotors turn, about the body's z axis."""
_SMOOTHING = 0.01
"""Share of a tick's difference in the vibration, as in PX4."""


class Fix(NamedTuple):
    """A fix of the satellite receiver or of the visual odometry."""

    time_ns: int
    position_ned: Array
    velocity_ned: Array | None
    """None of an odometry."""


def field_ned(settings: SensorSettings) -> Array:
    """The earth's magnetic field (3,) in gauss."""
    s = settings.magnetometer
    declination, inclination = math.radians(s.declination_deg), math.radians(s.inclination_deg)
    level = s.strength * math.cos(inclination)
    return np.array((level * math.cos(declination), level * math.sin(declination), s.strength * math.sin(inclination)))


def wanders(settings: SensorSettings) -> list[Wander]:
    """The wander of each error that wanders (13,)."""
    s, gnss = settings.inertial, settings.gnss
    drift = Wander(0.0, DRIFT_TIME_S)  # which depends on the way
    return [
        *(s.gyro_bias,) * 3,
        *(s.accelerometer_bias,) * 3,
        *((drift,) * 3 if gnss is None else (gnss.horizontal_error, gnss.horizontal_error, gnss.vertical_error)),
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
def read(before: Array, now: Array, errors: Array, walk: Array, noise: Array, out: Array) -> None:
    """Let the errors (13,) wander, and read the inertial unit: angle and speed (6,).

    `walk` (2, 13) is what an error keeps in a tick and how far it walks, `noise` (19,) of unit deviation.
    """
    for i in range(_WANDERS):
        errors[i] = walk[0, i] * errors[i] + walk[1, i] * noise[i]
    gained(before, now, out[:3], out[3:])
    for i in range(6):
        out[i] += errors[i] * TICK_S


@compiled
def _add(white: Array, noise: Array, most: Array, out: Array, shaken: Array) -> None:
    """Add white noise of these deviations (6,), and saturate at `most` (6,).

    `shaken` (11,): the smoothed size of what angle and speed change from tick to tick (2), how often each axis of the
    accelerometer saturated (3), and the last reading (6).
    """
    for i in range(6):
        read = out[i] + white[i] * noise[i]
        out[i] = min(max(read, -most[i]), most[i])
        if i >= 3 and out[i] != read:
            shaken[i - 1] += 1.0
    for kind in range(2):
        square = 0.0
        for i in range(3 * kind, 3 * kind + 3):
            square += (out[i] - shaken[5 + i]) ** 2
            shaken[5 + i] = out[i]
        shaken[kind] += _SMOOTHING * (math.sqrt(square) - shaken[kind])


@compiled
def _sense(before: Array, now: Array, wander: Array, noise: Array, limits: Array, out: Array, shaken: Array) -> None:
    """`read` and `_add` in one call. `wander` (3, 13): errors, and what they keep and walk; `limits` (2, 6): of white
    noise and of saturation."""
    read(before, now, wander[0], wander[1:], noise, out)
    _add(limits[0], noise[_WANDERS:], limits[1], out, shaken)


class SensorSuite:
    """All sensors of a vehicle. Errors begin as the wander has them, but for those of the position: its first fixes say
    where the origin is."""

    def __init__(
        self, settings: SensorSettings, start: Motion, rng: np.random.Generator, imbalance_m: float = 0.0
    ) -> None:
        """`imbalance_m`: a propeller's imbalance (kg m) over the vehicle's mass."""
        self.settings = settings
        self._rng = rng
        self._field_ned = field_ned(settings)
        every = wanders(settings)
        deviation = np.array([each.deviation for each in every])
        keeps = np.array([math.exp(-TICK_S / each.time_s) for each in every])
        first = deviation * rng.standard_normal(_WANDERS)
        self._wander = np.array((first, keeps, deviation * np.sqrt(1.0 - keeps**2)))
        self.errors = self._wander[0]
        """(13,): the wandering ones as they are."""
        self.walk = self._wander[1:]
        """(2, 13): what an error keeps in a tick, and how far it walks."""
        self.errors[POSITION] = 0.0
        s = settings.inertial
        white = np.repeat((s.gyro_noise, s.accelerometer_noise), 3) * math.sqrt(TICK_S)
        self._limits = np.array((white, np.repeat((s.gyro_range, s.accelerometer_range), 3) * TICK_S))
        self._before = as_row(start)
        self._imbalance_m = imbalance_m
        self._phases = 2.0 * math.pi * rng.random(4) if imbalance_m else np.zeros(4)
        self._noise = np.empty((0, _WANDERS + _WHITE))
        self._next = 0
        self.gained = np.zeros(6)
        """(6,): angle (rad) and speed (m/s) of the last tick."""
        self._shaken = np.zeros(11)
        self._shaken[-1] = -GRAVITY * TICK_S  # at rest, so that the first tick does not count as a jolt
        self.barometer = Fault(np.array((_WRONG_HEIGHT_M,)), rng)
        self.magnetometer = Fault(np.full(3, _WRONG_FIELD_GAUSS), rng)
        self.positioning = Fault(np.array(_WRONG_FIX), rng)

    def advance(self, now: Array, rotor_speeds: Sequence[float] = ()) -> None:
        """One more tick, at whose end the vehicle moves so (13,) and the rotors turn so (rad/s)."""
        if self._next == len(self._noise):
            self._noise, self._next = self._rng.standard_normal((_BLOCK, _WANDERS + _WHITE)), 0
        noise = self._noise[self._next]
        self._next += 1
        if self.settings.vio is not None:
            way = TICK_S * math.sqrt(now[0] ** 2 + now[1] ** 2 + now[2] ** 2)
            self.walk[1, POSITION] = self.settings.vio.drifted(way)
        if self._imbalance_m:
            read(self._before, now, self.errors, self.walk, noise, self.gained)
            self.gained[3:5] += self._shake(np.array(rotor_speeds))
            _add(self._limits[0], noise[_WANDERS:], self._limits[1], self.gained, self._shaken)
        else:
            _sense(self._before, now, self._wander, noise, self._limits, self.gained, self._shaken)
        self._before = now

    def _shake(self, speeds: Array) -> Array:
        """What the propellers' imbalances add in a tick to the speed (2,) along the body's x and y: the integrals of
        forces that turn with the rotors."""
        before = self._phases
        self._phases = (before + _SPINS * speeds * TICK_S) % (2.0 * math.pi)
        turned = self._imbalance_m * speeds * _SPINS
        x = turned @ (np.sin(self._phases) - np.sin(before))
        y = turned @ (np.cos(before) - np.cos(self._phases))
        return np.array((x, y))

    @property
    def vibration(self) -> tuple[float, float]:
        """Vibration of gyroscope (rad/s) and accelerometer (m/s2): the smoothed change from tick to tick."""
        return float(self._shaken[0] / TICK_S), float(self._shaken[1] / TICK_S)

    @property
    def clipped(self) -> tuple[int, int, int]:
        """How often each axis of the accelerometer has saturated."""
        x, y, z = self._shaken[2:5].astype(int).tolist()
        return x, y, z

    def height(self, time_ns: int) -> float | None:
        """The barometer's (m), above the origin."""
        s = self.settings.barometer
        read = -self._before[5] + self.errors[BAROMETER] + s.noise * self._rng.standard_normal()
        found = self.barometer.read(np.array((read,)), time_ns)
        return None if found is None else float(found[0])

    def field_frd(self, time_ns: int) -> Array | None:
        """The magnetometer's (3,), in gauss."""
        q0, q1, q2, q3 = self._before[6:10].tolist()
        field = np.array(to_world(q0, -q1, -q2, -q3, *self._field_ned.tolist()))
        noise = self.settings.magnetometer.noise * self._rng.standard_normal(3)
        return self.magnetometer.read(field + self.errors[HARD_IRON] + noise, time_ns)

    def fix(self, time_ns: int) -> Fix | None:
        """The receiver's or the odometry's; None without a fix."""
        s, noise = self.settings.positioning, self._rng.standard_normal(6)
        if any(begin <= time_ns * 1e-9 < end for begin, end in s.outages_s):
            return None
        level, up = s.position_noise
        slow, climbing = s.velocity_noise if isinstance(s, Satellites) else (0.0, 0.0)
        position = self._before[3:6] + self.errors[POSITION] + np.array((level, level, up)) * noise[:3]
        velocity = self._before[:3] + np.array((slow, slow, climbing)) * noise[3:]
        found = self.positioning.read(np.concatenate((position, velocity)), time_ns)
        if found is None:
            return None
        return Fix(time_ns, found[:3], found[3:] if isinstance(s, Satellites) else None)
