"""Texts of a vehicle that are too long for one message."""

import itertools

import pytest

from companion.state import Announcement, Severity
from protocol.messages import dialect
from tests.companion.link.sender import MS, NOW, SECOND, Sender, found, hear

DENIED = b"Arming denied: Resolve system health failures first\t"
"""As PX4 says it, with the tab of a text that it tells as an event, too."""
CRITICAL, EMERGENCY = dialect.MAV_SEVERITY_CRITICAL, dialect.MAV_SEVERITY_EMERGENCY


def pieces(vehicle: Sender, text: bytes, number: int = 1, severity: int = CRITICAL) -> list[bytes]:
    """A text as its messages; one that fills its last piece is ended by an empty one."""
    parts = [text[at : at + 50] for at in range(0, len(text) + 1, 50)]
    return [vehicle.text(severity, part, number, index) for index, part in enumerate(parts)]


def test_a_long_text_is_said_once_and_explains_what_follows_as_a_whole() -> None:
    link, vehicle = found()
    first, last = pieces(vehicle, DENIED)
    assert hear(link, first) == [] and link.beat(NOW, asks_rates=False) == []
    assert link.report(NOW, None, before_flight=False).complaint == f" ({DENIED[:50].decode()})"
    assert hear(link, last) == [Announcement(Severity.CRITICAL, f"vehicle: {DENIED.decode().rstrip()}")]
    assert link.report(NOW, None, before_flight=False).complaint == f" ({DENIED.decode().rstrip()})"
    assert hear(link, last) == [] and link.beat(NOW + 2 * SECOND, asks_rates=False) == [], "once more, nothing new"


@pytest.mark.parametrize("length", [50, 100, 120])
def test_a_text_is_as_long_as_its_pieces_together(length: int) -> None:
    link, vehicle = found()
    text = bytes(itertools.islice(itertools.cycle(b"high vibration "), length - 1)) + b"."
    said = [each for piece in pieces(vehicle, text) for each in hear(link, piece)]
    assert said == [Announcement(Severity.CRITICAL, f"vehicle: {text.decode()}")]


def test_texts_that_come_between_one_another_and_in_another_order_are_put_together() -> None:
    link, vehicle = found()
    one, other = pieces(vehicle, b"a" * 60, 1), pieces(vehicle, b"b" * 60, 2)
    said = [hear(link, each) for each in (one[1], other[0], vehicle.text(CRITICAL, b"short"), other[1], one[0])]
    texts = [[each.text for each in some if isinstance(each, Announcement)] for some in said]
    assert texts == [[], [], ["vehicle: short"], [f"vehicle: {'b' * 60}"], [f"vehicle: {'a' * 60}"]]


def test_a_text_that_does_not_come_to_its_end_is_said_as_far_as_it_came() -> None:
    link, vehicle = found()
    first, _, last = pieces(vehicle, b"a" * 50 + b"b" * 50 + b"c")
    assert hear(link, first + last) == []
    assert link.beat(NOW + 900 * MS, asks_rates=False) == []
    (said,) = link.beat(NOW + 1100 * MS, asks_rates=False)
    assert said == Announcement(Severity.CRITICAL, f"vehicle: {'a' * 50} ... c")
    assert link.beat(NOW + 3 * SECOND, asks_rates=False) == []


def test_a_number_that_comes_again_is_of_another_text() -> None:
    """After a reboot numbers begin anew."""
    link, vehicle = found()
    hear(link, pieces(vehicle, b"a" * 60)[0])
    said = [each for piece in pieces(vehicle, b"b" * 60) for each in hear(link, piece)]
    assert [each.text for each in said if isinstance(each, Announcement)] == [f"vehicle: {'b' * 60}"]
    assert [each.text for each in link.beat(NOW, asks_rates=False)] == [f"vehicle: {'a' * 50}"]


def test_an_emergency_counts_from_its_first_piece_on() -> None:
    link, vehicle = found()
    text = b"Crash: Disarming: the vehicle leans by 55 degrees more than it was asked to"
    for piece in pieces(vehicle, text, severity=EMERGENCY):
        hear(link, piece)
        assert link.report(NOW, None, before_flight=False).emergency.startswith("Crash: Disarming")
    assert link.report(NOW, None, before_flight=False).emergency == text.decode()


def test_pieces_of_many_texts_without_end_are_forgotten() -> None:
    link, vehicle = found()
    for number in range(1, 1000):
        hear(link, vehicle.text(CRITICAL, b"x" * 50, number, number % 256))
    assert len(link.beat(NOW + 2 * SECOND, asks_rates=False)) < 1000
    assert link.beat(NOW + 4 * SECOND, asks_rates=False) == []
