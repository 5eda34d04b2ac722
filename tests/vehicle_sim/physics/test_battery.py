"""The battery: what it has given is what rotors and electronics have taken."""

import numpy as np
import pytest

from tests.vehicle_sim.foreign_pilot import AIRFRAME
from vehicle_sim.physics.battery import battery_state
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
