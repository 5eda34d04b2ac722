"""The table in which outputs are registered."""

import pytest

from companion.outputs import OUTPUTS
from companion.state import Output, Setpoint


def test_every_output_has_an_entry() -> None:
    assert tuple(OUTPUTS) == tuple(Output)


@pytest.mark.parametrize("output", Output)
def test_a_message_carries_what_the_output_commands_and_its_target(output: Output) -> None:
    setpoint = Setpoint([1.0, 0.0, 0.0, 0.0], [0.1, 0.2, 0.3], [-0.1, 0.2, 0.4], 0.45)
    kind, fields = OUTPUTS[output].encode(setpoint, 1234, (7, 1))
    message = kind(*fields)
    assert (message.target_system, message.target_component) == (7, 1)
    if output is Output.ACTUATORS:
        assert message.time_usec == 1_234_000 and message.controls[:4] == [*setpoint.torque, setpoint.thrust]
    else:
        assert message.time_boot_ms == 1234 and message.thrust == setpoint.thrust
        assert message.q == setpoint.attitude_ned_frd
        assert [message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate] == setpoint.rates_frd
