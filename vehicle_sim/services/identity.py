"""The vehicle's address on the MAVLink network."""

from typing import Any

SYSTEM = 1
COMPONENT = 1


def is_for_vehicle(message: Any) -> bool:
    """A message with a target addresses this vehicle, or everybody."""
    return message.target_system in (0, SYSTEM) and message.target_component in (0, COMPONENT)
