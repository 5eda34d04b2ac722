"""Quantities of the vehicle's own sensors in units that people know."""

import numpy as np
import pytest

from companion.view.columns import Columns, message_columns
from protocol.flightlog.mavlink_records import message_type
from protocol.messages import dialect


def columns(name: str, **fields: float) -> Columns:
    table = np.zeros(1, message_type(getattr(dialect, f"MAVLINK_MSG_ID_{name}"), "/x")[0].dtype)
    for field, value in fields.items():
        table[field] = value
    return message_columns(name, table)


def test_inertial_sensors_in_one_unit() -> None:
    """Rest on the ground is 1 g upwards, and 1 rad/s is 57.3 deg/s, whoever tells it."""
    fine = columns("HIGHRES_IMU", zacc=-9.80665, zgyro=1.0, temperature=41.5)
    coarse = columns("RAW_IMU", zacc=-1000, zgyro=1000, temperature=4150)
    for told in (fine, coarse):
        assert told["acceleration"][0] == pytest.approx((0.0, 0.0, -9.80665), rel=1e-6)
        assert told["gyro_deg"][0] == pytest.approx((0.0, 0.0, 57.29578), rel=1e-6)
        assert told["temperature"] == pytest.approx([41.5])
    assert np.isnan(columns("RAW_IMU", temperature=0)["temperature"]).all(), "not told"


def test_what_is_unknown_is_not_drawn() -> None:
    told = columns("RC_CHANNELS", chan1_raw=1500, chan2_raw=65535, rssi=254)
    assert told["pulses"][0, 0] == 1500.0 and np.isnan(told["pulses"][0, 1:]).all()
    assert told["strength"] == pytest.approx([100.0])
    assert np.isnan(columns("RC_CHANNELS", rssi=255)["strength"]).all()
    gps = columns("GPS_RAW_INT", eph=120, epv=65535)
    assert gps["hdop"] == pytest.approx([1.2]) and np.isnan(gps["vdop"]).all()
    assert columns("SCALED_PRESSURE", temperature=2150)["temperature"] == pytest.approx([21.5])
    assert np.isnan(columns("BATTERY_STATUS", temperature=32767)["temperature"]).all()


def test_a_position_s_height_is_up_and_its_speed_that_of_all_axes() -> None:
    """One number that is none is not drawn, and the others are."""
    motion = {"x": 1.0, "y": 2.0, "z": -3.0, "vx": 2.0, "vy": -3.0, "vz": 6.0}
    told = columns("LOCAL_POSITION_NED", **motion)
    assert told["position_ned"][0].tolist() == [1.0, 2.0, -3.0] and told["height"] == pytest.approx([3.0])
    assert told["velocity_ned"][0].tolist() == [2.0, -3.0, 6.0] and told["speed"] == pytest.approx([7.0])
    odd = columns("LOCAL_POSITION_NED", **motion | {"x": 1e30, "vz": np.nan})
    assert np.isnan(odd["position_ned"][0]).tolist() == [True, False, False] and odd["height"] == pytest.approx([3.0])
    assert np.isnan(odd["velocity_ned"][0]).tolist() == [False, False, True] and np.isnan(odd["speed"]).all()
