"""A topic is taken for what its name says only where its fields are."""

import pytest

from companion.known_topics import _MESSAGES, is_foreign
from companion.records import LEGACY_REQUEST, LOGGED, LOOP, OPERATION, PLANNED, TICK, TRACE
from protocol.flightlog import DATAGRAM, TEXT, RecordType, record_type
from protocol.flightlog.mavlink_records import message_type
from protocol.messages import dialect

OWN = (LOGGED, TRACE, LOOP, TEXT, DATAGRAM, TICK, PLANNED, OPERATION, LEGACY_REQUEST)
NUMBERS = {message.msgname: number for number, message in dialect.mavlink_map.items()}
GUARD = ("guard_reason", "guard_change")


def message(name: str, topic: str = "/mavlink/1/1/") -> RecordType:
    """A message of the dialect, as the recorder writes it."""
    return message_type(NUMBERS[name], f"{topic}{name}")[0]


def lines(kind: RecordType) -> list[str]:
    return [line for line in kind.definition.splitlines() if line.strip()]


def changed(kind: RecordType, definition: list[str]) -> RecordType:
    return RecordType(kind.topic, kind.schema_name, "\n".join(definition))


def name_of(line: str) -> str:
    return line.partition("#")[0].split()[1]


def needed(kind: RecordType) -> list[str]:
    """The lines of the fields without any one of which a type is another."""
    every = lines(kind)
    return [line for line in every if is_foreign(changed(kind, [each for each in every if each != line]))]


@pytest.mark.parametrize("kind", [*OWN, *map(message, _MESSAGES)], ids=lambda kind: f"{kind.topic} {kind.schema_name}")
def test_what_is_written_is_known_and_what_lacks_a_field_is_not(kind: RecordType) -> None:
    assert not is_foreign(kind)
    assert is_foreign(RecordType(kind.topic, kind.schema_name, "float32 x"))
    taken = needed(kind)
    assert taken
    for line in taken:
        other = [each if each != line else f"float64[7] {name_of(line)}" for each in lines(kind)]
        assert is_foreign(changed(kind, other))


@pytest.mark.parametrize("name", _MESSAGES)
def test_the_fields_that_are_taken_are_the_dialect_s(name: str) -> None:
    """All by which a message is known are of it, and of the types that it has there."""
    kind = message(name)
    words = _MESSAGES[name].replace("|", ";").split(";")
    told = {f"{part.split()[0]} {each}" for part in words for each in part.split()[1:]}
    assert told <= {line.partition("#")[0].strip() for line in lines(kind)}


@pytest.mark.parametrize("trace", [LOGGED, TRACE])
def test_a_trace_of_before_the_guard_is_known(trace: RecordType) -> None:
    """With a half of what the guard says it is another's."""
    before = [line for line in lines(trace) if name_of(line) not in GUARD]
    assert not is_foreign(changed(trace, before))
    assert is_foreign(changed(trace, [*before, "uint8 guard_reason"]))


def test_one_latency_a_record_is_an_older_loop() -> None:
    assert not is_foreign(record_type(LOOP.topic, "courier/Loop", [("latency_ns", "int64")]))
    assert is_foreign(record_type(LOOP.topic, "courier/Loop", [("latency_ns", "int64"), ("x", "string")]))


@pytest.mark.parametrize(
    "topic", ["/mavlink/uav/1/", "/mavlink/1/", "/mavlink/", "/mavlink/1/1/1/", "/mavlink/1/²/", "/mavlink/1/٣/"]
)
def test_a_message_has_the_numbers_of_who_sent_it(topic: str) -> None:
    assert is_foreign(message("HEARTBEAT", topic))


@pytest.mark.parametrize("topic", ["/fleet/HEARTBEAT", "/mavlink/1/1/ELSE", "/mavlink/a/b/ELSE", "/else", ""])
def test_another_name_may_have_any_fields(topic: str) -> None:
    assert not is_foreign(RecordType(topic, "x/X", "float32 x"))
