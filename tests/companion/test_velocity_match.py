"""The velocity that goes with the position as it moves."""

from collections.abc import Callable

import numpy as np
import pytest

from companion.estimate import Estimator
from companion.reports import AttitudeReport, PositionReport
from companion.velocity_match import VelocityMatch
from protocol.arrays import Array

STEP_MS = 8
SETTLING = 0.5
LACK = np.array([-0.1, 0.25, 0.08])


def circle(seconds: float) -> tuple[Array, Array]:
    """4 m/s on 3 m."""
    angle = 4.0 / 3.0 * seconds
    place = np.array([3.0 * np.sin(angle), 3.0 - 3.0 * np.cos(angle), -3.0])
    return place, np.array([4.0 * np.cos(angle), 4.0 * np.sin(angle), 0.0])


def flying(settling: float = SETTLING) -> VelocityMatch:
    match = VelocityMatch(settling)
    match.begin(stands=False)
    return match


def fed(seconds: float, said: Callable[[float, Array], Array]) -> tuple[VelocityMatch, Array]:
    """After reports for so long, the error (3,) of the last velocity (m/s)."""
    match, error = flying(), np.zeros(3)
    for ms in range(0, round(seconds * 1000.0), STEP_MS):
        place, velocity = circle(ms * 1e-3)
        np.subtract(match.velocity(PositionReport(ms, place, said(ms * 1e-3, velocity))), velocity, out=error)
    return match, error


def lacking(seconds: float, velocity: Array) -> Array:
    lacks: Array = velocity - LACK
    return lacks


def test_what_agrees_stays() -> None:
    assert np.abs(fed(20.0, lambda seconds, velocity: velocity)[1]).max() < 2e-4


@pytest.mark.parametrize(("seconds", "left"), [(0.5, np.exp(-1.0)), (1.5, np.exp(-3.0)), (10.0, 0.0)])
def test_what_is_lacking_is_learned_as_by_a_filter_of_first_order(seconds: float, left: float) -> None:
    assert np.abs(fed(seconds, lacking)[1] + left * LACK).max() < 0.005


def test_noise_of_the_positions_makes_little_speed() -> None:
    rng, match, worst = np.random.default_rng(1), flying(), 0.0
    for ms in range(0, 20_000, STEP_MS):
        place, velocity = circle(ms * 1e-3)
        heard = match.velocity(PositionReport(ms, place + rng.normal(0.0, 0.01, 3), velocity))
        worst = max(worst, float(np.abs(heard - velocity).max()))
    assert worst < 0.1, "0.01 m from one message to the next would be 1.8 m/s"


def test_a_jump_or_a_gap_is_no_speed() -> None:
    match, _ = fed(10.0, lacking)
    place, velocity = circle(10.0)
    jumped = match.velocity(PositionReport(10_000, place + np.array([0.0, 0.5, 0.0]), lacking(10.0, velocity)))
    assert jumped == pytest.approx(velocity, abs=0.005)
    place, velocity = circle(10.5)
    late = match.velocity(PositionReport(10_500, place, lacking(10.5, velocity)))
    assert late == pytest.approx(velocity, abs=0.005)


def test_it_is_limited() -> None:
    _, error = fed(20.0, lambda seconds, velocity: velocity - np.array([3.0, 0.0, 0.0]))
    assert error == pytest.approx([-2.0, 0.0, 0.0], abs=1e-3)


def test_the_state_has_it() -> None:
    estimator = Estimator(SETTLING)
    estimator.begin(stands=False)
    for ms in range(0, 10_000, STEP_MS):
        place, velocity = circle(ms * 1e-3)
        estimator.attitude(AttitudeReport(ms, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)), ms * 1_000_000)
        estimator.position(PositionReport(ms, place, velocity - LACK), ms * 1_000_000)
    state = estimator.state()
    assert state is not None and state.velocity_ned == pytest.approx(velocity, abs=0.005)


def test_it_can_be_switched_off() -> None:
    match = flying(0.0)
    for ms in range(0, 2000, STEP_MS):
        place, velocity = circle(ms * 1e-3)
        assert (match.velocity(PositionReport(ms, place, lacking(1.0, velocity))) == velocity - LACK).all()


def test_of_a_vehicle_that_stands_nothing_is_learned_until_it_has_left() -> None:
    """Held by the ground it may say that it climbs."""
    match, climbing = VelocityMatch(SETTLING), np.array([0.0, 0.0, -1.2])
    match.begin(stands=True)
    for ms in range(0, 1000, STEP_MS):
        assert (match.velocity(PositionReport(ms, np.zeros(3), climbing)) == climbing).all()
    for ms in range(1000, 5000, STEP_MS):
        place = np.array([0.0, 0.0, -1.0e-3 * (ms - 1000)])
        velocity = match.velocity(PositionReport(ms, place, climbing))
        assert place[2] < -0.3 or (velocity == climbing).all()
    assert velocity == pytest.approx([0.0, 0.0, -1.0], abs=0.005)
