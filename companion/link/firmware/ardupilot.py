"""ArduPilot: its telemetry is read; it is not flown yet (it takes off by NAV_TAKEOFF and needs GUID_OPTIONS read
first)."""

from companion.link.firmware.firmware import Firmware
from companion.state import FlightMode, Output
from protocol.messages import dialect

_MODES = {
    0: FlightMode.MANUAL,
    2: FlightMode.MANUAL,
    3: FlightMode.MISSION,
    4: FlightMode.EXTERNAL,
    1: FlightMode.MANUAL,
    5: FlightMode.MANUAL,  # LOITER obeys the sticks
    16: FlightMode.MANUAL,
    21: FlightMode.RETURN,
    27: FlightMode.RETURN,
    6: FlightMode.RETURN,
    9: FlightMode.LAND,
    17: FlightMode.HOLD,
    20: FlightMode.EXTERNAL,
}
_COMMANDS = {FlightMode.EXTERNAL: 4, FlightMode.HOLD: 17, FlightMode.RETURN: 6, FlightMode.LAND: 9}


def _mode_of(custom_mode: int) -> FlightMode:
    return _MODES.get(custom_mode, FlightMode.OTHER)


def _mode_command(mode: FlightMode) -> tuple[float, float, float]:
    return float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(_COMMANDS[mode]), 0.0


def _refusal(output: Output, version: int) -> str | None:
    return f"ArduPilot vehicles can be listened to but not flown yet (output {output.value})"


FIRMWARE = Firmware("ArduPilot", dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, _mode_of, _mode_command, _refusal)
