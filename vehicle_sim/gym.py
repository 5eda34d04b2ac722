"""The simulated vehicle as an environment of Gymnasium (`pip install courier-autopilot[gym]`): fly to a target.

import gymnasium, vehicle_sim.gym
env = gymnasium.make("Courier-v0", world="neighbourhood")
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from vehicle_sim.library import Setpoint, Simulation, State

Floats = NDArray[np.float32]

RATES = np.array([4.0, 4.0, 1.5])
"""rad/s: the rates of an action of 1."""
HEIGHT = 3.0
"""m, at which an episode begins."""
_NEAR_M, _SLOW_M_S = 0.3, 0.5
_REACH_M = (8.0, 8.0, 1.5)
"""How far from the start the targets are."""
_PRIZE = 10.0


class TargetEnv(gymnasium.Env[Floats, Floats]):
    """From hover to a target, at 50 steps a second.

    Action (4,), each -1 to 1: roll, pitch and yaw rate as shares of `RATES`, and the thrust from none to all there is.
    Observation (14,): the way to the target (3, m) and the velocity (3, m/s), NED; the attitude (4, quaternion with
    w >= 0); the rates (3, rad/s, FRD); the distance to the nearest obstacle (m, at most 10). Reward: m that the target
    came nearer, +10 for reaching it, -10 for a crash; both end the episode, and so does a landing. It is cut short when
    the vehicle leaves OFFBOARD, as for a low battery.
    """

    def __init__(self, vehicle: str = "paper_quad", world: str = "empty", *, overrides: Sequence[str] = ()) -> None:
        """`overrides` of the vehicle's file."""
        self.simulation = Simulation(vehicle, world, vehicle_overrides=overrides)
        """What flies."""
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (14,), np.float32)
        self.target_ned = np.zeros(3)
        """(3,) m; drawn anew by each `reset`."""
        self._distance = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """`options`: "target" is (north, east, height) in m; it is drawn by the seed without it."""
        super().reset(seed=seed)
        state = self.simulation.reset(int(self.np_random.integers(2**31)), HEIGHT)
        drawn = state.position_ned + self.np_random.uniform(-1.0, 1.0, 3) * _REACH_M
        north, east, height = (options or {}).get("target", (drawn[0], drawn[1], -drawn[2]))
        self.target_ned = np.array([north, east, -height])
        self._distance = float(np.linalg.norm(self.target_ned - state.position_ned))
        return self._observation(state), {"time_s": state.time_s, "crash": state.crash}

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Fly on for 20 ms: the observation, the reward, whether the episode has ended or was cut short, and the
        vehicle's time and what it hit. Raises ValueError for an action that is not finite."""
        if not np.isfinite(action).all():
            raise ValueError(f"an action of finite numbers is wanted, not {action}")
        rates, thrust = RATES * np.clip(action[:3], -1.0, 1.0), 0.5 * (float(np.clip(action[3], -1.0, 1.0)) + 1.0)
        state = self.simulation.step(Setpoint((rates[0], rates[1], rates[2]), thrust), ticks=5)
        before, self._distance = self._distance, float(np.linalg.norm(self.target_ned - state.position_ned))
        reached = self._distance < _NEAR_M and float(np.linalg.norm(state.velocity_ned)) < _SLOW_M_S
        crashed = state.crash is not None
        reward = before - self._distance + _PRIZE * (reached - crashed)
        return (
            self._observation(state),
            reward,
            reached or crashed or not state.armed,
            state.armed and not state.obeys,
            {"time_s": state.time_s, "crash": state.crash},
        )

    def _observation(self, state: State) -> Floats:
        upright = state.attitude_ned_frd if state.attitude_ned_frd[0] >= 0.0 else -state.attitude_ned_frd
        way = self.target_ned - state.position_ned
        near = [min(state.clearance_m, 10.0)]
        parts = (way, state.velocity_ned, upright, state.rates_frd, near)
        return np.concatenate(parts).astype(np.float32)


gymnasium.register("Courier-v0", f"{__name__}:TargetEnv", max_episode_steps=1000)
