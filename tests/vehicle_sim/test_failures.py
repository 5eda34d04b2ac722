"""Injected failures: what is answered, what stops, and what the vehicle then does by PX4's parameters."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import HOLD, LAND, RETURN, ForeignPilot, airframe_with, tilted
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.sensors.faults import BLINK_NS, LATE_NS, SLOW_NS, Failure, Fault

INJECT = mavlink.MAV_CMD_INJECT_FAILURE
MAG, BARO, GPS, VIO, RANGE, BATTERY, MOTOR, GYRO = 2, 3, 4, 6, 7, 100, 101, 0
OK, OFF, STUCK = 0, 1, 2
ACCEPTED, DENIED, UNSUPPORTED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_UNSUPPORTED
TICK_NS = 4_000_000
GNSS = airframe_with('estimator.sensors="gnss"')


def aloft(charge: float = 1.0, sensors: bool = False) -> ForeignPilot:
    """In hold at 2.5 m. The battery's capacity is such that nothing of it is used up."""
    changes = [f"battery.charge={charge}", "battery.capacity_wh=1e6"]
    pilot = ForeignPilot(airframe=airframe_with(*changes, *(['estimator.sensors="gnss"'] if sensors else [])), seed=1)
    pilot.fly(1.2)
    pilot.vehicle.flight.arm()
    pilot.vehicle.flight.take_off(2.5)
    assert pilot.fly(10.0, until=lambda: pilot.vehicle.flight.mode is Mode.HOLD)
    pilot.vehicle.flight.home_ned = (50.0, 0.0, 0.0)  # a way to return
    return pilot


def mode_of(pilot: ForeignPilot) -> Mode:
    return pilot.vehicle.flight.mode


def readings(failure: Failure, count: int = 1000) -> list[tuple[int, float] | None]:
    """What a sensor that tells the time (s) reads: when, and what; it is healthy for the first second."""
    fault, found = Fault(np.array((1000.0,)), np.random.default_rng(1)), list[tuple[int, float] | None]()
    for tick in range(250 + count):
        if tick == 250:
            fault.failure = failure
        at_ns = tick * TICK_NS
        read = fault.read(np.array((at_ns * 1e-9,)), at_ns)
        if tick >= 250:
            found.append(None if read is None else (at_ns, float(read[0])))
    return found


def test_each_failure_of_a_sensor_is_what_its_name_says() -> None:
    assert all(read == (read[0], read[0] * 1e-9) for read in readings(Failure.OK) if read)
    assert readings(Failure.OFF) == [None] * 1000
    assert {round(read[1], 6) for read in readings(Failure.STUCK) if read} == {0.996}
    wrong = readings(Failure.WRONG)
    assert all(read is not None and read[1] - read[0] * 1e-9 == pytest.approx(1000.0) for read in wrong)
    errors = np.array([read[1] - read[0] * 1e-9 for read in readings(Failure.GARBAGE) if read])
    assert errors.std() == pytest.approx(1000.0, rel=0.1) and abs(errors.mean()) < 100.0
    slow = [read[0] for read in readings(Failure.SLOW) if read]
    assert set(np.diff(slow)) == {SLOW_NS}
    late = [read for read in readings(Failure.DELAYED) if read]
    assert all(read[0] - round(read[1] * 1e9) == LATE_NS for read in late) and len(late) == 1000
    here = np.array([read is not None for read in readings(Failure.INTERMITTENT)])
    changes = np.flatnonzero(np.diff(here)) * TICK_NS
    assert set(np.diff(changes)) == {BLINK_NS}


def test_answers_are_px4s() -> None:
    pilot = ForeignPilot(airframe=GNSS)
    for unit in (MAG, BARO, GPS, RANGE):
        for failure in range(8):
            assert pilot.command(INJECT, unit, failure) == ACCEPTED
    for unit in (BATTERY, MOTOR):
        assert [pilot.command(INJECT, unit, failure) for failure in (OFF, OK, STUCK)] == [
            ACCEPTED,
            ACCEPTED,
            UNSUPPORTED,
        ]
    assert pilot.command(INJECT, MOTOR, OFF, 5) == UNSUPPORTED
    assert pilot.command(INJECT, GYRO, OFF) == UNSUPPORTED
    assert pilot.command(INJECT, GPS, 8) == UNSUPPORTED
    pilot.vehicle.parameters.set("SYS_FAILURE_EN", 0)
    assert pilot.command(INJECT, GPS, OK) == DENIED


def test_a_vehicle_that_knows_the_truth_has_no_receiver_to_fail() -> None:
    pilot = ForeignPilot()
    assert pilot.command(INJECT, GPS, OFF) == UNSUPPORTED
    assert pilot.command(INJECT, RANGE, OFF) == ACCEPTED


def test_a_lidar_that_is_off_says_nothing_and_sys_status_says_so() -> None:
    pilot = ForeignPilot(all_streams=True)
    pilot.fly(1.1)
    assert pilot.last("SYS_STATUS").onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_PROXIMITY
    pilot.command(INJECT, RANGE, OFF)
    since = pilot.time_s
    pilot.fly(1.1)
    assert not pilot.all("OBSTACLE_DISTANCE", since) and not pilot.all("DISTANCE_SENSOR", since)
    assert not pilot.last("SYS_STATUS").onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_PROXIMITY
    pilot.command(INJECT, RANGE, OK)
    pilot.fly(0.2)
    assert pilot.all("OBSTACLE_DISTANCE", since)


@pytest.mark.parametrize(
    ("unit", "bit"),
    [
        (MAG, mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG),
        (BARO, mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE),
        (GPS, mavlink.MAV_SYS_STATUS_SENSOR_GPS),
    ],
)
def test_sys_status_names_the_sensor_that_is_off(unit: int, bit: int) -> None:
    pilot = ForeignPilot(airframe=GNSS, all_streams=True)
    pilot.fly(2.1)
    before = pilot.last("SYS_STATUS").onboard_control_sensors_health
    pilot.command(INJECT, unit, OFF)
    pilot.fly(3.0)
    assert before & bit and pilot.last("SYS_STATUS").onboard_control_sensors_health == before & ~bit


# --- position ---


def test_without_fixes_the_position_is_lost_and_the_vehicle_descends() -> None:
    """After EKF2_NOAID_TOUT; then nothing is said of the place on earth, and no mode that needs it is entered. The
    local position goes on, as with PX4; the estimator's status tells."""
    pilot = aloft(sensors=True)
    position = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    pilot.interval(position, 20_000)
    pilot.interval(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 100_000)
    pilot.interval(mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS, 1_000_000)
    pilot.command(INJECT, GPS, OFF)
    began = pilot.time_s
    assert pilot.fly(8.0, until=lambda: mode_of(pilot) is Mode.DESCEND)
    assert pilot.time_s - began == pytest.approx(5.1, abs=0.25)
    assert pilot.mode == LAND and "Failsafe: no position, descending" in pilot.texts
    assert pilot.set_mode(HOLD) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    since = pilot.time_s
    assert pilot.fly(15.0, until=lambda: not pilot.vehicle.flight.armed)
    assert not pilot.all("GLOBAL_POSITION_INT", since) and len(pilot.all("LOCAL_POSITION_NED", since)) > 100
    assert not pilot.last("ESTIMATOR_STATUS").flags & mavlink.ESTIMATOR_POS_HORIZ_REL
    assert pilot.vehicle.flight.crash is None and pilot.vehicle.flight.landed
    assert pilot.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) != ACCEPTED
    assert "Arming denied: Navigation error: No valid position estimate" in "".join(pilot.texts)


def test_before_the_first_fix_nothing_is_armed() -> None:
    pilot = ForeignPilot(airframe=GNSS)
    pilot.command(INJECT, GPS, OFF)
    pilot.fly(2.0)
    assert pilot.arm() != ACCEPTED
    assert "Arming denied: Navigation error: No valid position estimate" in "".join(pilot.texts)
    pilot.command(INJECT, GPS, OK)
    pilot.fly(1.0)
    assert pilot.arm() == ACCEPTED


def test_an_odometry_that_is_off_takes_the_position_with_it() -> None:
    pilot = ForeignPilot(airframe=airframe_with('estimator.sensors="vio"'), all_streams=True)
    pilot.fly(1.0)
    assert pilot.command(INJECT, GPS, OFF) == UNSUPPORTED
    assert pilot.command(INJECT, VIO, OFF) == ACCEPTED
    pilot.fly(7.0)
    vision = mavlink.MAV_SYS_STATUS_SENSOR_VISION_POSITION
    assert not pilot.last("SYS_STATUS").onboard_control_sensors_health & vision
    assert pilot.vehicle.flight.watch.health.position_lost


def test_an_attitude_is_flown_without_a_position() -> None:
    pilot = aloft(sensors=True)
    pilot.go_offboard()
    pilot.command(INJECT, GPS, OFF)
    pilot.fly(6.0, pilot.attitude)
    assert mode_of(pilot) is Mode.OFFBOARD and pilot.vehicle.flight.watch.health.position_lost
    assert pilot.set_mode(LAND) == ACCEPTED, "as PX4, which descends then"
    pilot.fly(0.1)
    assert mode_of(pilot) is Mode.DESCEND


# --- battery ---


def drained(pilot: ForeignPilot, charge: float) -> None:
    """From the next look at the battery on it has this charge."""
    pilot.vehicle.airframe = airframe_with(f"battery.charge={charge}", "battery.capacity_wh=1e6")


@pytest.mark.parametrize(
    ("action", "critical", "emergency"),
    [(0, Mode.HOLD, Mode.HOLD), (1, Mode.RETURN, Mode.RETURN), (2, Mode.LAND, Mode.LAND), (3, Mode.RETURN, Mode.LAND)],
)
def test_a_low_battery_acts_in_three_stages(action: int, critical: Mode, emergency: Mode) -> None:
    pilot = aloft(0.2)
    pilot.vehicle.parameters.set("COM_LOW_BAT_ACT", action)
    drained(pilot, 0.14)
    pilot.fly(0.2)
    assert mode_of(pilot) is Mode.HOLD and pilot.texts[-1] == "Low battery level" and not pilot.vehicle.flight.failsafe
    drained(pilot, 0.06)
    began = pilot.time_s
    pilot.fly(0.2)
    assert mode_of(pilot) is Mode.HOLD and "Critical battery level" in pilot.texts
    assert pilot.fly(6.0, until=lambda: mode_of(pilot) is not Mode.HOLD) is (critical is not Mode.HOLD)
    assert mode_of(pilot) is critical
    if critical is not Mode.HOLD:
        assert pilot.time_s - began == pytest.approx(5.05, abs=0.06), "after COM_FAIL_ACT_T"
    drained(pilot, 0.04)
    pilot.fly(0.2)
    assert mode_of(pilot) is emergency and "Emergency battery level" in pilot.texts


def test_the_thresholds_are_parameters_and_a_command_ends_the_hold() -> None:
    pilot = aloft(0.3)
    pilot.vehicle.parameters.set("BAT_CRIT_THR", 0.25)
    drained(pilot, 0.24)
    pilot.fly(0.2)
    assert pilot.vehicle.flight.failsafe
    pilot.set_mode(HOLD)
    pilot.fly(7.0)
    assert mode_of(pilot) is Mode.HOLD and not pilot.vehicle.flight.failsafe


def test_a_battery_that_was_low_at_arming_acts_when_it_is_lower() -> None:
    pilot = aloft(0.10)
    pilot.fly(0.5)
    assert "Low battery level" not in pilot.texts
    drained(pilot, 0.06)
    pilot.fly(5.3)
    assert mode_of(pilot) is Mode.RETURN


def test_a_return_becomes_a_landing_in_the_emergency_and_no_hold() -> None:
    pilot = aloft(0.2)
    pilot.set_mode(RETURN)
    drained(pilot, 0.06)
    pilot.fly(0.2)
    assert mode_of(pilot) is Mode.RETURN
    drained(pilot, 0.04)
    pilot.fly(0.2)
    assert mode_of(pilot) is Mode.LAND


def test_a_critical_battery_arms_nothing() -> None:
    pilot = ForeignPilot(airframe=airframe_with("battery.charge=0.06"))
    pilot.fly(1.2)
    assert pilot.arm() != ACCEPTED and "Arming denied: Critical battery level" in pilot.texts


def test_an_empty_battery_lands_the_vehicle() -> None:
    """PX4's simulation says that it is empty, and goes on to give power."""
    pilot = aloft()
    pilot.command(INJECT, BATTERY, OFF)
    assert pilot.fly(6.0, until=lambda: mode_of(pilot) is Mode.LAND)


# --- attitude and motors ---


def test_a_motor_that_is_off_tumbles_the_vehicle_and_is_told() -> None:
    pilot = aloft()
    pilot.command(INJECT, MOTOR, OFF, 2)
    began = pilot.time_s
    assert pilot.fly(1.0, until=lambda: "Motor failure detected" in pilot.texts)
    assert 0.1 <= pilot.time_s - began < 0.25, "FD_ACT_MOT_TOUT after it has slowed down"
    assert pilot.fly(5.0, until=lambda: pilot.vehicle.flight.crash is not None)


def test_a_motor_that_the_mixer_holds_still_has_not_failed() -> None:
    """At half thrust a torque takes all of it from one rotor; PX4 looks at each motor's own command."""
    pilot = aloft()
    pilot.fly(0.3, pilot.attitude)
    pilot.go_offboard()
    flight = pilot.vehicle.flight
    rest = 0.1 * flight.watch.health.full_speed
    still: list[float] = []

    def roll_hard() -> None:
        flight.setpoints.torque([1.0, 0.0, 0.0, 0.5], flight.motion.time_ns)
        if min(flight.motion.rotor_speeds) < rest:
            still.append(pilot.time_s)

    pilot.fly(0.5, roll_hard)
    assert still[-1] - still[0] > 0.15 and flight.crash is None, "longer than FD_ACT_MOT_TOUT"
    assert "Motor failure detected" not in pilot.texts


@pytest.mark.parametrize("breaker", [0, 121212])
def test_too_much_tilt_terminates_where_the_breaker_allows(breaker: int) -> None:
    pilot = aloft()
    for name, value in (("FD_FAIL_R", 60), ("FD_FAIL_P", 60), ("CBRK_FLIGHTTERM", breaker)):
        assert pilot.vehicle.parameters.set(name, value) is None
    pilot.fly(3.0)
    since: list[float] = []

    def lean() -> None:
        pilot.attitude(tilted(1.2, (1.0, 0.0, 0.0)), 0.9)
        if not since and pilot.vehicle.motion.tilt > np.radians(60.0):
            since.append(pilot.time_s)

    pilot.go_offboard()
    stopped = pilot.fly(1.5, lean, until=lambda: mode_of(pilot) is Mode.TERMINATION)
    assert stopped is (breaker == 0) and "Attitude failure detected" in pilot.texts
    if stopped:
        assert pilot.time_s - since[0] == pytest.approx(0.3, abs=0.02)


def test_below_the_limit_nothing_fails() -> None:
    pilot = aloft()
    for name, value in (("FD_FAIL_R", 75), ("FD_FAIL_P", 75), ("CBRK_FLIGHTTERM", 0)):
        pilot.vehicle.parameters.set(name, value)
    pilot.go_offboard()
    pilot.fly(1.0, lambda: pilot.attitude(tilted(1.2, (1.0, 0.0, 0.0)), 0.9))
    assert mode_of(pilot) is Mode.OFFBOARD
