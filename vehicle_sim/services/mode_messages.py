"""The messages of modes and missions: CURRENT_MODE, AVAILABLE_MODES, MISSION_CURRENT, ORBIT_EXECUTION_STATUS."""

from protocol.messages import AvailableModes, CurrentMode, Encoder, dialect
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.services.places import Geodetic, on_earth
from vehicle_sim.services.snapshot import Snapshot

_ADVANCED, _NOT_SELECTABLE = 1, 2
"""MAV_MODE_PROPERTY."""
_SIMPLE = (Mode.ALTITUDE, Mode.POSITION)
"""All other modes are advanced, as PX4 says."""


class ModeMessages:
    """Encoders, one a message. `origin` is the place of the local axes on earth."""

    def __init__(self, encoder: Encoder, flight: FlightControl, origin: Geodetic) -> None:
        self._encode = encoder.encode_fields
        self._flight = flight
        self._origin = origin

    def current_mode(self, now: Snapshot) -> bytes:
        mode = self._flight.mode
        return self._encode(CurrentMode, mode.standard, mode.custom_mode, mode.custom_mode)

    def available_modes(self, number: int) -> bytes | None:
        """A mode by its number, from 1; 0: all of them. None if there is none with this number."""
        modes = [mode for mode in Mode if mode is not Mode.DESCEND]  # on the wire it is a landing
        if not 0 <= number <= len(modes):
            return None
        numbers = range(1, len(modes) + 1) if number == 0 else [number]
        return b"".join(self._available_mode(each, modes[each - 1], len(modes)) for each in numbers)

    def _available_mode(self, number: int, mode: Mode, count: int) -> bytes:
        properties = (0 if mode in _SIMPLE else _ADVANCED) | (0 if mode.is_selectable else _NOT_SELECTABLE)
        name = b"" if mode.standard else mode.label.encode()
        return self._encode(AvailableModes, count, number, mode.standard, mode.custom_mode, properties, name)

    def mission_current(self, now: Snapshot) -> bytes:
        return self._encode(dialect.MAVLink_mission_current_message, *mission_progress(self._flight))

    def orbit_execution_status(self, now: Snapshot) -> bytes:
        """Empty unless the vehicle orbits."""
        circle = self._flight.guidance.circle
        if circle is None or self._flight.mode is not Mode.ORBIT:
            return b""
        return self._encode(
            dialect.MAVLink_orbit_execution_status_message,
            now.estimate_us,
            circle.radius_m,
            dialect.MAV_FRAME_GLOBAL_INT,
            *on_earth(circle.center_ned, self._origin),
        )


def mission_progress(flight: FlightControl) -> tuple[int, int, int, int]:
    """The fields of MISSION_CURRENT."""
    mission, active = flight.mission, flight.mode is Mode.MISSION
    if not mission.items:
        return 0, 65535, dialect.MISSION_STATE_NO_MISSION, 0
    if mission.finished:
        state = dialect.MISSION_STATE_COMPLETE
    elif active and flight.armed:
        state = dialect.MISSION_STATE_ACTIVE
    else:
        state = dialect.MISSION_STATE_PAUSED if mission.current else dialect.MISSION_STATE_NOT_STARTED
    return mission.current, len(mission.items), state, 1 if active else 2
