"""PX4, and our own simulator, which behaves as PX4 does."""

from companion.link.firmware.firmware import Firmware
from companion.state import FlightMode, Output
from protocol.messages import dialect

_MANUAL, _ALTCTL, _POSCTL, _AUTO, _ACRO, _OFFBOARD, _STABILIZED = range(1, 8)
_MAIN = {
    _MANUAL: FlightMode.MANUAL,
    _ALTCTL: FlightMode.MANUAL,
    _POSCTL: FlightMode.MANUAL,
    _ACRO: FlightMode.MANUAL,
    _STABILIZED: FlightMode.MANUAL,
    _OFFBOARD: FlightMode.EXTERNAL,
}
_AUTO_SUB = {
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    4: FlightMode.MISSION,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
    9: FlightMode.LAND,  # precision landing
}
_COMMANDS = {
    FlightMode.EXTERNAL: (_OFFBOARD, 0),
    FlightMode.HOLD: (_AUTO, 3),
    FlightMode.RETURN: (_AUTO, 5),
    FlightMode.LAND: (_AUTO, 6),
}
_LAST_WITH_ACTUATOR_CONTROLS = (1, 13)


def _mode_of(custom_mode: int) -> FlightMode:
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == _AUTO:
        return _AUTO_SUB.get(sub, FlightMode.OTHER)
    return _MAIN.get(main, FlightMode.OTHER)


def _mode_command(mode: FlightMode) -> tuple[float, float, float]:
    main, sub = _COMMANDS[mode]
    return float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(main), float(sub)


def _refusal(output: Output, version: int) -> str | None:
    if output is not Output.ACTUATORS:
        return None
    release = (version >> 24 & 0xFF, version >> 16 & 0xFF)
    if release > _LAST_WITH_ACTUATOR_CONTROLS:
        return (
            f"PX4 {release[0]}.{release[1]} drops SET_ACTUATOR_CONTROL_TARGET without a word (removed in 1.14): "
            "use --output rates"
        )
    return None


FIRMWARE = Firmware("PX4", dialect.MAV_AUTOPILOT_PX4, _mode_of, _mode_command, _refusal)
