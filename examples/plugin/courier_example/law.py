"""A PID law whose feedback never exceeds a limit, however large the error is."""

import numpy as np

from companion.config import Control
from companion.control.tracking_error import TrackingError
from protocol.arrays import Array


class Saturated:
    """a = a_d + L tanh((kp e + kd e' + I) / L), I' = ki e."""

    def __init__(self, control: Control, kp: float = 7.0, kd: float = 5.0, ki: float = 2.0, limit: float = 8.0) -> None:
        self.kp, self.kd, self.ki, self.limit = kp, kd, ki, limit
        self.integral = np.zeros(3)

    def reset(self) -> None:
        self.integral = np.zeros(3)

    def acceleration_command(self, error: TrackingError, reference_acceleration: Array, dt: float) -> Array:
        self.integral = np.clip(self.integral + self.ki * error.position * dt, -2.0, 2.0)
        feedback = self.kp * error.position + self.kd * error.velocity + self.integral
        command: Array = reference_acceleration + self.limit * np.tanh(feedback / self.limit)
        return command
