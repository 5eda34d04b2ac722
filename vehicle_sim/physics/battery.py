"""The battery: its voltage falls linearly with the energy that has been used."""

from typing import NamedTuple

from vehicle_sim.airframe import Airframe
from vehicle_sim.physics.motion import Motion


class BatteryState(NamedTuple):
    volts: float
    amperes: float
    used_wh: float
    remaining: float
    """Of 1.0."""


def is_empty(airframe: Airframe, motion: Motion) -> bool:
    """All that it held has been used."""
    b = airframe.battery
    return motion.shaft_energy_j / b.efficiency + b.idle_w * motion.time_ns * 1e-9 >= b.charge * b.capacity_wh * 3600.0


def battery_state(airframe: Airframe, motion: Motion) -> BatteryState:
    """At a motion, whose shaft energy and time since boot tell what has been used."""
    b = airframe.battery
    used_wh = (motion.shaft_energy_j / b.efficiency + b.idle_w * motion.time_ns * 1e-9) / 3600.0
    remaining = max(0.0, b.charge - used_wh / b.capacity_wh)
    volts = b.empty_v + (b.full_v - b.empty_v) * remaining
    shaft_w = (
        airframe.body.torque_per_thrust_m
        * airframe.rotors.thrust_constant_ns2
        * sum(speed**3 for speed in motion.rotor_speeds)
    )
    return BatteryState(volts, (shaft_w / b.efficiency + b.idle_w) / volts, used_wh, remaining)
