"""What differs between the makes of vehicle."""

import pytest

from companion.link.firmware import firmware_of
from companion.link.firmware.ardupilot import FIRMWARE as ARDUPILOT
from companion.link.firmware.px4 import FIRMWARE as PX4
from companion.state import FlightMode, Output
from protocol.messages import dialect


def version(major: int, minor: int) -> int:
    return major << 24 | minor << 16 | 0xFF


def test_torques_are_refused_where_they_would_be_dropped_in_silence() -> None:
    assert PX4.refusal(Output.ACTUATORS, version(1, 13)) is None
    for newer in (version(1, 14), version(1, 16), version(2, 0)):
        assert "drops" in (PX4.refusal(Output.ACTUATORS, newer) or "")
        for output in (Output.RATES, Output.ATTITUDE):
            assert PX4.refusal(output, newer) is None


@pytest.mark.parametrize("output", Output)
def test_ardupilot_takes_every_output_but_torques(output: Output) -> None:
    refusal = ARDUPILOT.refusal(output, version(4, 7))
    assert (refusal is not None) is (output is Output.ACTUATORS)


@pytest.mark.parametrize("mode", [FlightMode.EXTERNAL, FlightMode.HOLD, FlightMode.LAND, FlightMode.RETURN])
def test_px4_reports_the_mode_that_was_commanded(mode: FlightMode) -> None:
    custom, main, sub = PX4.mode_command(mode)
    assert custom == dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert PX4.mode_of(int(main) << 16 | int(sub) << 24) is mode
    _, number, _ = ARDUPILOT.mode_command(mode)
    assert ARDUPILOT.mode_of(int(number)) is mode


def test_pilots_modes_are_told_from_ours() -> None:
    for main in (1, 2, 3, 5, 7):
        assert PX4.mode_of(main << 16) is FlightMode.MANUAL
    assert PX4.mode_of(4 << 16 | 4 << 24) is FlightMode.MISSION
    assert PX4.mode_of(99 << 16) is FlightMode.OTHER
    assert ARDUPILOT.mode_of(0) is FlightMode.MANUAL
    assert ARDUPILOT.mode_of(12345) is FlightMode.OTHER


def test_only_autopilots_are_vehicles() -> None:
    assert firmware_of(dialect.MAV_AUTOPILOT_PX4) is PX4
    assert firmware_of(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA) is ARDUPILOT
    assert firmware_of(dialect.MAV_AUTOPILOT_INVALID) is None
