"""A script of pymavlink's own connection class flies the vehicle, in real time and at five times its speed."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink import mavutil

from tests.vehicle_sim.served import HOST, PATIENCE_S, served

POSITION, VELOCITY = 0xDF8, 0xDC7
"""Type masks: these alone count."""
MAIN_MODES = {"POSCTL": 3, "OFFBOARD": 6}
LAND = 4, 6


class Script:
    """A connection, and what a user does with it."""

    def __init__(self, connection: Any) -> None:
        self.connection, self.mav = connection, connection.mav
        connection.wait_heartbeat()
        self.target = connection.target_system, connection.target_component

    def fly(self, each: Callable[[], object], until: Callable[[Any], bool]) -> None:
        """Send something whenever the vehicle tells its place, until that is as it should be."""
        for _ in range(100_000):
            place = self.connection.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=PATIENCE_S)
            assert place is not None, "the vehicle is silent"
            if until(place):
                return
            each()
        raise AssertionError(f"not flown: {place}")

    def target_local(self, mask: int, *values: float) -> None:
        """Position and velocity (m, m/s)."""
        zeros = (0.0,) * (11 - len(values))
        self.mav.set_position_target_local_ned_send(0, *self.target, 1, mask, *values, *zeros)


@pytest.fixture(params=[1.0, 5.0])
def script(request: pytest.FixtureRequest) -> Iterator[Script]:
    """On its pad; the vehicle speaks first, as PX4 does."""
    connection = mavutil.mavlink_connection(f"udpin:{HOST}:0")
    with served(request.param, connection.port.getsockname()):
        yield Script(connection)
    connection.close()


def test_it_arms_flies_offboard_by_sticks_and_lands(script: Script) -> None:
    connection = script.connection
    assert connection.target_system == 1 and connection.mav_type == mavutil.mavlink.MAV_TYPE_QUADROTOR
    mask = mavutil.mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED

    def set_mode(main: int, sub: int = 0) -> None:
        connection.set_mode_px4(mask, main, sub)

    connection.recv_match(type="HOME_POSITION", blocking=True, timeout=PATIENCE_S)
    script.target_local(POSITION, 0.0, 0.0, -3.0)
    set_mode(MAIN_MODES["OFFBOARD"])
    connection.arducopter_arm()
    connection.motors_armed_wait()
    script.fly(
        lambda: script.target_local(POSITION, 2.0, 1.0, -3.0), lambda p: math.dist((p.x, p.y, p.z), (2, 1, -3)) < 0.2
    )
    velocity = 0.0, 0.0, 0.0, 0.0, 2.0, 0.0
    script.fly(lambda: script.target_local(VELOCITY, *velocity), lambda p: abs(p.vy - 2.0) < 0.1)
    assert connection.flightmode == "OFFBOARD"

    script.mav.manual_control_send(1, 0, 0, 500, 0, 0)
    set_mode(MAIN_MODES["POSCTL"])
    script.fly(lambda: script.mav.manual_control_send(1, 500, 0, 500, 0, 0), lambda p: p.vx > 1.5)
    script.fly(
        lambda: script.mav.rc_channels_override_send(*script.target, 1500, 1500, 1500, 1500, 0, 0, 0, 0),
        lambda p: math.hypot(p.vx, p.vy) < 0.2,
    )
    assert connection.flightmode == "POSCTL"
    set_mode(*LAND)
    connection.motors_disarmed_wait()
    assert not connection.motors_armed()
