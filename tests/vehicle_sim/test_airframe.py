"""The files in vehicles/: consistent with themselves, and flown as their model says."""

import math
from pathlib import Path

import pytest

from protocol.toml_files import TomlFileError, find
from tests.vehicle_sim.foreign_pilot import ForeignPilot, airframe_with
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


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("rotors.time_constant_up_s=1e-4", "rotors.time_constant_up_s"),
        ("rotors.lag_share=[1.0, 1.0, 1.0, 0.001]", "rotors.time_constant_up_s"),
        ("body.drag_kg_s=[0.0, 5000.0, 0.0]", "body.drag_kg_s"),
        ("ground.stiffness_n_m=1.0", "ground.stiffness_n_m"),
        ("body.rotor_max_thrust_n=1.0", "body.rotor_max_thrust_n"),
        ("battery.empty_v=100.0", "battery.empty_v"),
    ],
)
def test_a_vehicle_that_can_not_be_flown_is_refused(override: str, key: str) -> None:
    """Its motion would be no number, or thousands of kilometres high, or under the ground."""
    with pytest.raises(TomlFileError, match=key):
        airframe_with(override)


@pytest.mark.parametrize("override", ["rotors.time_constant_up_s=5.1e-4", "body.drag_kg_s=[2500.0, 2500.0, 2500.0]"])
def test_the_limits_of_a_vehicle_file_can_be_flown(override: str) -> None:
    pilot = ForeignPilot(airframe=airframe_with(override))
    pilot.fly(1.2)
    pilot.vehicle.flight.arm()
    pilot.vehicle.flight.take_off(2.0)
    pilot.fly(5.0)
    down = pilot.vehicle.motion.position_ned[2]
    assert -2.5 < down < 0.0 and pilot.vehicle.flight.crash is None
