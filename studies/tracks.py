"""Flights of a shape, with both sides joined in memory, and the true distance of the vehicle from it."""

from dataclasses import dataclass, field

import numpy as np

from companion.curves import Shape
from companion.mission.plan import Mission, Phase
from companion.state import Output
from companion.supervision.states import State
from protocol.arrays import Array
from studies.joined import Joined
from vehicle_sim.physics.battery import battery_state

AGILE = (
    "limits.tilt_deg=85.0",
    "limits.lowest_thrust=0.02",
    "limits.highest_thrust=1.0",
    "limits.roll_pitch_rate_deg=1200.0",
    "limits.yaw_rate_deg=400.0",
    "trajectory.climb_speed=6.0",
    'avoidance.method="none"',
)
"""Limits beyond the vehicle's own."""
_HALF_TICK_S = 0.002
"""From a state to the middle of the tick that its command is held over, which the reference is meant for."""


@dataclass(frozen=True)
class Flight:
    """What to fly. The overrides of vehicle and world apply to the simulator; the companion knows the nominal
    vehicle."""

    shape: Shape
    vehicle: str = "paper_quad"
    output: Output = Output.RATES
    overrides: tuple[str, ...] = ()
    vehicle_overrides: tuple[str, ...] = ()
    world_overrides: tuple[str, ...] = ()
    height: float = 20.0
    seed: int = 1


@dataclass(frozen=True)
class Tracked:
    """The error from one second after the shape's start to its end."""

    rmse_m: float
    """NaN where the flight failed."""
    peak_m: float
    told_rmse_m: float
    """By where the vehicle believes that it is."""
    estimate_rmse_m: float
    """From where it believes that it is to where it is."""
    voltage_share: float
    """The battery's least voltage, of its full one."""
    limited: float
    """Share of the control steps at which a limit on thrust or tilt was reached."""
    fault: str | None
    time_s: Array = field(repr=False)
    error_ned: Array = field(repr=False)
    """(n, 3) m, NED."""


def fly(flight: Flight) -> Tracked:
    """Take off, fly the shape, land."""
    mission = Mission("track", trajectory=flight.shape, vehicle=flight.vehicle, takeoff_height=flight.height)
    joined = Joined(
        mission,
        flight.output,
        (*AGILE, *flight.overrides),
        seed=flight.seed,
        vehicle_overrides=flight.vehicle_overrides,
        world_overrides=flight.world_overrides,
    )
    voltages: list[float] = []
    airframe = joined.vehicle.airframe

    def over(joined: Joined) -> bool:
        on_track = joined.autopilot.navigator.phase is Phase.TRACK and joined.autopilot.supervisor.state is State.FLY
        if on_track:
            voltages.append(battery_state(airframe, joined.vehicle.motion).volts)
        return bool(voltages) and not on_track

    joined.fly(until=over, limit_s=200.0)
    fault = joined.autopilot.supervisor.fault or joined.vehicle.flight.crash
    trace, error = joined.trace()[:-1], joined.tracking_error()
    chosen = (trace["phase"] == Phase.TRACK.value) & (trace["state"] == State.FLY.value)
    error, track = error[chosen][250:], trace[chosen][250:]
    if fault is not None or not len(error):
        lost = fault or "it never came to the shape"
        return Tracked(np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, lost, np.empty(0), np.empty((0, 3)))
    told = track["position_ned"] + _HALF_TICK_S * track["velocity_ned"] - track["reference_position_ned"]
    time = 1.0 + 0.004 * np.arange(len(error), dtype=np.float64)
    peak, limited = float(np.linalg.norm(error, axis=1).max()), float(track["limited"].mean())
    voltage = min(voltages) / airframe.battery.full_v
    return Tracked(_rms(error), peak, _rms(told), _rms(error - told), voltage, limited, None, time, error)


def _rms(errors: Array) -> float:
    """The root of the mean square of vectors (n, 3)."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))
