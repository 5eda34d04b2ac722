"""When the motors stop, by a command and by themselves."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import OFFBOARD, ForeignPilot
from vehicle_sim.services.flight_commands import FORCE

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
ON_GROUND = mavlink.MAV_LANDED_STATE_ON_GROUND


@pytest.fixture
def pilot() -> ForeignPilot:
    return ForeignPilot()


@pytest.fixture
def aloft(pilot: ForeignPilot) -> ForeignPilot:
    pilot.take_off()
    return pilot


def test_disarming_in_the_air_only_by_force(aloft: ForeignPilot) -> None:
    assert aloft.disarm() == REJECTED
    assert aloft.armed
    assert "Disarming denied: not landed" in aloft.texts
    assert aloft.disarm(FORCE) == ACCEPTED
    assert not aloft.armed
    aloft.fly(2.0)
    assert "crash: hit ground" in aloft.texts


def test_disarms_when_it_does_not_take_off(pilot: ForeignPilot) -> None:
    pilot.fly(1.2)
    pilot.arm()
    armed_s = pilot.time_s
    assert pilot.fly(12.0, until=lambda: not pilot.armed)
    assert pilot.time_s - armed_s == pytest.approx(10.0, abs=0.05)
    assert not pilot.vehicle.finished


@pytest.fixture
def down_again(aloft: ForeignPilot) -> ForeignPilot:
    """It has landed in OFFBOARD just now, by its companion's thrust."""
    aloft.go_offboard()
    assert aloft.fly(9.0, lambda: aloft.attitude(thrust=0.455), until=lambda: aloft.vehicle.motion.touching)
    assert aloft.fly(2.0, lambda: aloft.attitude(thrust=0.0), until=lambda: aloft.landed_state == ON_GROUND)
    return aloft


def test_a_landing_in_offboard_disarms_as_any_other(down_again: ForeignPilot) -> None:
    """PX4's handleAutoDisarm makes no difference."""
    pilot, landed_s = down_again, down_again.time_s
    assert pilot.fly(3.0, lambda: pilot.attitude(thrust=0.0), until=lambda: not pilot.armed)
    assert pilot.time_s - landed_s == pytest.approx(2.0, abs=0.02)
    assert pilot.mode == OFFBOARD
    assert pilot.vehicle.summary().outcome == "landed"


def test_who_gives_thrust_on_the_ground_is_not_disarmed(down_again: ForeignPilot) -> None:
    """It is about to take off again; PX4's land detector says no more that it has landed."""
    pilot = down_again
    pilot.fly(1.9, lambda: pilot.attitude(thrust=0.0))
    pilot.fly(3.0, lambda: pilot.attitude(thrust=0.4))
    assert pilot.landed_state == ON_GROUND and pilot.armed
    pilot.fly(1.9, lambda: pilot.attitude(thrust=0.0))
    assert pilot.armed
