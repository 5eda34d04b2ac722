"""What the vehicle says of its sensors and its filter: as they read and as it believes, and nothing invented."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.frames import to_body, to_local
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import EMPTY, ForeignPilot, airframe_with
from vehicle_sim.estimation import kalman
from vehicle_sim.estimation.estimator import Estimator

GNSS = airframe_with('estimator.sensors="gnss"')
SENSED = ("HIGHRES_IMU", "SCALED_PRESSURE", "ESTIMATOR_STATUS", "VIBRATION")
ESTIMATED = ("ALTITUDE", "VFR_HUD", "SYSTEM_TIME", "GPS_RAW_INT", "ODOMETRY")


def id_of(name: str) -> int:
    return int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))


@pytest.fixture(scope="module")
def flown() -> ForeignPilot:
    pilot = ForeignPilot(airframe=GNSS, seed=3)
    for name in (*SENSED, *ESTIMATED):
        assert pilot.interval(id_of(name), 20_000) == mavlink.MAV_RESULT_ACCEPTED
    pilot.fly(1.0)
    pilot.vehicle.flight.arm()
    pilot.vehicle.flight.take_off(3.0)
    pilot.fly(9.0)
    return pilot


def estimator_of(pilot: ForeignPilot) -> Estimator:
    assert isinstance(pilot.vehicle.estimator, Estimator)
    return pilot.vehicle.estimator


def test_a_vehicle_that_knows_the_truth_has_no_sensors_to_tell_of() -> None:
    pilot = ForeignPilot()
    for name in SENSED:
        assert pilot.interval(id_of(name), 20_000) == mavlink.MAV_RESULT_DENIED
    for name in ESTIMATED:
        assert pilot.interval(id_of(name), 20_000) == mavlink.MAV_RESULT_ACCEPTED


def test_the_inertial_unit_reads_the_specific_force(flown: ForeignPilot) -> None:
    last = flown.all("HIGHRES_IMU", 6.0)
    force = np.mean([(m.xacc, m.yacc, m.zacc) for m in last], axis=0)
    assert force == pytest.approx((0.0, 0.0, -GRAVITY), abs=0.3)
    field = np.mean([(m.xmag, m.ymag, m.zmag) for m in last], axis=0)
    assert np.linalg.norm(field) == pytest.approx(0.48, abs=0.02) and field[2] > 0.4
    always = 0b111111 | 0b111 << 6
    assert {m.fields_updated for m in last} == {always, always | 1 << 9 | 1 << 11 | 1 << 12}, "pressure at 25 Hz"


def test_pressure_is_that_of_the_standard_atmosphere(flown: ForeignPilot) -> None:
    imu, scaled = flown.last("HIGHRES_IMU"), flown.last("SCALED_PRESSURE")
    assert scaled.press_abs == imu.abs_pressure
    tropopause = 288.15 / 0.0065 * (1.0 - (imu.abs_pressure / 1013.25) ** (1.0 / 5.25588))
    assert imu.pressure_alt == pytest.approx(tropopause, abs=0.5)
    assert imu.pressure_alt == pytest.approx(EMPTY.origin[2] + 3.0, abs=3.0)
    assert flown.last("ALTITUDE").altitude_monotonic == pytest.approx(imu.pressure_alt, abs=0.5)


def test_fixes_are_the_receiver_s(flown: ForeignPilot) -> None:
    """Late, five a second, with its own errors and what it says of them."""
    fixes = flown.all("GPS_RAW_INT", 2.0)
    times = sorted({fix.time_usec for fix in fixes})
    assert set(np.diff(times)) == {200_000}
    at = to_local(
        (math.radians(fixes[-1].lat * 1e-7), math.radians(fixes[-1].lon * 1e-7), fixes[-1].alt * 1e-3), EMPTY.origin
    )
    fix = estimator_of(flown).read.fix
    assert fix is not None and at == pytest.approx(fix.position_ned, abs=0.02)
    assert np.linalg.norm(at - flown.vehicle.motion.position_ned) > 0.02
    assert (fixes[-1].fix_type, fixes[-1].h_acc, fixes[-1].v_acc) == (3, 447, 894)


def test_odometry_s_covariance_is_the_filter_s(flown: ForeignPilot) -> None:
    odometry, P = flown.last("ODOMETRY"), estimator_of(flown).covariance
    pose, speed = np.zeros((6, 6)), np.zeros((6, 6))
    pose[np.triu_indices(6)], speed[np.triu_indices(6)] = odometry.pose_covariance, odometry.velocity_covariance
    assert np.diag(pose)[:3] == pytest.approx(np.diag(P)[6:9], rel=0.05)
    assert np.diag(pose)[3:] == pytest.approx(np.diag(P)[:3], rel=0.05)
    assert np.trace(speed[:3, :3]) == pytest.approx(np.trace(P[3:6, 3:6]), rel=0.1), "turned, and no larger"
    assert odometry.reset_counter == 0 and odometry.quality == 100


def test_the_velocity_s_covariance_is_of_what_the_body_sees() -> None:
    """First order: the difference of two estimates in the body against that in the world."""
    estimator = estimator_of(ForeignPilot(airframe=GNSS))
    q = np.array((0.8, 0.1, -0.3, 0.5))
    estimator.nominal[:4] = q / np.linalg.norm(q)
    estimator.nominal[4:7] = velocity = np.array((3.0, -1.0, 0.5))
    rng, found = np.random.default_rng(1), []
    moving = slice(kalman.GROUND)
    A = 1e-3 * rng.standard_normal((kalman.GROUND, kalman.GROUND))
    estimator.covariance[moving, moving] = A @ A.T
    for _ in range(4000):
        error, nominal = A @ rng.standard_normal(kalman.GROUND), estimator.nominal.copy()
        kalman.turn(nominal, *error[:3].tolist())
        found.append(np.array(to_body(nominal[:4], velocity + error[3:6])))
    assert np.cov(np.array(found).T) == pytest.approx(estimator.covariances[1, :3, :3], rel=0.15, abs=1e-6)


def test_the_filter_says_how_it_is(flown: ForeignPilot) -> None:
    status = flown.last("ESTIMATOR_STATUS")
    assert status.flags & mavlink.ESTIMATOR_POS_HORIZ_ABS and not status.flags & mavlink.ESTIMATOR_GPS_GLITCH
    assert 0.0 < status.pos_horiz_accuracy < 1.0 and 0.0 < status.pos_horiz_ratio < 1.0 and 0.0 < status.mag_ratio < 1.0
    assert flown.last("VFR_HUD").climb == pytest.approx(0.0, abs=0.3)
    assert flown.last("VIBRATION").clipping_0 == 0 and flown.last("VIBRATION").vibration_z > 0.0
    assert flown.last("SYSTEM_TIME").time_boot_ms == pytest.approx(flown.time_s * 1e3, abs=20)


def test_a_vehicle_with_an_odometry_has_no_receiver() -> None:
    """Nothing of it stands on earth, and SYS_STATUS names the odometry."""
    pilot = ForeignPilot(airframe=airframe_with('estimator.sensors="vio"'), all_streams=True)
    for name in ("GPS_RAW_INT", "ESTIMATOR_STATUS", "ODOMETRY"):
        pilot.interval(id_of(name), 20_000)
    pilot.fly(2.0)
    assert not pilot.all("GPS_RAW_INT")
    flags, sensors = pilot.last("ESTIMATOR_STATUS").flags, pilot.last("SYS_STATUS")
    assert flags & mavlink.ESTIMATOR_POS_HORIZ_REL and not flags & mavlink.ESTIMATOR_POS_HORIZ_ABS
    vision, receiver = mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION, mavlink.MAV_SYS_STATUS_SENSOR_GPS
    assert sensors.onboard_control_sensors_present & (vision | receiver) == vision
    assert sensors.onboard_control_sensors_health & vision
    assert 0.0 < pilot.last("ODOMETRY").pose_covariance[0] < 0.01


def test_what_is_known_of_the_ground_is_told() -> None:
    """With the beam downward in the filter; a second after it fails nothing is known any more."""
    airframe = airframe_with('estimator.sensors="gnss"', "estimator.range_finder=true")
    pilot = ForeignPilot(airframe=airframe, seed=3)
    for name in ("ALTITUDE", "ESTIMATOR_STATUS"):
        pilot.interval(id_of(name), 20_000)
    pilot.fly(1.0)
    pilot.vehicle.flight.arm()
    pilot.vehicle.flight.take_off(3.0)
    pilot.fly(9.0)
    above, status = pilot.last("ALTITUDE"), pilot.last("ESTIMATOR_STATUS")
    assert above.bottom_clearance == pytest.approx(-pilot.vehicle.motion.position_ned[2], abs=0.03)
    assert above.altitude_terrain == pytest.approx(above.altitude_amsl - above.bottom_clearance, abs=0.001)
    assert status.flags & mavlink.ESTIMATOR_POS_VERT_AGL and 0.0 < status.hagl_ratio < 1.0
    pilot.vehicle.flight.settings.failures_allowed = 1
    assert pilot.command(mavlink.MAV_CMD_INJECT_FAILURE, 7, 1) == mavlink.MAV_RESULT_ACCEPTED
    pilot.fly(1.2)
    assert math.isnan(pilot.last("ALTITUDE").bottom_clearance)
    assert not pilot.last("ESTIMATOR_STATUS").flags & mavlink.ESTIMATOR_POS_VERT_AGL


def test_without_the_beam_in_the_filter_nothing_is_told_of_the_ground(flown: ForeignPilot) -> None:
    assert math.isnan(flown.last("ALTITUDE").bottom_clearance) and math.isnan(flown.last("ALTITUDE").altitude_terrain)
    assert not flown.last("ESTIMATOR_STATUS").flags & mavlink.ESTIMATOR_POS_VERT_AGL
