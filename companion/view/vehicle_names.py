"""What the makers of vehicles call their flight modes, and what a vehicle is."""

from protocol.messages import dialect

_PX4_MAIN = {
    1: "Manual",
    2: "Altitude",
    3: "Position",
    4: "Auto",
    5: "Acro",
    6: "Offboard",
    7: "Stabilized",
    10: "Termination",
    11: "Altitude cruise",
}
_PX4_POSITION = {1: "Orbit", 2: "Position slow"}
_PX4_AUTO = {
    1: "Ready",
    2: "Takeoff",
    3: "Hold",
    4: "Mission",
    5: "Return",
    6: "Land",
    8: "Follow me",
    9: "Precision land",
    10: "VTOL takeoff",
}
"""PX4's px4_custom_mode.h (main_mode and sub_mode), by the names of its user guide."""
_ARDUPILOT = {
    dialect.MAV_TYPE_FIXED_WING: "PLANE_MODE",
    dialect.MAV_TYPE_GROUND_ROVER: "ROVER_MODE",
    dialect.MAV_TYPE_SURFACE_BOAT: "ROVER_MODE",
    dialect.MAV_TYPE_SUBMARINE: "SUB_MODE",
}
_MAKES = {dialect.MAV_AUTOPILOT_PX4: "PX4", dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: "ArduPilot"}


def mode_name(autopilot: int, vehicle: int, custom_mode: int) -> str:
    """The name of a mode, from HEARTBEAT's autopilot, type and custom_mode."""
    found = None
    if autopilot == dialect.MAV_AUTOPILOT_PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        found = {3: _PX4_POSITION, 4: _PX4_AUTO}.get(main, {}).get(sub) or (None if main == 4 else _PX4_MAIN.get(main))
    elif autopilot == dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
        prefix = _ARDUPILOT.get(vehicle, "COPTER_MODE")
        entry = dialect.enums[prefix].get(custom_mode)
        found = None if entry is None else entry.name.removeprefix(f"{prefix}_").replace("_", " ").capitalize()
    return found or f"mode {custom_mode}"


def vehicle_name(autopilot: int, vehicle: int) -> str:
    """What flies, from HEARTBEAT's autopilot and type."""
    kind = dialect.enums["MAV_TYPE"].get(vehicle)
    what = "vehicle" if kind is None or not vehicle else kind.name.removeprefix("MAV_TYPE_").replace("_", " ").lower()
    return f"{_MAKES[autopilot]} {what}" if autopilot in _MAKES else what
