"""POSITION_TARGET_LOCAL_NED and POSITION_TARGET_GLOBAL_INT: what each mode flies to, read by pymavlink."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import AIRFRAME, LAND, RETURN, ForeignPilot
from vehicle_sim.autopilot.modes import Mode

LOCAL, GLOBAL = (getattr(mavlink, f"MAVLINK_MSG_ID_POSITION_TARGET_{name}") for name in ("LOCAL_NED", "GLOBAL_INT"))
FREE_POSITION, FREE_VELOCITY, FREE_ACCELERATION = 7, 7 << 3, 7 << 6
FREE_YAW, FREE_YAW_RATE = 1 << 10, 1 << 11
PLACE_ALONE = FREE_VELOCITY | FREE_ACCELERATION | FREE_YAW_RATE


@pytest.fixture
def aloft() -> ForeignPilot:
    pilot = ForeignPilot()
    pilot.take_off()
    for message in (LOCAL, GLOBAL):
        pilot.interval(message, 4000)
    pilot.fly(0.004)
    return pilot


def fields(message: Any) -> list[float]:
    return [message.x, message.y, message.z, message.vx, message.vy, message.vz, message.yaw, message.yaw_rate]


def said(pilot: ForeignPilot) -> set[str]:
    """Which of the two come with the next tick."""
    before = pilot.time_s
    pilot.fly(0.004)
    return {name for name in ("LOCAL_NED", "GLOBAL_INT") if pilot.all(f"POSITION_TARGET_{name}", before)}


def test_on_the_ground_there_is_no_target() -> None:
    pilot = ForeignPilot()
    for message in (LOCAL, GLOBAL):
        pilot.interval(message, 4000)
    assert said(pilot) == set()


def test_a_hold_is_told_in_both_frames(aloft: ForeignPilot) -> None:
    aloft.fly(5.0)
    local, place = aloft.last("POSITION_TARGET_LOCAL_NED"), aloft.last("POSITION_TARGET_GLOBAL_INT")
    assert (local.coordinate_frame, local.type_mask) == (mavlink.MAV_FRAME_LOCAL_NED, PLACE_ALONE)
    assert fields(local)[:3] == pytest.approx([0.0, 0.0, -aloft.height], abs=0.02)
    assert all(math.isnan(value) for value in (local.vx, local.vy, local.vz, local.afx, local.yaw_rate))
    origin = [math.degrees(angle) * 1e7 for angle in aloft.vehicle.world.origin[:2]]
    assert (place.coordinate_frame, place.type_mask) == (mavlink.MAV_FRAME_GLOBAL_INT, PLACE_ALONE)
    assert [place.lat_int, place.lon_int] == pytest.approx(origin, abs=2.0)
    assert place.alt == pytest.approx(aloft.vehicle.world.origin[2] + aloft.height, abs=0.05)


def test_a_return_leads_home_and_a_landing_goes_down_at_a_speed(aloft: ForeignPilot) -> None:
    aloft.set_mode(RETURN)
    aloft.fly(0.1)
    assert fields(aloft.last("POSITION_TARGET_LOCAL_NED"))[:2] == pytest.approx([0.0, 0.0], abs=0.05)
    aloft.set_mode(LAND)
    aloft.fly(0.1)
    local, place = aloft.last("POSITION_TARGET_LOCAL_NED"), aloft.last("POSITION_TARGET_GLOBAL_INT")
    assert local.type_mask == place.type_mask == PLACE_ALONE & ~(1 << 5) | 1 << 2
    assert math.isnan(local.z) and math.isnan(place.alt)
    assert 0.0 < local.vz <= AIRFRAME.auto.descent_speed_m_s


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        (PLACE_ALONE & ~FREE_YAW, [3.0, -2.0, -6.0, None, None, None, 0.5, None]),
        (FREE_POSITION | FREE_ACCELERATION | FREE_YAW, [None, None, None, 0.4, -0.3, 0.2, None, 0.1]),
    ],
)
def test_offboard_setpoints_are_told_as_they_were_given(
    aloft: ForeignPilot, mask: int, expected: list[float | None]
) -> None:
    frame = mavlink.MAV_FRAME_LOCAL_NED
    given = (3.0, -2.0, -6.0, 0.4, -0.3, 0.2, 0.0, 0.0, 0.0, 0.5, 0.1)
    message = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *given)
    aloft.go_offboard(lambda: aloft.send(message))
    assert said(aloft) == {"LOCAL_NED"}, "as PX4, whose modes alone have a place on earth"
    told = aloft.last("POSITION_TARGET_LOCAL_NED")
    assert told.type_mask == mask
    assert fields(told) == pytest.approx([math.nan if value is None else value for value in expected], nan_ok=True)


def test_where_no_position_is_controlled_nothing_is_told(aloft: ForeignPilot) -> None:
    aloft.go_offboard()
    assert said(aloft) == set(), "an attitude is flown"
    for mode, told in ((Mode.POSITION, {"LOCAL_NED"}), (Mode.ALTITUDE, {"LOCAL_NED"}), (Mode.STABILIZED, set())):
        aloft.send(mavlink.MAVLink_manual_control_message(1, 300, 0, 500, 0, 0))
        aloft.set_mode(mode.custom_mode)
        aloft.fly(0.02)
        assert said(aloft) == told, mode
        if mode is Mode.POSITION:
            assert fields(aloft.last("POSITION_TARGET_LOCAL_NED"))[3] == pytest.approx(
                0.3 * AIRFRAME.auto.cruise_speed_m_s
            )


def test_where_an_attitude_falls_silent_the_place_to_brake_to_is_told(aloft: ForeignPilot) -> None:
    aloft.go_offboard()
    aloft.fly(0.75 * aloft.vehicle.flight.settings.stream_loss_ns * 1e-9)
    told = aloft.last("POSITION_TARGET_LOCAL_NED")
    assert told.type_mask == PLACE_ALONE
    assert fields(told)[:3] == pytest.approx(list(aloft.vehicle.motion.position_ned), abs=0.1)
