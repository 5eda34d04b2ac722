"""The delay of the estimate: what it makes late, and what not."""

from functools import lru_cache

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import ForeignPilot, airframe_with, tilted

POSES = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: "ATTITUDE_QUATERNION",
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: "LOCAL_POSITION_NED",
    mavlink.MAVLINK_MSG_ID_ODOMETRY: "ODOMETRY",
    mavlink.MAVLINK_MSG_ID_ATTITUDE: "ATTITUDE",
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: "GLOBAL_POSITION_INT",
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: "GPS_RAW_INT",
}
PRESENT = {
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: "HIL_STATE_QUATERNION",
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: "SERVO_OUTPUT_RAW",
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: "ATTITUDE_TARGET",
    mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: "OBSTACLE_DISTANCE",
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: "BATTERY_STATUS",
}


@lru_cache
def flown_late(delay_s: float) -> dict[str, list[bytes]]:
    """A flight told late: the payloads of each message in turn."""
    pilot = ForeignPilot(airframe=airframe_with(f"telemetry.delay_s={delay_s}"), seed=2)
    for message_id in (*POSES, *PRESENT):
        pilot.interval(message_id, 4000)
    pilot.take_off()

    def lean() -> None:
        pilot.attitude(tilted(0.2, (0.3, 1.0, 0.2)))

    pilot.go_offboard(lean)
    pilot.fly(1.0, lean)
    names = (*POSES.values(), *PRESENT.values())
    return {name: [bytes(message.get_payload()) for message in pilot.all(name)] for name in names}


@pytest.mark.parametrize(("delay_s", "ticks"), [(0.004, 1), (0.025, 7), (0.028, 7)])
def test_the_delay_is_that_of_the_estimate_alone(delay_s: float, ticks: int) -> None:
    """Byte for byte, times included, what an undelayed vehicle on the same flight said so many ticks before."""
    prompt, late = flown_late(0.0), flown_late(delay_s)
    for name in POSES.values():
        assert len(late[name]) > 1500
        assert late[name][ticks:] == prompt[name][:-ticks]
        assert late[name][-1] != prompt[name][-1]
    for name in PRESENT.values():
        assert len(late[name]) > 100
        assert late[name] == prompt[name]


def test_the_vehicles_clock_is_not_delayed() -> None:
    pilot = ForeignPilot(airframe=airframe_with("telemetry.delay_s=0.1"))
    pilot.fly(2.0)
    pilot.send(mavlink.MAVLink_timesync_message(0, 77))
    pilot.fly(0.004)
    assert pilot.last("TIMESYNC").tc1 == 2_000_000_000
