"""What a step of 1 ms costs (us of a core): physics with the control laws, sensors with the filter, and RotorPy's step.

    pip install rotorpy==3.0.0                        # for RotorPy's figure
    python bench/step.py [--sensors gnss] [--json]

RotorPy integrates its Hummingbird over 1 ms under motor speeds, by the solver that it uses by default, without any
control law or sensor.
"""

import argparse
import json
import math
import time
from collections.abc import Callable

import numpy as np

from protocol.toml_files import find, load
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe, parameters
from vehicle_sim.autopilot.control_laws import COMMAND, Level
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.physics.integrator import work_array
from vehicle_sim.physics.motion import FEEDBACK, Motion
from vehicle_sim.physics.rigid_body import STATES
from vehicle_sim.sensors.settings import SensorSettings
from vehicle_sim.sensors.suite import SensorSuite
from vehicle_sim.tick import EXACT, advance
from vehicle_sim.timing import STEP_S, STEPS_PER_TICK, TICK_NS

PARTS = 10
"""Parts of a run, of which the shortest counts."""
TICKS = 2000
"""Ticks of a part; RotorPy's has a tenth of them, of one step each."""


def shortest_us(steps: int, run: Callable[[], object]) -> float:
    """us a step, of a run of so many, after one that is not counted."""
    run()
    took = []
    for _ in range(PARTS):
        began = time.process_time()
        run()
        took.append(time.process_time() - began)
    return min(took) / steps * 1e6


def physics_us() -> float:
    """Physics and control laws, in a hover on attitude."""
    airframe = Airframe.load(find("vehicles", "paper_quad"))
    state, command, feedback = np.zeros(STATES), np.zeros(1, COMMAND), np.zeros(1, FEEDBACK)
    state[2], state[6] = -10.0, 1.0
    command["level"], command["attitude_ned_frd"] = Level.ATTITUDE, (1.0, 0.0, 0.0, 0.0)
    command["thrust_n"] = airframe.takeoff_mass_kg * GRAVITY
    known, work = parameters(airframe), work_array()

    def run() -> None:
        for _ in range(TICKS):
            advance(state, command, known, feedback, work, EXACT)

    return shortest_us(TICKS * STEPS_PER_TICK, run)


def sensors_us(settings: SensorSettings) -> float:
    """Sensors and filter, at rest 3 m up."""
    none = (0.0, 0.0, 0.0)
    start = Motion(0, (0.0, 0.0, -3.0), none, (1.0, 0.0, 0.0, 0.0), none, (0.0,) * 4, False, 0.0, none, none, 0.0)
    noise, alignment = np.random.default_rng(1).spawn(2)
    estimator = Estimator(SensorSuite(settings, start, noise), 0.0, start, alignment)
    motions = iter([start._replace(time_ns=(tick + 1) * TICK_NS) for tick in range(TICKS * (PARTS + 1))])

    def run() -> None:
        for _ in range(TICKS):
            estimator.update(next(motions))

    return shortest_us(TICKS * STEPS_PER_TICK, run)


def rotorpy_us() -> float | None:
    """RotorPy's step; None if it is not installed."""
    try:
        from rotorpy.vehicles.hummingbird_params import quad_params
        from rotorpy.vehicles.multirotor import Multirotor
    except ImportError:
        return None
    vehicle = Multirotor(quad_params, control_abstraction="cmd_motor_speeds")
    hover = math.sqrt(quad_params["mass"] * GRAVITY / (4.0 * quad_params["k_eta"]))
    control = {"cmd_motor_speeds": np.full(4, hover)}
    state = vehicle.initial_state

    def run() -> None:
        now = state
        for _ in range(TICKS // 10):
            now = vehicle.step(now, control, STEP_S)

    return shortest_us(TICKS // 10, run)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensors", default="gnss")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    settings = load(find("vehicles/sensors", options.sensors), SensorSettings)
    rows = {"physics and control laws": physics_us(), f"sensors and filter, {options.sensors}": sensors_us(settings)}
    theirs = rotorpy_us()
    if theirs is not None:
        rows["RotorPy's step"] = theirs
    if options.json:
        print(json.dumps(rows))
        return
    for name, cost in rows.items():
        print(f"{name:32} {cost:8.2f} us a step of 1 ms")


if __name__ == "__main__":
    main()
