"""The battery: its voltage falls linearly with the energy that has been used, and with the current."""

import math
from typing import NamedTuple

from vehicle_sim.airframe import Airframe
from vehicle_sim.physics.motion import Motion


class BatteryState(NamedTuple):
    volts: float
    amperes: float
    used_wh: float
    remaining: float
    """Charge that remains, 0..1."""


def is_empty(airframe: Airframe, motion: Motion) -> bool:
    """All that it held has been used."""
    b = airframe.battery
    return motion.shaft_energy_j / b.efficiency + b.idle_w * motion.time_ns * 1e-9 >= b.charge * b.capacity_wh * 3600.0


def battery_state(airframe: Airframe, motion: Motion) -> BatteryState:
    """At a motion, whose shaft energy and time since boot tell what has been used."""
    b = airframe.battery
    used_wh = (motion.shaft_energy_j / b.efficiency + b.idle_w * motion.time_ns * 1e-9) / 3600.0
    remaining = max(0.0, b.charge - used_wh / b.capacity_wh)
    open_v = b.empty_v + (b.full_v - b.empty_v) * remaining
    shaft_w = (
        airframe.body.torque_per_thrust_m
        * airframe.rotors.thrust_constant_ns2
        * sum(speed**3 for speed in motion.rotor_speeds)
    )
    watts = shaft_w / b.efficiency + b.idle_w
    volts = _at_load(open_v, watts, b.internal_resistance_ohm) if b.internal_resistance_ohm else open_v
    return BatteryState(volts, watts / volts, used_wh, remaining)


def _at_load(open_v: float, watts: float, ohms: float) -> float:
    """The voltage that gives a power behind a resistance; half of the open one where it can't."""
    return 0.5 * (open_v + math.sqrt(max(0.0, open_v * open_v - 4.0 * ohms * watts)))
