"""Flight modes, what changes them by itself, and the MAVLink enumerations of the vehicle's answers."""

from enum import Enum, IntEnum


class Mode(Enum):
    """Main and sub mode, as PX4 numbers them."""

    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    RETURN = (4, 5)
    LAND = (4, 6)
    OFFBOARD = (6, 0)

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT's custom_mode."""
        main, sub = self.value
        return int(main << 16 | sub << 24)


class Trigger(Enum):
    """What can change the mode without a command."""

    STREAM_LOST = "no setpoint for 1 s"
    STILL_LOST = "some time in hold without a command after the stream was lost: land"
    STILL_LOST_RETURN = "some time in hold without a command after the stream was lost: return"
    LINK_LOST = "no heartbeat for some time: land"
    LINK_LOST_RETURN = "no heartbeat for some time: return"
    CLIMBED = "at the take-off height"
    ABOVE_HOME = "above home"
    DISARMED = "motors off"


class Severity(IntEnum):
    """MAV_SEVERITY."""

    EMERGENCY = 0
    CRITICAL = 2
    WARNING = 4
    INFO = 6


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


TRANSITIONS: dict[tuple[Mode, Trigger], tuple[Mode, Severity, str]] = {
    (Mode.OFFBOARD, Trigger.STREAM_LOST): (Mode.HOLD, Severity.CRITICAL, "Failsafe: offboard stream lost, holding"),
    (Mode.HOLD, Trigger.STILL_LOST): (Mode.LAND, Severity.CRITICAL, "Failsafe: offboard stream lost, landing"),
    (Mode.HOLD, Trigger.STILL_LOST_RETURN): (
        Mode.RETURN,
        Severity.CRITICAL,
        "Failsafe: offboard stream lost, returning",
    ),
    (Mode.HOLD, Trigger.LINK_LOST): (Mode.LAND, Severity.CRITICAL, "Failsafe: no heartbeat, landing"),
    (Mode.HOLD, Trigger.LINK_LOST_RETURN): (Mode.RETURN, Severity.CRITICAL, "Failsafe: no heartbeat, returning"),
    (Mode.TAKEOFF, Trigger.CLIMBED): (Mode.HOLD, Severity.INFO, "Takeoff height reached, holding"),
    (Mode.RETURN, Trigger.ABOVE_HOME): (Mode.LAND, Severity.INFO, "Home reached, landing"),
    (Mode.TAKEOFF, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    (Mode.RETURN, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    (Mode.LAND, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
}
"""All changes of mode without a command: the next mode and what is said. None of them enters OFFBOARD."""
