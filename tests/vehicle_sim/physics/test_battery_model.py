"""The battery: what it has given is what rotors and electronics have taken."""

import numpy as np
import pytest

from tests.vehicle_sim.foreign_pilot import AIRFRAME, ForeignPilot, airframe_with
from vehicle_sim.physics.battery import battery_state, is_empty
from vehicle_sim.physics.motion import FEEDBACK, Motion
from vehicle_sim.physics.rigid_body import ROTORS, STATES

BATTERY = AIRFRAME.battery


def motion(seconds: float, shaft_energy_j: float = 0.0, rotor_speed: float = 0.0) -> Motion:
    state, feedback = np.zeros(STATES), np.zeros(1, FEEDBACK)
    state[6], state[ROTORS] = 1.0, rotor_speed
    feedback["shaft_energy_j"] = shaft_energy_j
    return Motion.of(round(seconds * 1e9), state, feedback)


def test_at_rest_the_electronics_alone_use_it() -> None:
    hour = battery_state(AIRFRAME, motion(3600.0))
    assert hour.used_wh == pytest.approx(BATTERY.idle_w)
    assert hour.volts * hour.amperes == pytest.approx(BATTERY.idle_w)


def test_power_is_the_rate_of_the_energy_used() -> None:
    """The shaft power of turning rotors, over some seconds, against the energy that the ticks add up."""
    speed, seconds = 350.0, 100.0
    shaft_w = 4.0 * AIRFRAME.body.torque_per_thrust_m * AIRFRAME.rotors.thrust_constant_ns2 * speed**3
    state = battery_state(AIRFRAME, motion(seconds, shaft_w * seconds, speed))
    assert state.volts * state.amperes * seconds / 3600.0 == pytest.approx(state.used_wh)


def test_voltage_falls_from_full_to_empty() -> None:
    full, empty = battery_state(AIRFRAME, motion(0.0)), battery_state(AIRFRAME, motion(0.0, 1e9))
    assert (full.volts, full.remaining) == (BATTERY.full_v, 1.0)
    assert (empty.volts, empty.remaining) == (BATTERY.empty_v, 0.0)


@pytest.mark.parametrize("charge", [1.0, 0.3])
def test_it_is_empty_when_its_charge_has_been_used(charge: float) -> None:
    airframe = airframe_with(f"battery.charge={charge}")
    assert battery_state(airframe, motion(0.0)).remaining == charge
    lasts = charge * BATTERY.capacity_wh / BATTERY.idle_w * 3600.0
    for seconds, empty in ((0.999 * lasts, False), (1.001 * lasts, True)):
        assert is_empty(airframe, motion(seconds)) is empty
        assert (battery_state(airframe, motion(seconds)).remaining == 0.0) is empty


def test_a_vehicle_whose_battery_is_empty_falls_and_is_not_armed_again() -> None:
    pilot = ForeignPilot(airframe=airframe_with("battery.capacity_wh=1.0"))
    vehicle = pilot.vehicle
    pilot.fly(1.5)
    vehicle.flight.arm()
    vehicle.flight.take_off(3.0)
    assert pilot.fly(60.0, until=lambda: not vehicle.flight.armed) and -vehicle.motion.position_ned[2] > 2.5
    assert vehicle.flight.crash is None
    assert pilot.fly(5.0, until=lambda: vehicle.flight.crash is not None), "it hits the ground"
    assert any("Battery empty" in text for text in pilot.texts)


def test_an_empty_battery_arms_nothing() -> None:
    pilot = ForeignPilot(airframe=airframe_with("battery.capacity_wh=0.002"))
    vehicle = pilot.vehicle
    vehicle.flight.arm(force=True)
    pilot.fly(2.0)
    assert not vehicle.flight.armed and vehicle.flight.arming_problem() == "battery empty"
