"""The outputs, in the one place where an output is registered: the layers of the vehicle's control that the companion
can command.

To add an output: give it a member in `companion.state.Output` and an entry to `OUTPUTS` here. A make of vehicle that
does not follow it refuses it in `companion.link.firmware`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from companion.state import Output, Setpoint
from protocol.messages import dialect

ATTITUDE_IGNORE_RATES = 0x07
RATES_IGNORE_ATTITUDE = 0x80
"""The two type masks of SET_ATTITUDE_TARGET that PX4 and ArduPilot both follow."""

Message = tuple[type[Any], tuple[Any, ...]]
"""A message's class and its fields."""


class TurningInput(IntEnum):
    """What of a command says how the vehicle turns; the prediction integrates it."""

    ATTITUDE = 0
    """The rotation vector (rad) from NED to FRD."""
    RATES = 1
    """rad/s."""
    ANGULAR_ACCELERATION = 2
    """rad/s2."""


@dataclass(frozen=True, slots=True)
class OutputEntry:
    """What an output consists of."""

    turning_input: TurningInput
    encode: Callable[[Setpoint, int, tuple[int, int]], Message]
    """The message for a setpoint, the vehicle's time since boot (ms) and the target (system, component)."""


def _attitude_target(mask: int, setpoint: Setpoint, boot_time_ms: int, target: tuple[int, int]) -> Message:
    """SET_ATTITUDE_TARGET (82)."""
    return dialect.MAVLink_set_attitude_target_message, (
        boot_time_ms,
        *target,
        mask,
        setpoint.attitude_ned_frd,
        *setpoint.rates_frd,
        setpoint.thrust,
    )


def _attitude(setpoint: Setpoint, boot_time_ms: int, target: tuple[int, int]) -> Message:
    return _attitude_target(ATTITUDE_IGNORE_RATES, setpoint, boot_time_ms, target)


def _rates(setpoint: Setpoint, boot_time_ms: int, target: tuple[int, int]) -> Message:
    return _attitude_target(RATES_IGNORE_ATTITUDE, setpoint, boot_time_ms, target)


def _actuators(setpoint: Setpoint, boot_time_ms: int, target: tuple[int, int]) -> Message:
    """SET_ACTUATOR_CONTROL_TARGET (139)."""
    controls = [*setpoint.torque, setpoint.thrust, 0.0, 0.0, 0.0, 0.0]
    return dialect.MAVLink_set_actuator_control_target_message, (boot_time_ms * 1000, 0, *target, controls)


OUTPUTS = {
    Output.ATTITUDE: OutputEntry(TurningInput.ATTITUDE, _attitude),
    Output.RATES: OutputEntry(TurningInput.RATES, _rates),
    Output.ACTUATORS: OutputEntry(TurningInput.ANGULAR_ACCELERATION, _actuators),
}
