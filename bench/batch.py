"""Many vehicles in one compiled step: the responses of disturbed hovers and steps, and vehicle-steps a second of
one core's time.

    pip install rotorpy==3.0.0 torch torchdiffeq roma        # for RotorPy's figures
    python bench/batch.py [--vehicles 10000] [--json]

A vehicle-step is one step of the integration with the control laws: of 1 ms by classical Runge-Kutta here; RotorPy's
`BatchedMultirotor` is asked for one of the same length under motor speeds, without any control law.
"""

import argparse
import json
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from protocol.toml_files import find
from studies.batch import Fleet, hovers_and_steps
from vehicle_sim.airframe import Airframe
from vehicle_sim.timing import STEP_S, STEPS_PER_TICK, TICK_S


def rate(steps: int, run: Callable[[], object], rounds: int = 3) -> float:
    """Steps a second of one core's time: the median of some rounds, after one that is not counted."""
    run()
    times = []
    for _ in range(rounds):
        began = time.process_time()
        run()
        times.append(time.process_time() - began)
    return steps / statistics.median(times)


def ours(airframe: Airframe, count: int) -> float:
    numba.set_num_threads(1)
    ticks = 25
    fleet = Fleet.hovering(airframe, count)
    return rate(count * ticks * STEPS_PER_TICK, lambda: fleet.fly(ticks * TICK_S, last_s=TICK_S))


def rotorpy(count: int) -> float | None:
    """None if it is not installed."""
    try:
        import torch
        from rotorpy.vehicles.hummingbird_params import quad_params
        from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams
    except (ImportError, NameError):
        return None
    torch.set_num_threads(1)
    device = torch.device("cpu")
    hover = math.sqrt(quad_params["mass"] * 9.81 / (4.0 * quad_params["k_eta"]))
    zeros = torch.zeros(count, 3, dtype=torch.double)
    state: dict[str, Any] = {
        "x": zeros,
        "v": zeros,
        "q": torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.double).repeat(count, 1),
        "w": zeros,
        "wind": zeros,
        "rotor_speeds": torch.full((count, 4), hover, dtype=torch.double),
    }
    known = BatchedMultirotorParams([quad_params] * count, count, device)
    vehicle = BatchedMultirotor(known, count, state, device, integrator="rk4", control_abstraction="cmd_motor_speeds")
    control = {"cmd_motor_speeds": state["rotor_speeds"]}
    return rate(count * 10, lambda: [vehicle.step(state, control, STEP_S) for _ in range(10)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=10_000)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    airframe = Airframe.load(find("vehicles", "paper_quad"))
    began = time.perf_counter()
    found = hovers_and_steps(airframe, arguments.vehicles)
    result: dict[str, Any] = {"study_s": round(time.perf_counter() - began, 1)}
    for name in ("offset_m", "overshoot_m", "settling_s"):
        values = np.percentile(getattr(found, name), [5, 50, 95, 100])
        result[name] = dict(zip(("5 %", "median", "95 %", "most"), values.round(3).tolist(), strict=True))
    result["steps_s_core"] = round(ours(airframe, arguments.vehicles))
    theirs = rotorpy(arguments.vehicles)
    result["rotorpy_steps_s_core"] = None if theirs is None else round(theirs)
    print(json.dumps(result, indent=None if arguments.json else 1))


if __name__ == "__main__":
    main()
