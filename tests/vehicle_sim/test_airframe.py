"""The files in vehicles/: consistent with themselves, and flown as their model says."""

import math
from pathlib import Path

import pytest

from protocol.toml_files import find
from tests.vehicle_sim.foreign_pilot import ForeignPilot
from vehicle_sim.airframe import Airframe

VEHICLES = [
    path for path in sorted(find("vehicles", "paper_quad").parent.glob("*.toml")) if "[rotors]" in path.read_text()
]
"""Those that can be simulated; the others are for the companion alone."""


@pytest.mark.parametrize("path", VEHICLES, ids=lambda path: path.stem)
def test_the_body_table_agrees_with_the_simulators_tables(path: Path) -> None:
    """`[body]` says again, for the companion, what other tables tell the simulator."""
    airframe = Airframe.load(path)
    rotors, inner = airframe.rotors, airframe.inner_loop
    mean = 0.5 * (rotors.time_constant_up_s + rotors.time_constant_down_s)
    assert airframe.body.rotor_time_constant_s == pytest.approx(mean)
    assert airframe.body.rate_loop_gain_1_s == inner.rate_gain_1_s
    assert inner.attitude_gain_1_s[:2] == (airframe.body.attitude_loop_gain_1_s,) * 2


@pytest.mark.parametrize("path", VEHICLES, ids=lambda path: path.stem)
@pytest.mark.parametrize("axis", range(3))
def test_rate_loop_of_every_vehicle_follows_its_model(path: Path, axis: int) -> None:
    """A step of the rate overshoots as k / (tau s^2 + s + k) does, no more, and it hovers on with it."""
    airframe = Airframe.load(path)
    k, tau = airframe.inner_loop.rate_gain_1_s[axis], airframe.body.rotor_time_constant_s
    damping = 1.0 / (2.0 * math.sqrt(k * tau))
    assert damping >= 0.5
    pilot = ForeignPilot(airframe=airframe)
    pilot.take_off()
    pilot.go_offboard()
    asked = (0.3 * (axis == 0), 0.3 * (axis == 1), 0.3 * (axis == 2))
    peak = 0.0

    def turn() -> None:
        nonlocal peak
        peak = max(peak, pilot.vehicle.motion.rates_frd[axis])
        pilot.rates(asked)

    pilot.fly(0.5, turn)
    overshoot = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2)) if damping < 1.0 else 0.0
    assert peak / 0.3 - 1.0 == pytest.approx(overshoot, abs=0.04)
