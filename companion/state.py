"""What flows between the stages. Every record is frozen; arrays are float64 and never written to after they were
made."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import NamedTuple

import msgspec
import numpy as np

from protocol.arrays import Array, BoolArray


class FlightMode(Enum):
    """What the vehicle's own autopilot is doing, the same words for every make."""

    EXTERNAL = "external control"
    """Flies our setpoints: PX4's OFFBOARD, ArduPilot's GUIDED."""
    HOLD = "hold"
    TAKEOFF = "take-off"
    LAND = "land"
    RETURN = "return"
    MISSION = "mission"
    MANUAL = "manual"
    OTHER = "other"


class VehicleRequest(Enum):
    """What the companion asks the vehicle for, again and again until it is there."""

    VERSION = "version"
    HOME = "home position"
    STATUS = "heartbeat"
    EXTERNAL_CONTROL = "external control"
    ARM = "arm"
    RELEASE = "release the parcel"
    HOLD = "hold"
    LAND = "land"
    DISARM = "disarm"


class Adoption(Enum):
    """What is to be done with a vehicle that is taken over in flight."""

    MISSION = "mission"
    """What is left of the mission."""
    LAND = "land"


class OwnFence(msgspec.Struct, frozen=True, gc=False):
    """The vehicle's own fence, m around its home; infinite where there is none."""

    radius: float = math.inf
    max_height: float = math.inf
    min_height: float = -math.inf
    """Counts from the end of the take-off to the landing."""
    margin: float = 0.0
    """That the vehicle wants to be kept from it."""


NO_FENCE = OwnFence()
EVERY_HEIGHT = math.inf, math.inf
"""m above and below the vehicle up to which returns are in the way: all of them."""


class Output(Enum):
    """The lowest layer that the companion commands."""

    ATTITUDE = "attitude"
    RATES = "rates"
    ACTUATORS = "actuators"


class Certainty(msgspec.Struct, frozen=True, gc=False):
    """What the vehicle says of its estimate."""

    velocity_variance: Array = np.zeros(3)
    """(3,) m2/s2, NED; zero where it does not say."""
    resets: int = 0
    """Changes whenever what comes may be of another estimate than before."""


UNSAID = Certainty()


class VehicleState(msgspec.Struct, frozen=True, gc=False):
    """The rigid body at `time_ns` (the companion's clock)."""

    time_ns: int
    position_ned: Array
    velocity_ned: Array
    attitude_ned_frd: Array
    rates_frd: Array
    position_age_ns: int
    """How much older the position's message was than the attitude's; it is carried over that gap by the velocity."""
    certainty: Certainty = UNSAID
    """The same object until the vehicle says something new."""


@dataclass(frozen=True, slots=True)
class VehicleStatus:
    """What a heartbeat says."""

    mode: FlightMode
    armed: bool
    failsafe: bool
    """The vehicle's autopilot says that it is in a critical state."""
    emergency: bool = False
    """And that it is not flying on."""


@dataclass(frozen=True, slots=True)
class Scan:
    """One ring of ranges: bearing 0 forward, clockwise (FRD)."""

    time_ns: int
    """Time of arrival."""
    boot_time_us: int
    """Time of the measurement, on the vehicle's clock."""
    bearings_frd: Array
    """(n,) rad."""
    ranges_m: Array
    """(n,); where `hit` is False, the range up to which nothing was seen."""
    hit: BoolArray
    """(n,) something stands at that range."""
    known: BoolArray
    """(n,) the sector was measured at all."""


class Ground(NamedTuple):
    """The ground below the vehicle."""

    here: float
    """m, NED"""
    ahead: float
    """m, NED: where it will be in a second as it rises now, no lower than here."""


Pose = tuple[Array, Array]
"""Position (3,) m, NED, and attitude (4,), NED to FRD."""


class Reference(msgspec.Struct, frozen=True, gc=False):
    """Where to be, and how that changes (m, rad and their derivatives by s)."""

    rows: Array
    """(6, 3) position, velocity, acceleration, jerk and snap, NED; yaw, its rate and its acceleration. Nobody else has
    it: whoever asked for a reference may write into it."""
    tied: bool = False
    """North and east are tied to the vehicle's own motion, so the errors there are none of the model."""

    @property
    def position_ned(self) -> Array:
        row: Array = self.rows[0]
        return row

    @property
    def velocity_ned(self) -> Array:
        row: Array = self.rows[1]
        return row

    @property
    def acceleration_ned(self) -> Array:
        row: Array = self.rows[2]
        return row

    @property
    def yaw(self) -> float:
        return float(self.rows[5, 0])

    @property
    def yaw_rate(self) -> float:
        return float(self.rows[5, 1])

    @property
    def yaw_acceleration(self) -> float:
        return float(self.rows[5, 2])


class AvoidanceDecision(msgspec.Struct, frozen=True, gc=False):
    """What avoidance makes of a target: where to fly instead, and how fast."""

    target_ned: Array
    speed_limit: float
    """m/s, from the braking distance into free space."""
    clearance: float
    """m from the vehicle's hull to the nearest thing seen; inf if there is none."""
    blocked: bool
    """Something stands in the way to the target that was wished for."""


class Setpoint(msgspec.Struct, frozen=True, gc=False):
    """What goes to the vehicle, in the units of the wire."""

    attitude_ned_frd: Sequence[float]
    rates_frd: Sequence[float]
    torque: Sequence[float]
    """Three of full torque, -1..1."""
    thrust: float
    """0..1 of full thrust."""


class Reason(IntEnum):
    """Why the guard changed the command."""

    NONE = 0
    BARRIER = 1
    """It came too near to something."""
    STOP = 2
    """It would have left no way to stop."""
    NO_STOP = 3
    """There is no way to stop in free space any more: the best there is."""
    STALE = 4
    """Nothing was seen for too long."""
    EVASION = 5
    """Something moving would have met the vehicle soon."""


class Safety(IntEnum):
    """What a parameter of the vehicle means for a flight. The numbers go into the log."""

    SAFE = 0
    UNSAFE = 1
    """Flown, with a warning."""
    REFUSED = 2
    """Not flown."""


class BatteryLevel(IntEnum):
    """What the battery calls for; the higher, the worse."""

    FINE = 0
    WARN = 1
    RETURN = 2
    LAND = 3


class Severity(IntEnum):
    """MAV_SEVERITY."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


@dataclass(frozen=True, slots=True)
class Announcement:
    """A sentence for the ground station, the console and the log."""

    severity: Severity
    text: str
