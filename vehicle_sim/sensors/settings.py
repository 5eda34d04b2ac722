"""A sensor file in `vehicles/sensors/`: how wrong the vehicle's sensors are.

Errors that wander are first-order Gauss-Markov processes: their standard deviation and the time after which they have
forgotten themselves. A density is the N of the Allan deviation N / sqrt(t).
"""

import math
from typing import Annotated

import msgspec

from protocol.vehicle_parameters import NotNegative, Positive

Size = Annotated[float, msgspec.Meta(ge=0, le=1e4)]
"""An error in the sensor's unit: with a larger one nothing is measured."""
Interval = tuple[NotNegative, NotNegative]


class Wander(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An error that wanders."""

    deviation: Size
    time_s: Positive


class Inertial(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[inertial]` table: gyroscope and accelerometer, read in each tick as angle and speed gained in it."""

    gyro_noise: Size
    """rad/s/sqrt(Hz)"""
    accelerometer_noise: Size
    """m/s2/sqrt(Hz)"""
    gyro_bias: Wander
    """rad/s"""
    accelerometer_bias: Wander
    """m/s2"""
    gyro_range: Positive
    """rad/s; it saturates there."""
    accelerometer_range: Positive
    """m/s2"""


class Barometer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[barometer]` table, as height (m)."""

    rate_hz: Positive
    noise: Size
    bias: Wander


class Magnetometer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `[magnetometer]` table, in gauss."""

    rate_hz: Positive
    noise: Size
    hard_iron: Wander
    """What calibration left, in the body."""
    declination_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)]
    inclination_deg: Annotated[float, msgspec.Meta(ge=-90, le=90)]
    strength: Annotated[float, msgspec.Meta(gt=0, le=1e4)]


class Positioning(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What measures the position: horizontal and vertical values side by side."""

    rate_hz: Positive
    delay_s: Annotated[float, msgspec.Meta(ge=0, le=0.4)]
    position_noise: tuple[Size, Size]
    """m"""
    outages_s: list[Interval] = []
    """Times since boot, from and until, without any fix."""


class Satellites(Positioning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The `[gnss]` table: a receiver."""

    velocity_noise: tuple[Size, Size]
    """m/s"""
    horizontal_error: Wander
    """m; what the atmosphere and reflections do."""
    vertical_error: Wander
    fix_type: Annotated[int, msgspec.Meta(ge=2, le=6)] = 3
    """GPS_FIX_TYPE: 3 in space, 6 RTK, fixed."""


DRIFT_TIME_S = 1e5
"""A drift is a wander that forgets itself in this time, longer than any flight."""


class Odometer(Positioning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The `[vio]` table: cameras and an inertial unit of their own. They tell where they are, and drift with the way. A
    velocity of theirs would have the same drift, and tell nothing more."""

    drift: tuple[NotNegative, NotNegative]
    """m after a metre of way, along each axis; it grows with the root of the way."""

    def drifted(self, way_m: float) -> tuple[float, float, float]:
        """Standard deviations (m, NED) of the drift on a way."""
        level, up = (each * math.sqrt(way_m) for each in self.drift)
        return level, level, up


class SensorSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole sensor file: either `gnss` or `vio`."""

    inertial: Inertial
    barometer: Barometer
    magnetometer: Magnetometer
    gnss: Satellites | None = None
    vio: Odometer | None = None

    def __post_init__(self) -> None:
        if (self.gnss is None) is (self.vio is None):
            raise ValueError("gnss, vio: exactly one of the two tables")

    @property
    def positioning(self) -> Satellites | Odometer:
        """What the position is from."""
        found = self.gnss or self.vio
        assert found is not None
        return found
