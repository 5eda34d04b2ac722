"""Modes and vehicles by their makers' names."""

import pytest

from companion.view.vehicle_names import mode_name, vehicle_name
from protocol.messages import dialect

PX4, ARDUPILOT = dialect.MAV_AUTOPILOT_PX4, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
QUAD, PLANE = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_TYPE_FIXED_WING


@pytest.mark.parametrize(
    ("autopilot", "vehicle", "mode", "name"),
    [
        (PX4, QUAD, 6 << 16, "Offboard"),
        (PX4, QUAD, 3 << 16, "Position"),
        (PX4, QUAD, 3 << 16 | 1 << 24, "Orbit"),
        (PX4, QUAD, 3 << 16 | 2 << 24, "Position slow"),
        (PX4, QUAD, 3 << 16 | 99 << 24, "Position"),
        (PX4, QUAD, 10 << 16, "Termination"),
        (PX4, QUAD, 11 << 16, "Altitude cruise"),
        (PX4, QUAD, 4 << 16 | 3 << 24, "Hold"),
        (PX4, QUAD, 4 << 16 | 6 << 24, "Land"),
        (PX4, QUAD, 4 << 16 | 99 << 24, f"mode {4 << 16 | 99 << 24}"),
        (ARDUPILOT, QUAD, 4, "Guided"),
        (ARDUPILOT, QUAD, 2, "Alt hold"),
        (ARDUPILOT, PLANE, 10, "Auto"),
        (ARDUPILOT, QUAD, 10, "mode 10"),
        (dialect.MAV_AUTOPILOT_GENERIC, QUAD, 4, "mode 4"),
    ],
)
def test_modes(autopilot: int, vehicle: int, mode: int, name: str) -> None:
    assert mode_name(autopilot, vehicle, mode) == name


def test_vehicles() -> None:
    assert vehicle_name(PX4, QUAD) == "PX4 quadrotor"
    assert vehicle_name(ARDUPILOT, PLANE) == "ArduPilot fixed wing"
    assert vehicle_name(dialect.MAV_AUTOPILOT_GENERIC, 250) == "vehicle"
