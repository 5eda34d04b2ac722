"""What telemetry reports at a tick."""

from typing import NamedTuple

from protocol.arrays import Vector
from vehicle_sim.physics.motion import Motion

NOTHING = b""
"""Instead of a message whose values are not known."""


class Snapshot(NamedTuple):
    estimate: Motion
    """The vehicle's own estimate of its motion, with its age."""
    truth: Motion
    """The present motion. Messages of the estimate must not read it."""
    scanned: Motion
    """The motion when the LiDAR made the scan that is reported now."""
    wind_ned: Vector = (0.0, 0.0, 0.0)
    """The present wind (m/s), of which the same holds."""

    @property
    def estimate_ms(self) -> int:
        """Time since boot of the estimate (32 bits)."""
        return self.estimate.time_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def estimate_us(self) -> int:
        return self.estimate.time_ns // 1000

    @property
    def now_ms(self) -> int:
        """Time since boot (32 bits)."""
        return self.truth.time_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def now_us(self) -> int:
        return self.truth.time_ns // 1000

    @property
    def now_ns(self) -> int:
        return self.truth.time_ns


def int16(value: float) -> int:
    """Rounded, within 16 bits."""
    return round(min(max(value, -32768.0), 32767.0))


def int32(value: float) -> int:
    """Rounded, within 32 bits."""
    return round(min(max(value, -(2.0**31)), 2.0**31 - 1.0))
