"""The outputs, in the one place where an output is registered: the layers of the vehicle's control that the companion
can command.

To add an output: give it a member in `companion.state.Output` and an entry to `OUTPUTS` here. A make of vehicle that
does not follow it refuses it in `companion.link.firmware`. An output of another package makes another message of what
is commanded on one of these layers.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol

from companion.config import Control
from companion.plugins import Plugin
from companion.state import Output, Setpoint
from protocol.messages import Encoder, dialect

ATTITUDE_IGNORE_RATES = 0x07
RATES_IGNORE_ATTITUDE = 0x80
"""The two type masks of SET_ATTITUDE_TARGET that PX4 and ArduPilot both follow."""

Message = tuple[type[Any], tuple[Any, ...]]
"""A message's class and its fields."""
Encode = Callable[[Setpoint, int, tuple[int, int]], Message]
"""The message for a setpoint, the vehicle's time since boot (ms) and the target (system, component)."""


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
    encode: Encode


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


# -- of other packages -------------------------------------------------------------------------------------------------

SETPOINTS = frozenset(
    {
        dialect.MAVLINK_MSG_ID_MANUAL_CONTROL,
        dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
        dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        dialect.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET,
    }
)
"""What an output of another package may send: nothing that arms, changes a mode or sets a parameter."""


class SetpointOutput(Protocol):
    """An output. Its factory takes [control] and the options of [control.output.options] by name."""

    def message(self, output: Output, setpoint: Setpoint, boot_time_ms: int, target: tuple[int, int]) -> Message:
        """The message for a setpoint that has passed the last gate: its class in `protocol.messages.dialect`, and its
        fields in that class's order. `output` is the layer that the prediction takes the vehicle to follow."""


def encoders(settings: Control) -> Callable[[Output], Encode]:
    """How setpoints are encoded on each layer, by the message that the settings name. Raises PluginError."""
    plugin = settings.output.plugin
    if plugin is None:
        return lambda output: OUTPUTS[output].encode
    made: SetpointOutput = plugin.make(settings, settings.output.options)
    return lambda output: functools.partial(_foreign, plugin, made, output)


def _foreign(
    plugin: Plugin, made: SetpointOutput, output: Output, setpoint: Setpoint, boot_time_ms: int, target: tuple[int, int]
) -> Message:
    """What an output of another package makes of a setpoint. Raises PluginError for what is no sound setpoint, or can't
    be packed."""
    with plugin.named():
        message, fields = made.message(output, setpoint, boot_time_ms, target)
        number, name = message.id, message.msgname
        flat = [value for field in fields for value in (field if isinstance(field, list | tuple) else (field,))]
        sound = all(map(math.isfinite, flat))
        if sound:
            Encoder(1, 1).encode_fields(message, *fields)
    if number not in SETPOINTS:
        raise plugin.broken(f"{name} is no setpoint")
    if not sound:
        raise plugin.broken(f"{name} with {flat}")
    return message, tuple(fields)
