"""The table in which position laws are registered."""

import numpy as np
import pytest

from companion.config import POSITION_LAWS
from companion.control import controller, laws
from companion.control.parameters import controller_parameters
from companion.control.tracking_error import TrackingError
from companion.records import CONTROL_FIELDS
from companion.reports import LinkDelay
from companion.runtime.files import load_body, load_settings
from companion.state import Output, Reference, VehicleState

STILL = Reference(np.zeros((6, 3)))


def test_the_settings_know_every_law_and_no_other() -> None:
    assert tuple(laws.LAWS) == POSITION_LAWS
    assert len({law.number for law in laws.LAWS.values()}) == len(laws.LAWS)


@pytest.mark.parametrize("name", laws.LAWS)
def test_the_compiled_choice_is_the_tables(name: str) -> None:
    """The number of a law leads to its own function, with its own gains from the settings."""
    rng = np.random.default_rng(1)
    law = laws.LAWS[name]
    settings = load_settings(None, [f"control.position.law={name}"])
    parameters = controller_parameters(settings, load_body("paper_quad"), Output.RATES)[0]
    assert parameters["law"] == law.number
    rows = law.gains(settings.control)
    assert 0 < len(rows) <= laws.GAINS and np.array_equal(parameters["gains"][: len(rows)], rows)
    found = []
    for _ in range(10):
        error, acceleration = TrackingError(*rng.normal(size=(4, 3))), rng.normal(size=3)
        gains = rng.uniform(0.5, 5.0, size=(laws.GAINS, 3))
        found.append(laws.acceleration_command(law.number, error, acceleration, gains))
        assert np.array_equal(found[-1], law.acceleration_command(error, acceleration, gains))
    others = [each for other, each in laws.LAWS.items() if other != name]
    assert not any(np.array_equal(found[-1], each.acceleration_command(error, acceleration, gains)) for each in others)


def test_an_integral_gives_at_another_pace_what_it_has_given() -> None:
    """PID against a steady push, that nothing else estimates, over a link that becomes late."""
    body = load_body("paper_quad")
    flown = controller.Controller(load_settings(None, ["control.position.law=pid"]), body, Output.RATES)
    flown._memory["integral"] = 0.5, -0.2, 0.1
    state = VehicleState(0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
    shares, given = [], []
    for delay in (LinkDelay(), LinkDelay(age=0.15, command=0.15), LinkDelay()):
        flown.follow(delay)
        shares.append(flown.pace.share)
        given.append(flown.acceleration_command(state, 1, 1, STILL, body.mass_kg, False))
    assert shares[1] < 0.9
    assert np.array(given) == pytest.approx(np.tile((1.0, -0.4, 0.2), (3, 1)))


def test_the_controllers_places_are_those_of_the_records_fields() -> None:
    ends = np.cumsum([size for _, size in CONTROL_FIELDS]).tolist()
    places = {name: slice(end - size, end) for (name, size), end in zip(CONTROL_FIELDS, ends, strict=True)}
    assert places["attitude_command_ned_frd"] == controller.ATTITUDE
    assert places["rates_command_frd"] == controller.RATES
    assert places["torque_command"] == controller.TORQUE
    assert places["thrust_command"].start == controller.THRUST
    assert ends[-1] == controller.SIZE
