"""Gains that no vehicle flies with are refused before the flight."""

import msgspec
import pytest

from companion.control.stability import unstable
from companion.runtime.feasibility import PlanError, check_gains
from companion.runtime.files import load_body, load_settings
from companion.state import Output

BODY = load_body("paper_quad")
STIFF = ("control.position.c1=[10.0, 10.0, 10.0]", "control.position.c2=[10.0, 10.0, 10.0]")
"""Four times the defaults: on the errand the vehicle swings between its tilt limits, and hits the ground."""
SLOW_ATTITUDE = ("control.attitude.bandwidth=[2.0, 2.0, 2.0]",)
"""It hits the street lamp of the errand."""


@pytest.mark.parametrize("vehicle", ["paper_quad", "x500", "iris", "px4_sih", "sun_quad"])
@pytest.mark.parametrize("law", ["backstepping", "se3", "sliding_mode", "pid"])
def test_the_defaults_are_stable(vehicle: str, law: str) -> None:
    settings = load_settings(None, [f"control.position.law={law}"])
    assert [unstable(settings, load_body(vehicle), output) for output in Output] == [None] * len(Output)


@pytest.mark.parametrize("output", list(Output))
def test_gains_that_do_not_suit_the_vehicle_are_told(output: Output) -> None:
    assert "along north it swings at" in str(unstable(load_settings(None, STIFF), BODY, output))
    told = unstable(load_settings(None, SLOW_ATTITUDE), BODY, output)
    assert (told is None) is (output is Output.ATTITUDE), "the vehicle keeps an attitude by its own gains"


@pytest.mark.parametrize(
    "override",
    [
        "control.position.c2=[2.5, 100.0, 2.5]",
        "control.attitude.angle_weight=[0.1, 400.0, 50.0]",
    ],
)
def test_each_axis_counts(override: str) -> None:
    assert "along east" in str(unstable(load_settings(None, [override]), BODY, Output.RATES))


def test_they_are_refused_with_the_tables_to_change() -> None:
    for settings, output in ((STIFF, None), (STIFF, Output.ACTUATORS), (SLOW_ATTITUDE, None)):
        with pytest.raises(PlanError, match=r"control\.position, control\.attitude: with these gains of backstepping"):
            check_gains(load_settings(None, settings), BODY, output)
    check_gains(load_settings(None, SLOW_ATTITUDE), BODY, Output.ATTITUDE)


@pytest.mark.parametrize(
    ("slow", "flies", "words"),
    [
        ({"rotor_time_constant_s": 0.12}, {"rotor_time_constant_s": 0.072}, r"rotor_time_constant_s 0\.12, "),
        ({"rate_loop_gain_1_s": (5.0, 5.0, 2.5)}, {"rate_loop_gain_1_s": (8.4, 8.4, 4.2)}, "rate_loop_gain_1_s 5, 5,"),
    ],
)
def test_a_vehicle_that_turns_too_slowly_for_the_gains_is_refused_by_its_body(
    slow: dict[str, float], flies: dict[str, float], words: str
) -> None:
    """On the errand a vehicle whose rotors lag by 0.12 s hit the ground, one with a quarter of the rate loop's gain
    never settled; one with 0.072 s delivers."""
    for output in (None, Output.RATES):
        with pytest.raises(PlanError, match=rf"\[body\] \(.*{words}"):
            check_gains(load_settings(None, []), msgspec.structs.replace(BODY, **slow), output)
        check_gains(load_settings(None, []), msgspec.structs.replace(BODY, **flies), output)
