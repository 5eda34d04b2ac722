"""The parts of the vehicle that can be made to fail: MAV_CMD_INJECT_FAILURE."""

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum

from protocol.arrays import Array
from vehicle_sim.autopilot.modes import Result
from vehicle_sim.autopilot.watch import Health
from vehicle_sim.sensors.faults import Failure, Fault


class Unit(IntEnum):
    """FAILURE_UNIT."""

    MAGNETOMETER = 2
    BAROMETER = 3
    GNSS = 4
    VIO = 6
    LIDAR = 7
    BATTERY = 100
    MOTOR = 101


class Failures:
    """The failures of one vehicle. `sensors`: those it has; `running` (4,) is 1 for each motor that works; `enabled`:
    SYS_FAILURE_EN."""

    def __init__(
        self,
        sensors: Mapping[int, Sequence[Fault]],
        running: Array,
        health: Health,
        *,
        enabled: Callable[[], bool],
    ) -> None:
        self._sensors = sensors
        self._running = running
        self._health = health
        self._enabled = enabled

    def inject(self, unit: int, failure: int, instance: int) -> Result:
        """Let a unit fail, or work again. `instance`: the motor, from 1 on; 0: all.

        A motor can only stop and a battery only be empty; all else is unsupported, as by PX4.
        """
        if not self._enabled():
            return Result.DENIED
        if unit in self._sensors and failure in list(Failure):
            for fault in self._sensors[unit]:
                fault.failure = Failure(failure)
            return Result.ACCEPTED
        if failure not in (Failure.OK, Failure.OFF):
            return Result.UNSUPPORTED
        if unit == Unit.BATTERY:
            self._health.drained = failure == Failure.OFF
            return Result.ACCEPTED
        if unit == Unit.MOTOR and 0 <= instance <= len(self._running):
            chosen = slice(None) if instance == 0 else slice(instance - 1, instance)
            self._running[chosen] = float(failure == Failure.OK)
            return Result.ACCEPTED
        return Result.UNSUPPORTED
