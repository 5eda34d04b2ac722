"""An attitude law of two loops: the angle asks for a rate, the rate for an angular acceleration."""

from companion.config import Control
from companion.control.foreign import AttitudeError
from protocol.arrays import Array


class Cascade:
    """rates = reference + angle_gain error; acceleration = reference + rate_gain (rates - measured)."""

    def __init__(self, control: Control, angle_gain: float = 9.0, rate_gain: float = 22.0) -> None:
        self.angle_gain, self.rate_gain = angle_gain, rate_gain

    def reset(self) -> None:
        pass

    def turning_command(self, error: AttitudeError, dt: float) -> tuple[Array, Array]:
        more = self.angle_gain * error.attitude
        return error.reference_rates + more, error.reference_acceleration + self.rate_gain * (error.rates + more)
