"""Tracking beside RotorPy: its own SE3 controller and ours on its own vehicle, the same trajectories, in one run.

    pip install rotorpy==3.0.0
    python bench/tracking.py [--json]
    python bench/tracking.py --sensors gnss --seeds 10

RotorPy's AscTec Hummingbird with its aerodynamics and motors, started on the trajectory; RMSE of position after the
first second. Ours commands thrust and torque there (output actuators) and knows of the vehicle its mass, inertia and
motor lag, and a linear drag that is right at hover alone.

Without `--sensors` both fly on the truth, at 200 Hz. With it both fly on what our estimator makes of our sensors on
RotorPy's vehicle, at 250 Hz, each with the same seeds: "told" is the place that the estimator tells beside the
trajectory, "true" the true one; means over the seeds.
"""

import argparse
import json
import math
from typing import Any

import numpy as np

from companion.control.controller import THRUST, TORQUE, Controller
from companion.runtime.files import load_settings
from companion.state import Output, Reference, VehicleState
from protocol.arrays import Array
from protocol.frames import flu_to_frd
from protocol.toml_files import find, load
from protocol.vehicle_parameters import GRAVITY, VehicleParameters
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.settings import SensorSettings
from vehicle_sim.sensors.suite import SensorSuite
from vehicle_sim.timing import TICK_NS, TICK_S

STEP_S = 0.005
"""On the truth; on sensors it is a tick of theirs."""
LAST_S = 12.0
SETTINGS = [
    "rates.attitude=200.0",
    "limits.tilt_deg=85.0",
    "limits.lowest_thrust=0.01",
    "limits.highest_thrust=1.0",
    "limits.roll_pitch_rate_deg=2000.0",
    "control.attitude.bandwidth=[20.0, 20.0, 10.0]",
]


def trajectories() -> dict[str, Any]:
    """Circles and lemniscates of Gerono of peak speed 2, 4, 8 m/s; radius 3 m, and 6 m at 8 m/s."""
    from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
    from rotorpy.trajectories.lissajous_traj import TwoDLissajous

    found: dict[str, Any] = {}
    for speed, radius in ((2.0, 3.0), (4.0, 3.0), (8.0, 6.0)):
        turns = speed / radius / (2.0 * math.pi)
        circle = ThreeDCircularTraj(radius=np.array([radius, radius, 0.0]), freq=np.array([turns, turns, 0.0]))
        found[f"circle {speed:g} m/s"] = circle
        rate = speed / radius / math.sqrt(2.0)
        eight = TwoDLissajous(A=radius, B=radius / 2.0, a=rate, b=2.0 * rate, x_offset=0.0, y_offset=0.0)
        found[f"lemniscate {speed:g} m/s"] = eight
    return found


def body_of(parameters: dict[str, Any]) -> VehicleParameters:
    """RotorPy's vehicle as our controller knows it."""
    arm = float(np.linalg.norm(parameters["rotor_pos"]["r1"]))
    most = parameters["k_eta"] * parameters["rotor_speed_max"] ** 2
    turning = 4.0 * math.sqrt(parameters["mass"] * GRAVITY / (4.0 * parameters["k_eta"]))  # rad/s of all at hover
    return VehicleParameters(
        mass_kg=parameters["mass"],
        arm_length_m=arm,
        inertia_kgm2=(parameters["Ixx"], parameters["Iyy"], parameters["Izz"]),
        rotor_max_thrust_n=most,
        torque_per_thrust_m=parameters["k_m"] / parameters["k_eta"],
        drag_kg_s=(turning * parameters["k_d"], turning * parameters["k_d"], turning * parameters["k_z"]),
        rotor_time_constant_s=parameters["tau_m"],
    )


class Ours:
    """The companion's controller behind RotorPy's interface of a controller."""

    def __init__(self, parameters: dict[str, Any], trajectory: Any) -> None:
        self._body = body_of(parameters)
        self._trajectory = trajectory
        self._controller = Controller(load_settings(None, SETTINGS), self._body, Output.ACTUATORS)

    def update(self, time: float, state: dict[str, Array], flat: dict[str, Any]) -> dict[str, Any]:
        """Thrust (N) and moment (N m) for RotorPy's "cmd_ctbm"; RotorPy is x forward, y left, z up throughout."""
        now = round((time + 10.0) * 1e9)
        i, j, k, w = state["q"]
        measured = VehicleState(
            now, flu_to_frd(state["x"]), flu_to_frd(state["v"]), np.array([w, i, -j, -k]), flu_to_frd(state["w"]), 0
        )
        reference, ahead = (self._reference(at * 1e-9 - 10.0) for at in self._controller.reference_times(now))
        acceleration = self._controller.acceleration_command(measured, now, now, reference, self._body.mass_kg, True)
        out, _ = self._controller.attitude_command(acceleration, now, ahead, self._body.mass_kg)
        torque = out[TORQUE] * np.array(self._body.full_torque_nm)
        return {"cmd_thrust": out[THRUST] * self._body.max_thrust_n, "cmd_moment": flu_to_frd(torque)}

    def _reference(self, time: float) -> Reference:
        flat = self._trajectory.update(time)
        motion = [flu_to_frd(flat[key]) for key in ("x", "x_dot", "x_ddot", "x_dddot", "x_ddddot")]
        return Reference(np.array([*motion, np.zeros(3)]))


class Sensors:
    """What RotorPy's vehicle senses and estimates: its state as it is told. RotorPy's attitudes are (i, j, k, w)."""

    def __init__(self, level: str, seed: int, start: dict[str, Array]) -> None:
        settings = load(find("vehicles/sensors", level), SensorSettings)
        noise, alignment = np.random.default_rng(seed).spawn(2)
        first = self._motion(0, start)
        self._estimator = Estimator(SensorSuite(settings, first, noise), 0.0, first, alignment)

    @staticmethod
    def _motion(time_ns: int, state: dict[str, Array]) -> Motion:
        i, j, k, w = state["q"].tolist()
        position, velocity, rates = (tuple(flu_to_frd(state[key]).tolist()) for key in "xvw")
        none = (0.0, 0.0, 0.0)
        return Motion(
            time_ns, position, velocity, (w, i, -j, -k), rates, (0.0,) * 4, False, 0.0, none, none, 0.0
        )  # fmt: skip

    def told(self, step: int, state: dict[str, Array]) -> dict[str, Array]:
        """The state at the end of a step, as it is told."""
        present, _ = self._estimator.update(self._motion(step * TICK_NS, state))
        w, i, j, k = present.attitude_ned_frd
        values = present.position_ned, present.velocity_ned, present.rates_frd
        x, v, rates = (flu_to_frd(np.array(each)) for each in values)
        return {**state, "x": x, "v": v, "w": rates, "q": np.array([i, -j, -k, w])}


def rmse(
    controller: Any, abstraction: str, parameters: dict[str, Any], trajectory: Any, level: str | None, seed: int
) -> tuple[float, float]:
    """m, by RotorPy's own vehicle: as it was told, and true."""
    from rotorpy.vehicles.multirotor import Multirotor

    start = trajectory.update(0.0)
    hover = math.sqrt(parameters["mass"] * GRAVITY / (4.0 * parameters["k_eta"]))
    state = {
        "x": start["x"],
        "v": start["x_dot"],
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, hover),
    }
    vehicle = Multirotor(parameters, initial_state=state, control_abstraction=abstraction)
    sensors, step_s = (None, STEP_S) if level is None else (Sensors(level, seed, state), TICK_S)
    told, errors = state, []
    for step in range(round(LAST_S / step_s)):
        flat = trajectory.update(step * step_s)
        if step * step_s >= 1.0:
            errors.append((told["x"] - flat["x"], state["x"] - flat["x"]))
        state = vehicle.step(state, controller.update(step * step_s, told, flat), step_s)
        told = state if sensors is None else sensors.told(step + 1, state)
    of_told, of_true = np.sqrt((np.array(errors) ** 2).sum(axis=2).mean(axis=0)).tolist()
    return of_told, of_true


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensors", help="a name in vehicles/sensors/: rtk, gnss or vio")
    parser.add_argument("--seeds", type=int, default=5, help="of the sensors' errors")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    try:
        from rotorpy.controllers.quadrotor_control import SE3Control
        from rotorpy.vehicles.hummingbird_params import quad_params
    except ImportError:
        raise SystemExit("RotorPy is not installed: pip install rotorpy==3.0.0") from None
    level = arguments.sensors
    seeds = [1] if level is None else range(1, arguments.seeds + 1)
    result = {}
    for name, trajectory in trajectories().items():
        flown = [
            (
                *rmse(SE3Control(quad_params), "cmd_motor_speeds", quad_params, trajectory, level, seed),
                *rmse(Ours(quad_params, trajectory), "cmd_ctbm", quad_params, trajectory, level, seed),
            )
            for seed in seeds
        ]
        theirs, theirs_true, ours, ours_true = np.mean(flown, axis=0).tolist()
        result[name] = {"rotorpy_m": round(theirs, 5), "ours_m": round(ours, 5), "ratio": round(theirs / ours, 1)}
        if level is not None:
            result[name] |= {"rotorpy_true_m": round(theirs_true, 5), "ours_true_m": round(ours_true, 5)}
    if arguments.json:
        print(json.dumps(result))
        return
    truth = "" if level is None else f"{'RotorPy, true':>14} {'ours, true':>11}"
    print(f"{'RMSE / m':20} {'RotorPy SE3':>12} {'ours':>10} {'ratio':>8} {truth}")
    for name, row in result.items():
        true = "" if level is None else f"{row['rotorpy_true_m']:14.4f} {row['ours_true_m']:11.4f}"
        print(f"{name:20} {row['rotorpy_m']:12.4f} {row['ours_m']:10.5f} {row['ratio']:8.1f} {true}")


if __name__ == "__main__":
    main()
