"""The gate lets a setpoint through if and only if no vehicle could misunderstand it."""

import math
from collections.abc import Sequence

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.state import Setpoint
from companion.supervision.gate import unsound

LEVEL = (1.0, 0.0, 0.0, 0.0)
NONE = (0.0, 0.0, 0.0)
ANY = st.one_of(st.floats(width=64), st.floats(-1.5, 1.5))
FRACTION = st.one_of(st.floats(-1.2, 1.2), st.sampled_from((0.0, -0.0, 1.0, -1.0, math.nextafter(1.0, 2.0))))


def vectors(size: int, values: st.SearchStrategy[float] = ANY) -> st.SearchStrategy[list[float]]:
    return st.lists(values, min_size=size, max_size=size)


@st.composite
def quaternions(draw: st.DrawFn) -> list[float]:
    """Quaternions of a length near to 1 or not, or of any numbers."""
    values = draw(vectors(4, st.floats(-1.0, 1.0)))
    length = math.sqrt(sum(value * value for value in values))
    if length < 1e-3:
        return draw(vectors(4))
    scale = draw(st.sampled_from((1.0, 1.0004, 0.9996, 1.001, 0.999, -1.0, 2.0))) / length
    return [value * scale for value in values]


@settings(max_examples=250)
@given(
    attitude=quaternions(),
    rates=vectors(3, st.floats(-30.0, 30.0) | ANY),
    torque=vectors(3, FRACTION),
    thrust=FRACTION,
)
@example(attitude=list(LEVEL), rates=list(NONE), torque=list(NONE), thrust=0.0)
@example(attitude=[-1.0, 0.0, 0.0, 0.0], rates=list(NONE), torque=[1.0, -1.0, 1.0], thrust=1.0)
@example(attitude=list(LEVEL), rates=[1e308, 1e308, -1e308], torque=list(NONE), thrust=0.5)
def test_a_setpoint_passes_if_and_only_if_it_is_sound(
    attitude: Sequence[float], rates: Sequence[float], torque: Sequence[float], thrust: float
) -> None:
    square = sum(value * value for value in attitude)
    finite = all(map(math.isfinite, (*attitude, *rates, *torque, thrust)))
    sound = (
        finite and abs(square - 1.0) <= 1e-3 and 0.0 <= thrust <= 1.0 and all(-1.0 <= value <= 1.0 for value in torque)
    )
    if sound and not math.isfinite(math.fsum((*attitude, *torque, thrust)) + sum(rates)):
        sound = False  # finite rates whose sum is not are beyond all that can be flown
    assert (unsound(Setpoint(attitude, rates, torque, thrust)) is None) is sound


@settings(max_examples=50)
@given(attitude=quaternions(), thrust=FRACTION)
def test_both_signs_of_a_quaternion_are_the_same_attitude(attitude: list[float], thrust: float) -> None:
    other = [-value for value in attitude]
    assert unsound(Setpoint(attitude, NONE, NONE, thrust)) == unsound(Setpoint(other, NONE, NONE, thrust))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(11))
def test_no_value_that_is_not_finite_passes(place: int, bad: float) -> None:
    values = [*LEVEL, *NONE, *NONE, 0.5]
    values[place] = bad
    assert unsound(Setpoint(values[:4], values[4:7], values[7:10], values[10])) == "not finite"


@pytest.mark.parametrize(
    ("setpoint", "reason"),
    [
        (Setpoint((0.99, 0.0, 0.0, 0.0), NONE, NONE, 0.5), "quaternion not of length 1"),
        (Setpoint((0.0, 0.0, 0.0, 0.0), NONE, NONE, 0.5), "quaternion not of length 1"),
        (Setpoint(LEVEL, NONE, NONE, 1.25), "thrust 1.25"),
        (Setpoint(LEVEL, NONE, NONE, -0.25), "thrust -0.25"),
        (Setpoint(LEVEL, NONE, (1.5, 0.0, 0.0), 0.5), "torque above 1"),
        (Setpoint(LEVEL, NONE, (0.0, 0.0, -1.5), 0.5), "torque above 1"),
    ],
)
def test_the_reason_is_named(setpoint: Setpoint, reason: str) -> None:
    assert unsound(setpoint) == reason


@pytest.mark.parametrize("beyond", [math.nextafter(1.0, 2.0), -math.nextafter(1.0, 2.0), 1.5, -1.5])
@pytest.mark.parametrize("axis", range(3))
def test_no_torque_beyond_the_vehicles_own_passes(axis: int, beyond: float) -> None:
    torque = [0.0, 0.0, 0.0]
    torque[axis] = beyond
    assert unsound(Setpoint(LEVEL, NONE, torque, 0.5)) == "torque above 1"
