"""PX4, and our own simulator, which behaves as PX4 does."""

from companion.link.firmware.firmware import COPTERS, Firmware, Judge, Terms, Values, positive, within
from companion.reports import Finding, VehicleSettings
from companion.state import FlightMode, Output, OwnFence, Safety
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
_VTOLS = frozenset(range(19, 26))
"""MAV_TYPE_VTOL_..., of which versions of the dialect have other names."""
_LAST_WITH_ACTUATOR_CONTROLS = (1, 13)

_HOLD_LIMIT_S = 1.0
_POSITION, _ALTITUDE, _STABILIZED_ON_LOSS, _RETURN, _LAND, _HOLD, _TERMINATE, _DISARM = range(8)
"""COM_OBL_RC_ACT."""
_NO_TERMINATION = 121212
"""CBRK_FLIGHTTERM."""
_PARAMETERS = (
    "COM_OF_LOSS_T",
    "COM_OBL_RC_ACT",
    "COM_RCL_EXCEPT",
    "COM_DISARM_LAND",
    "MPC_THR_HOVER",
    "MPC_TILTMAX_AIR",
    "FD_FAIL_P",
    "FD_FAIL_R",
    "CBRK_FLIGHTTERM",
    "GF_MAX_HOR_DIST",
    "GF_MAX_VER_DIST",
)
_LOSS_WHY = {
    _ALTITUDE: "when setpoints stop, a pilot must fly (altitude mode)",
    _STABILIZED_ON_LOSS: "when setpoints stop, a pilot must fly (stabilized mode)",
    _HOLD: "when setpoints stop, the vehicle holds and nobody lands it",
    _TERMINATE: "when setpoints stop, the motors stop in the air",
    _DISARM: "when setpoints stop, the motors stop in the air",
}


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


def _audit(values: Values, terms: Terms) -> tuple[Finding, ...]:
    """Sources: PX4's parameter reference (v1.16), and flights in which the companion was stopped."""
    judge, loss = Judge(values), values.get("COM_OBL_RC_ACT", -1.0)
    terminates = values.get("CBRK_FLIGHTTERM") != _NO_TERMINATION
    tilt_why = "beyond it the failure detector stops the motors" if terminates else "does nothing (CBRK_FLIGHTTERM)"
    return (
        judge(
            "COM_OF_LOSS_T",
            f"above supervision.gap {terms.gap:g} s, at most {_HOLD_LIMIT_S:g} s",
            "s for which the last setpoint is followed when no more come; after supervision.gap the companion sends "
            "none, so that late ones do not bring OFFBOARD back",
            lambda value: terms.gap < value <= _HOLD_LIMIT_S,
        ),
        judge(
            "COM_OBL_RC_ACT",
            "0 (position), 3 (return) or 4 (land)",
            _LOSS_WHY.get(round(loss), "what happens when setpoints stop; 0 descends where there is no pilot"),
            lambda value: value in (_POSITION, _RETURN, _LAND),
            Safety.REFUSED if loss in (_TERMINATE, _DISARM) else Safety.UNSAFE,
        ),
        judge("COM_RCL_EXCEPT", "", "with bit 2 (4) the loss of the transmitter does not end a flight"),
        judge(
            "COM_DISARM_LAND",
            "above 0 s",
            "s after the landing until the vehicle disarms; 0: never",
            lambda value: value > 0.0,
        ),
        judge("MPC_THR_HOVER", "", "the vehicle's own idea of its hover thrust"),
        judge("MPC_TILTMAX_AIR", "", "deg; limits the vehicle's own modes, not the companion's setpoints"),
        *(
            judge(
                name,
                f"0, or above limits.tilt_deg {terms.tilt_deg:g}",
                tilt_why,
                lambda value: not terminates or value <= 0.0 or value > terms.tilt_deg,
            )
            for name in ("FD_FAIL_P", "FD_FAIL_R")
        ),
        judge("GF_MAX_HOR_DIST", "", "m from home, 0: none; the flight keeps within it"),
        judge("GF_MAX_VER_DIST", "", "m above home, 0: none; the flight keeps within it"),
    )


def _settings(values: Values) -> VehicleSettings:
    return VehicleSettings(
        setpoint_hold=within(values.get("COM_OF_LOSS_T"), 0.0, 1e3),
        fence=OwnFence(positive(values.get("GF_MAX_HOR_DIST")), positive(values.get("GF_MAX_VER_DIST"))),
    )


FIRMWARE = Firmware(
    name="PX4",
    autopilot=dialect.MAV_AUTOPILOT_PX4,
    kinds=COPTERS | _VTOLS,
    mode_of=_mode_of,
    mode_command=_mode_command,
    refusal=_refusal,
    parameters=tuple((name,) for name in _PARAMETERS),
    bytewise=True,
    hold_parameter="COM_OF_LOSS_T",
    audit=_audit,
    settings=_settings,
    position_flags=dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_POS_HORIZ_ABS,
    telemetry={dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0},
    reasons=" (PX4 tells why where it hears a ground station: --gcs, or look there)",  # its texts go nowhere else
)
