"""Which messages a link is sent at first, and how often."""

import math
from enum import Enum

from protocol.messages import CurrentMode, dialect


class Profile(Enum):
    """Whose a link is: the column of the table below."""

    FIRST = 0
    """Courier's companion's alone: the few messages that it reads."""
    ONBOARD = 1
    """Companions': PX4's mode `onboard`."""
    GROUND = 2
    """Ground stations': PX4's mode `normal`."""


_PX4: dict[int, tuple[float, float, float]] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: (1.0, 1.0, 1.0),
    dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: (50.0, 50.0, 10.0),
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (50.0, 30.0, 1.0),
    dialect.MAVLINK_MSG_ID_ODOMETRY: (30.0, 30.0, 0.0),
    dialect.MAVLINK_MSG_ID_ATTITUDE: (10.0, 100.0, 15.0),
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: (10.0, 50.0, 5.0),
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: (0.0, 1.0, 1.0),
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: (5.0, 5.0, 5.0),
    dialect.MAVLINK_MSG_ID_ALTITUDE: (0.0, 10.0, 1.0),
    dialect.MAVLINK_MSG_ID_VFR_HUD: (0.0, 10.0, 4.0),
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME: (0.0, 1.0, 0.0),
    dialect.MAVLINK_MSG_ID_SYS_STATUS: (1.0, 5.0, 1.0),
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (5.0, 5.0, 1.0),
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: (0.5, 0.5, 0.5),
    dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET: (10.0, 10.0, 2.0),
    dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: (10.0, 10.0, 1.0),
    dialect.MAVLINK_MSG_ID_HOME_POSITION: (0.5, 0.5, 0.5),
    dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: (math.inf, 10.0, 1.0),
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: (math.inf, 10.0, 0.5),
    dialect.MAVLINK_MSG_ID_MISSION_CURRENT: (1.0, 1.0, 1.0),
    CurrentMode.id: (0.5, 0.5, 0.5),
    dialect.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS: (5.0, 5.0, 2.0),
    dialect.MAVLINK_MSG_ID_HIGHRES_IMU: (0.0, 50.0, 0.0),
    dialect.MAVLINK_MSG_ID_SCALED_PRESSURE: (0.0, 1.0, 1.0),
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: (0.0, 1.0, 0.5),
    dialect.MAVLINK_MSG_ID_VIBRATION: (0.0, 0.5, 0.1),
    dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: (0.0, 10.0, 1.5),
    dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: (0.0, 10.0, 1.0),
    dialect.MAVLINK_MSG_ID_TIMESYNC: (0.0, 10.0, 0.0),
    dialect.MAVLINK_MSG_ID_PING: (0.0, 1.0, 0.1),
}
"""Times a second, by profile, with PX4's rates in the last two (`Mavlink::configure_streams_to_default`). Infinite: as
often as the source has something new. What is not here is sent on request only."""

_OWN = {dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: (20.0, 20.0, 0.0)}
"""What PX4's simulation sends on request only."""

_RATES_HZ = _PX4 | _OWN


def interval_us(message_id: int, profile: Profile, least_us: int) -> int:
    """Default interval; 0: not sent."""
    rate_hz = _RATES_HZ.get(message_id, (0.0, 0.0, 0.0))[profile.value]
    return max(1, least_us, round(1e6 / rate_hz)) if rate_hz else 0
