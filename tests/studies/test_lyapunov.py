"""V along motions whose V' is known, and along a flight."""

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.control import backstepping
from companion.control.tracking_error import TrackingError
from companion.records import TRACE
from protocol.arrays import Array
from studies.lyapunov import FLIGHTS, LEAST, PERIOD_S, C, course, fly

C1, C2 = np.full(3, C), np.ones(3)
NOTHING = np.zeros(3)


def law(position: Array, velocity: Array) -> tuple[Array, Array, Array]:
    """The acceleration to the origin, e1 and e2; (3,) each."""
    e1, e2 = backstepping.errors(position, velocity, NOTHING, NOTHING, C1)
    error = TrackingError(e1, -velocity, e2, NOTHING)
    return backstepping.acceleration_command(error, NOTHING, np.array([C1, C2])), e1, e2


def motion(disturbance: Array, seconds: float = 4.0) -> NDArray[np.void]:
    """The trace of a double integrator from 1 m north and 2 m east of its target, pushed by an acceleration (3,)."""
    trace = np.zeros(round(seconds / PERIOD_S), TRACE.dtype)
    position, velocity = np.array([1.0, -2.0, 0.0]), np.zeros(3)
    for record in trace:
        acceleration, e1, e2 = law(position, velocity)
        v, v_rate = backstepping.lyapunov(e1, e2, C1, C2)
        record["velocity_ned"], record["acceleration_command_ned"] = velocity, acceleration
        record["e1"], record["e2"], record["lyapunov"], record["lyapunov_rate"] = e1, e2, v, v_rate
        for _ in range(40):
            command, _, _ = law(position, velocity)
            position = position + PERIOD_S / 40.0 * velocity
            velocity = velocity + PERIOD_S / 40.0 * (command + disturbance)
    return trace


def test_an_obeyed_command_makes_v_fall_as_promised() -> None:
    ideal = course(motion(NOTHING))
    scale = np.abs(ideal.promised).max()
    assert np.abs(ideal.rate - ideal.promised).max() < 1e-3 * scale
    assert np.abs(ideal.missed).max() < 1e-3 * scale
    assert ideal.v[0] == pytest.approx(0.5 * (1.0 + C**2) * 5.0, rel=0.02) and ideal.v[-1] < 1e-2
    assert not ideal.rises.any() and ideal.must_fall[ideal.v > LEAST].all()
    assert np.all(ideal.v1 <= ideal.v)


def test_a_push_misses_e2_times_itself() -> None:
    push = np.array([0.0, 0.0, 2.0])
    trace = motion(push)
    pushed = course(trace)
    expected = 0.5 * (trace["e2"][1:] + trace["e2"][:-1]) @ push
    assert np.abs(pushed.missed - expected).max() < 1e-3 * np.abs(pushed.promised).max()
    assert np.abs(pushed.rate - pushed.promised - pushed.missed).max() < 1e-3 * np.abs(pushed.promised).max()
    assert pushed.v[-1] == pytest.approx(0.5 * (1.0 + C**2) * (2.0 / (1.0 + C)) ** 2, rel=0.02)
    assert not pushed.must_fall[pushed.rises].any()


def test_v_falls_in_flight() -> None:
    flown = fly(FLIGHTS["1 m"])
    assert np.abs(flown.rate - flown.promised - flown.missed).max() < 1e-3 * np.abs(flown.promised).max()
    assert flown.v[0] == pytest.approx(0.5 * (1.0 + C**2), rel=0.01) and flown.v[-1] < 1e-9
    assert not flown.rises.any()
