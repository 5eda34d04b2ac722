"""Cost of references in flight, and of curves of least snap beside the library minsnap-trajectories.

    python bench/trajectory.py [--json]

Both are given the same points and the same times of the legs (as if each were flown on its own), so that the integral
of the squared snap tells whether they solve the same problem; "allocated" is ours with its own times. Peaks are at the
least duration at which speed and acceleration keep to their limits.
"""

import argparse
import json
import math
import statistics
import time
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from companion.config import Trajectory
from companion.curves import Curve, Route, Shape
from companion.trajectory import ReferenceGenerator, track_of
from companion.trajectory.minimum_snap import (
    Limits,
    PiecewisePolynomial,
    optimal_shares,
    rest_to_rest_durations,
    snap_integral,
    spline_through,
)
from protocol.arrays import Array

LIMITS = Limits(speed=4.0, acceleration=3.0, tilt=math.radians(35.0))
CALLS = 20_000
SOLUTIONS = 50


def course(legs: int) -> Array:
    """(legs + 1, 3) points some metres apart."""
    rng = np.random.default_rng(legs)
    return np.concatenate((np.zeros((1, 3)), np.cumsum(rng.uniform(-8.0, 8.0, (legs, 3)) * [1, 1, 0.2], axis=0)))


def median_us(call: Callable[[], object], calls: int) -> float:
    """Median (us) of single calls, after one that is not counted."""
    call()
    times = []
    for _ in range(calls):
        start = time.perf_counter_ns()
        call()
        times.append(time.perf_counter_ns() - start)
    return statistics.median(times) / 1e3


def library(points: Array, durations: Array) -> PiecewisePolynomial:
    """The same curve by the closed form of minsnap-trajectories, at rest up to the jerk at both ends."""
    from minsnap_trajectories import Waypoint, generate_trajectory

    knots = np.concatenate(([0.0], np.cumsum(durations)))
    zero = np.zeros(3)
    ends = (0, len(points) - 1)
    references = [
        Waypoint(at, point, zero, zero, zero) if i in ends else Waypoint(at, point)
        for i, (at, point) in enumerate(zip(knots.tolist(), points, strict=True))
    ]
    found = generate_trajectory(references, 7, idx_minimized_orders=4, num_continuous_orders=4)
    return PiecewisePolynomial(knots, np.ascontiguousarray(found.coefficients))


def quality(curve: PiecewisePolynomial) -> dict[str, float]:
    """Figures of a curve, stretched until it keeps to the limits."""
    motion = np.array([curve.at(t) for t in np.linspace(0.0, curve.duration_s, 5001).tolist()])
    speed = float(np.linalg.norm(motion[:, 1], axis=1).max())
    acceleration = float(np.linalg.norm(motion[:, 2], axis=1).max())
    stretch = max(speed / LIMITS.speed, math.sqrt(acceleration / LIMITS.acceleration))
    return {
        "snap integral": snap_integral(curve),
        "duration_s": curve.duration_s * stretch,
        "peak speed": speed / stretch,
        "peak acceleration": acceleration / stretch**2,
    }


def solutions(legs: int) -> dict[str, dict[str, float]]:
    points = course(legs)
    durations = rest_to_rest_durations(points, LIMITS.speed, LIMITS.acceleration)
    rows = {"ours": {"time_us": median_us(lambda: spline_through(points, durations), SOLUTIONS)}}
    rows["ours"] |= quality(spline_through(points, durations))
    if find_spec("minsnap_trajectories") is not None:
        rows["library"] = {"time_us": median_us(lambda: library(points, durations), SOLUTIONS)}
        rows["library"] |= quality(library(points, durations))
    rows["allocated"] = {"time_us": median_us(lambda: optimal_shares(points, LIMITS), 3)}
    best = spline_through(points, optimal_shares(points, LIMITS))
    rows["allocated"] |= quality(best.stretched(float(durations.sum())))
    return rows


def reference_cost(curve: Curve | None) -> float:
    """Cost (us) of one reference on a curve; None: a jerk-limited move."""
    settings = Trajectory()
    generator = ReferenceGenerator(settings)
    if curve is None:
        generator.move_to(0, np.array([30.0, 20.0, -5.0]), 4.0, 1.5)
    else:
        generator.follow(0, track_of(curve, settings, LIMITS.tilt))
    return median_us(lambda: generator.at(5_000_000_000), CALLS)


def main() -> None:
    parser = argparse.ArgumentParser(description="cost of references, and of curves of least snap beside a library")
    parser.add_argument("--json", action="store_true", help="one object instead of the tables")
    as_json = parser.parse_args().json
    references = {
        "jerk-limited": reference_cost(None),
        "circle": reference_cost(Shape("circle", speed=4.0, radius=3.0, laps=5.0, heading="along")),
        "square": reference_cost(Shape("square", speed=4.0, radius=3.0, laps=5.0)),
        "minimum snap": reference_cost(Route(course(12), 4.0)),
    }
    curves = {legs: solutions(legs) for legs in (2, 6, 12, 24)}
    if as_json:
        print(json.dumps({"bench": "trajectory", "reference_us": references, "minimum_snap": curves}))
        return
    print("one reference, us p50")
    for name, cost in references.items():
        print(f"  {name:<14}{cost:8.1f}")
    columns = ("time_us", "snap integral", "duration_s", "peak speed", "peak acceleration")
    print(f"{'legs':<6}{'':<12}" + "".join(f"{column:>19}" for column in columns))
    for legs, rows in curves.items():
        for name, row in rows.items():
            print(f"{legs:<6}{name:<12}" + "".join(f"{row[column]:>19.6g}" for column in columns))


if __name__ == "__main__":
    main()
