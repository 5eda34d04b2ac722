"""The golden flights come out as recorded. After a change that is meant: `python tests/golden/golden.py update`."""

import pytest

from companion.logs.info import info
from companion.logs.replay import replay
from tests.golden.golden import FLIGHTS, difference, path_of

each_flight = pytest.mark.parametrize("name", FLIGHTS)


@each_flight
def test_the_same_bytes_are_sent(name: str) -> None:
    result = replay(path_of(name))
    assert not result.differences, f"run `python tests/golden/golden.py update` if this is meant:\n{difference(result)}"
    assert result.datagrams > 500 and result.flown_s > 5.0


@each_flight
def test_another_controller_is_noticed(name: str) -> None:
    result = replay(path_of(name), None, ["control.position.c1=[2.6, 2.5, 2.5]"])
    messages = {each.message for each in result.differences}
    assert "SET_ATTITUDE_TARGET" in messages
    assert messages <= {"SET_ATTITUDE_TARGET", "STATUSTEXT"}, "arrival is judged by the tracking, too"


@each_flight
def test_they_are_small_and_whole_flights(name: str) -> None:
    found = info(path_of(name), check=True)
    assert found.size_bytes < 500_000 and found.problem is None
    assert found.result["landed"] == "True" and found.flight["mission"] == "short"
