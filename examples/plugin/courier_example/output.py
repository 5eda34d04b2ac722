"""An output that sends attitude and rates together; ArduPilot takes the rates as a feed-forward."""

from companion.config import Control
from companion.outputs import RATES_IGNORE_ATTITUDE, Message
from companion.state import Output, Setpoint
from protocol.messages import dialect

MASKS = {Output.ATTITUDE: 0, Output.RATES: RATES_IGNORE_ATTITUDE}


class Both:
    """SET_ATTITUDE_TARGET that ignores nothing on the layer "attitude"; `share` of the rates."""

    def __init__(self, control: Control, share: float = 1.0) -> None:
        self.share = share

    def message(self, output: Output, setpoint: Setpoint, boot_time_ms: int, target: tuple[int, int]) -> Message:
        if output not in MASKS:
            raise ValueError(f"it is not for --output {output.value}")
        rates = (self.share * rate for rate in setpoint.rates_frd)
        fields = boot_time_ms, *target, MASKS[output], setpoint.attitude_ned_frd, *rates, setpoint.thrust
        return dialect.MAVLink_set_attitude_target_message, fields
