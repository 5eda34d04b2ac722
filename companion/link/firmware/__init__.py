"""What differs between the makes of vehicle: modes, commands, which outputs they obey."""

from companion.link.firmware import ardupilot, px4
from companion.link.firmware.firmware import Firmware

_KNOWN = {firmware.autopilot: firmware for firmware in (px4.FIRMWARE, ardupilot.FIRMWARE)}


def firmware_of(autopilot: int) -> Firmware | None:
    """By HEARTBEAT.autopilot; None for a make that is not known."""
    return _KNOWN.get(autopilot)
