"""What the parts report of the vehicle, the mission and the motion, in the units and frames of the companion."""

from collections.abc import Mapping

import msgspec

from companion.state import NO_FENCE, BatteryLevel, OwnFence, Safety, Scan, VehicleStatus
from protocol.arrays import Array


class AttitudeReport(msgspec.Struct, frozen=True, gc=False):
    """Attitude (4,) NED to FRD and body rates (3,) rad/s at a time of the vehicle's clock."""

    boot_time_ms: int
    attitude_ned_frd: Array
    rates_frd: Array


class RepeatedAttitude(msgspec.Struct, frozen=True, gc=False):
    """Euler angles of a vehicle that sends its quaternion as well: a moment to act, and nothing new."""


class PositionReport(msgspec.Struct, frozen=True, gc=False):
    """Position (3,) m and velocity (3,) m/s, NED, at a time of the vehicle's clock."""

    boot_time_ms: int
    position_ned: Array
    velocity_ned: Array


class OdometryReport(msgspec.Struct, frozen=True, gc=False):
    """What the vehicle says of its estimate."""

    velocity_variance: Array | None
    """(3,) m2/s2, NED; None if it does not say."""
    reset_counter: int
    """Count of the estimate's resets, 0..255."""


class RangeBelow(msgspec.Struct, frozen=True, gc=False):
    """What a range finder that looks down has measured, at a time of the vehicle's clock."""

    boot_time_ms: int
    distance_m: float
    """inf: nothing within its reach."""


class Rebooted(msgspec.Struct, frozen=True, gc=False):
    """The vehicle's time since boot fell: what was known of its motion is void."""


class ClockSet(msgspec.Struct, frozen=True, gc=False):
    """The vehicle's clock was set, and nothing else happened."""

    by_ms: int


SYSTEM_BATTERY = -1
"""The `source` of what SYS_STATUS says, which names no battery."""


class BatteryReading(msgspec.Struct, frozen=True, gc=False):
    """What was said of a battery. None for what is not known."""

    source: int
    """The battery's number, from 0 on, or SYSTEM_BATTERY."""
    time_ns: int
    """Time of arrival."""
    charge: float | None = None
    """Share of a full battery, 0..1."""
    volts: float | None = None
    """Voltage of the whole battery."""
    cell_volts: float | None = None
    """Voltage of the lowest cell."""
    level: BatteryLevel = BatteryLevel.FINE
    """What its condition calls for, as the vehicle sees it."""
    condition: str = ""
    """That, in words."""


Report = (
    AttitudeReport
    | RepeatedAttitude
    | PositionReport
    | OdometryReport
    | Scan
    | RangeBelow
    | BatteryReading
    | Rebooted
    | ClockSet
)


class Finding(msgspec.Struct, frozen=True, gc=False):
    """A parameter of the vehicle as it is, and as it should be."""

    parameter: str
    value: float | None
    """None: the vehicle does not have it, or does not say it."""
    wanted: str
    why: str
    safety: Safety


class VehicleSettings(msgspec.Struct, frozen=True, gc=False):
    """What the vehicle's parameters say of how it flies setpoints."""

    setpoint_hold: float | None = None
    """s that the last setpoint is followed when no more come; None if that is not known."""
    angle_boost: bool = False
    """The vehicle divides thrust by the cosine of its tilt."""
    fence: OwnFence = NO_FENCE


class StatusReport(msgspec.Struct, frozen=True, gc=False):
    """What to make of the vehicle's own word."""

    current: bool = True
    """Its heartbeat is newer than the mode that was asked for, and than a gap of our own."""
    airborne: bool = False
    """It says that it is in the air."""
    landed_for: float = 0.0
    """s that it has said without a break that it stands on the ground."""
    rebooted: bool = False
    """It has rebooted, and was not armed since."""
    fell: bool = False
    """It was disarmed, and went on to say that it is in the air."""
    undecided: bool = False
    """It was disarmed just now, and has not said since whether it stands on the ground; before, it was in the air."""


class LinkReport(msgspec.Struct, frozen=True, gc=False):
    """What the link knows of the vehicle at one moment. Ages in s, infinite for what never came."""

    found: bool
    status: VehicleStatus
    on_ground: bool | None
    """The vehicle says that it stands on the ground; None: it says nothing of it."""
    silence: float
    """Age of the last message of any kind; 0 before the first."""
    heartbeat_age: float
    refused: str | None
    """What was wrong with the telemetry that is being refused again and again, or that comes too late."""
    complaint: str
    """What the vehicle warned of just now, to stand behind a sentence; empty if nothing."""
    exhausted: str | None = None
    """The request that was repeated as often as allowed, and its answer."""
    refusal: str | None = None
    """Why this vehicle is not flown, whatever one waits for: version, output, parameters. None in flight."""
    shortcoming: str | None = None
    """What the link lacks before a flight: version, parameters, message rates. None in flight."""
    rival: str | None = None
    """Another companion in this one's name that flies the vehicle, in words."""
    word: StatusReport = StatusReport()
    home_known: bool = False
    """The vehicle has said where it took off."""
    prearm_ok: bool = True
    """False: the vehicle says that its own arming checks fail."""
    failed_check: str = ""
    """Which, to stand behind a sentence; empty if it does not say."""
    emergency: str = ""
    """What the vehicle said of an emergency since arming; empty if nothing."""
    position_lost: bool = False
    """Its estimator had a position, and says that it has none now."""


class LinkDelay(msgspec.Struct, frozen=True, gc=False):
    """How late the link makes things (s), as was measured. An attitude is `age` old when it arrives; a command acts
    `command` after it was sent."""

    age: float = 0.0
    command: float = 0.0
    unsteady: float = 0.0
    """By how much commands miss their moment, either way."""

    @property
    def total(self) -> float:
        """From a measurement to the effect of what is made of it."""
        return self.age + self.command


class Motors(msgspec.Struct, frozen=True, gc=False):
    """How the vehicle's motors follow what it is asked for."""

    spooling: bool = False
    """Not yet: it says that it stands on the ground, and its make waits there."""
    angle_boost: bool = False
    """It divides the thrust by the cosine of its tilt."""
    own_loops: bool = False
    """Its rate loops are its own, whatever the vehicle's file says: that may be another vehicle's."""


class CommandReport(msgspec.Struct, frozen=True, gc=False):
    """What has come of a command that is repeated until it has an effect."""

    accepted: bool
    tries: int
    answer: str
    """The latest answer in words."""


class MissionReport(msgspec.Struct, frozen=True, gc=False):
    """How far the mission is."""

    done: bool
    """Only the landing is left."""
    overdue: float
    """By how much the present step takes longer than it may (s), else 0."""
    allowed: float = 0.0
    """Time (s) that it may take."""
    homeward: bool = False
    """What is left of it leads to its landing place as directly as the way home would."""
    landing_s: float = 0.0
    """Time (s) to the nearest known landing place, at the mission's speed, and down to the ground."""
    outside: str | None = None
    """The place of the mission that is beyond the fence, in words."""
    beyond: float = 0.0
    """m by which the vehicle is beyond the fence; negative inside of it, 0 without a fence."""


class MotionReport(msgspec.Struct, frozen=True, gc=False):
    """How the reference moves along a leg."""

    following: bool
    """It follows a track."""
    rests: bool
    """It does not move any more."""
    track_start_ned: Array | None
    """(3,) m: where the track begins that is to be joined; None if there is none."""
    over_map: bool
    """The way over the map was looked at just now."""


class SensingReport(msgspec.Struct, frozen=True, gc=False):
    """Ages (s) of what is known of the vehicle's motion and of its surroundings; infinite before that has come."""

    telemetry_age: float
    scan_age: float
    """0 where no scan is needed."""
    has_state: bool
    """Position and attitude have come."""
    batteries: Mapping[int, BatteryReading] = {}
    """The latest reading of each source."""
    contradiction: str | None = None
    """Why what the vehicle says of its motion can't be true; None if it may be."""
    unseen: str = "no ring for"
    """Words before `scan_age`: what is that old, the ring, a good one where bad ones come, or the map where rings come
    and no map is made of them."""
