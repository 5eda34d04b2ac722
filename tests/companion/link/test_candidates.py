"""Who becomes the vehicle where anybody can send."""

import pytest

from companion.link.candidates import Candidates
from protocol.messages import dialect

PX4, ARDUPILOT, NONE = dialect.MAV_AUTOPILOT_PX4, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_INVALID


def beat(system: int = 1, component: int = 1, autopilot: int = PX4, version: int = 2) -> bytes:
    message = dialect.MAVLink_heartbeat_message(2, autopilot, 81, 0, 4, 3)
    return bytes(message.pack(dialect.MAVLink(None, system, component), force_mavlink1=version == 1))


def heard(candidates: Candidates, *datagrams: tuple[str, bytes]) -> list[bool]:
    return [candidates.admits(address, data) for address, data in datagrams]


def test_the_third_heartbeat_in_a_row_is_enough() -> None:
    assert heard(Candidates(None), *[("a", beat())] * 3) == [False, False, True]
    assert Candidates(None).admits("a", beat() * 3)


@pytest.mark.parametrize(
    "other", [beat(system=2), beat(autopilot=ARDUPILOT), beat(version=1)], ids=["system", "make", "version"]
)
def test_three_that_differ_are_none(other: bytes) -> None:
    assert not any(heard(Candidates(None), ("a", beat()), ("a", other), ("a", beat()), ("a", other)))


def test_who_changes_begins_anew() -> None:
    found = heard(Candidates(None), ("a", beat()), ("a", beat()), ("a", beat(version=1)), *[("a", beat())] * 3)
    assert found == [False] * 5 + [True]


def test_from_three_addresses_is_from_none() -> None:
    assert not any(heard(Candidates(None), *[(address, beat()) for address in "abcab"]))


@pytest.mark.parametrize("data", [beat(component=190), beat(autopilot=NONE), beat(system=0), b"", b"\xfd\xfe" * 50])
def test_no_vehicle_is_none_however_often_it_speaks(data: bytes) -> None:
    assert not any(heard(Candidates(None), *[("a", data)] * 10))


def test_only_the_wanted_system_counts() -> None:
    pinned = Candidates(7)
    assert not any(heard(pinned, *[("a", beat())] * 5))
    assert heard(pinned, *[("b", beat(7))] * 3) == [False, False, True]


def test_no_number_of_strangers_fills_the_memory() -> None:
    candidates = Candidates(None)
    assert not any(heard(candidates, *[(f"{number}", beat()) for number in range(1000)]))
    assert len(candidates._heard) <= 32
