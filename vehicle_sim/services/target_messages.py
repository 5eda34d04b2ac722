"""What the position is controlled to: POSITION_TARGET_LOCAL_NED and POSITION_TARGET_GLOBAL_INT."""

import math

from protocol.messages import Encoder, dialect
from vehicle_sim.autopilot.control_laws import Level
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Flies
from vehicle_sim.autopilot.tracking import Target
from vehicle_sim.services.places import Geodetic, on_earth
from vehicle_sim.services.snapshot import NOTHING, Snapshot

_IGNORED = tuple(1 << bit for bit in (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11))
"""Bits of the type mask: position, velocity and acceleration by axis, yaw and its rate."""


class TargetMessages:
    """Encoders, one a message. `origin` is the place of the local axes on earth."""

    def __init__(self, encoder: Encoder, flight: FlightControl, origin: Geodetic) -> None:
        self._encode = encoder.encode_fields
        self._flight = flight
        self._origin = origin

    def position_target_local_ned(self, now: Snapshot) -> bytes:
        """What is free is not a number and said so by the type mask, as PX4 does; nothing where no position is
        controlled."""
        target = _followed(self._flight)
        if target is None:
            return NOTHING
        mask, values = _fields(target)
        frame = dialect.MAV_FRAME_LOCAL_NED
        return self._encode(dialect.MAVLink_position_target_local_ned_message, now.now_ms, frame, mask, *values)

    def position_target_global_int(self, now: Snapshot) -> bytes:
        """Nothing but in the modes that fly to a place by themselves, as PX4."""
        target = _followed(self._flight)
        if target is None or self._flight.mode.flies not in (Flies.TARGET, Flies.MISSION):
            return NOTHING
        north, east, down = target.position_ned
        if north is None or east is None:
            return NOTHING
        latitude, longitude, altitude = on_earth((north, east, down or 0.0), self._origin)
        mask, values = _fields(target)
        return self._encode(
            dialect.MAVLink_position_target_global_int_message,
            now.now_ms,
            dialect.MAV_FRAME_GLOBAL_INT,
            mask,
            latitude,
            longitude,
            math.nan if down is None else altitude,
            *values[3:],
        )


def _followed(flight: FlightControl) -> Target | None:
    """What the position is controlled to; None if it is not, or the motors stand still."""
    if flight.command["level"][0] == Level.STOPPED:
        return None
    if flight.mode.flies is Flies.SETPOINTS:
        return flight.setpoints.followed
    return flight.sticks.followed if flight.mode.flies is Flies.STICKS else flight.guidance.followed


def _fields(target: Target) -> tuple[int, list[float]]:
    """Type mask, and the values from the position to the yaw rate."""
    given = (*target.position_ned, *target.velocity_ned, *target.acceleration_ned, target.yaw, target.yaw_rate)
    mask = sum(bit for bit, value in zip(_IGNORED, given, strict=True) if value is None)
    return mask, [math.nan if value is None else value for value in given]
