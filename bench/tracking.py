"""Tracking beside RotorPy: its own SE3 controller and ours on its own vehicle, the same trajectories, in one run.

    pip install rotorpy==3.0.0
    python bench/tracking.py [--json]

RotorPy's AscTec Hummingbird with its aerodynamics and motors at 200 Hz, no noise, started on the trajectory; RMSE of
position after the first second. Ours commands thrust and torque there (output actuators) and knows of the vehicle its
mass, inertia and motor lag, and a linear drag that is right at hover alone.
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
from protocol.vehicle_parameters import GRAVITY, VehicleParameters

STEP_S = 0.005
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


def rmse(controller: Any, abstraction: str, parameters: dict[str, Any], trajectory: Any) -> float:
    """m, by RotorPy's own vehicle."""
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
    errors = []
    for step in range(round(LAST_S / STEP_S)):
        flat = trajectory.update(step * STEP_S)
        if step * STEP_S >= 1.0:
            errors.append(state["x"] - flat["x"])
        state = vehicle.step(state, controller.update(step * STEP_S, state, flat), STEP_S)
    return float(np.sqrt((np.array(errors) ** 2).sum(axis=1).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    try:
        from rotorpy.controllers.quadrotor_control import SE3Control
        from rotorpy.vehicles.hummingbird_params import quad_params
    except ImportError:
        raise SystemExit("RotorPy is not installed: pip install rotorpy==3.0.0") from None
    result = {}
    for name, trajectory in trajectories().items():
        theirs = rmse(SE3Control(quad_params), "cmd_motor_speeds", quad_params, trajectory)
        ours = rmse(Ours(quad_params, trajectory), "cmd_ctbm", quad_params, trajectory)
        result[name] = {"rotorpy_m": round(theirs, 5), "ours_m": round(ours, 5), "ratio": round(theirs / ours, 1)}
    if arguments.json:
        print(json.dumps(result))
        return
    print(f"{'RMSE / m':20} {'RotorPy SE3':>12} {'ours':>10} {'ratio':>8}")
    for name, row in result.items():
        print(f"{name:20} {row['rotorpy_m']:12.4f} {row['ours_m']:10.5f} {row['ratio']:8.1f}")


if __name__ == "__main__":
    main()
