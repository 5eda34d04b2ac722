"""Commands are sent until what they ask for is seen; telemetry rates are measured, not believed."""

from companion.link.commands import Commander
from companion.link.message_rates import MessageRates
from protocol.messages import dialect

MS = 1_000_000
TARGET = (1, 1)
ARM = dialect.MAV_CMD_COMPONENT_ARM_DISARM


def ack(command: int, result: int) -> dialect.MAVLink_command_ack_message:
    return dialect.MAVLink_command_ack_message(command, result)


def confirmations(commander: Commander, command: int, until_ms: int, start_ms: int = 0) -> list[tuple[int, int]]:
    """(ms, confirmation) of what is sent when asked each 20 ms."""
    sent = []
    for ms in range(start_ms, until_ms, 20):
        message = commander.ask(command, (1.0,), ms * MS, TARGET)
        if message is not None:
            sent.append((ms, message[1][3]))
    return sent


def test_resends_with_rising_confirmation() -> None:
    commander = Commander(0.5)
    assert confirmations(commander, ARM, 2001) == [(0, 0), (500, 1), (1000, 2), (1500, 3), (2000, 4)]
    assert commander.tries(ARM) == 5
    assert commander.answer(ARM) == "no answer"


def test_in_progress_lengthens_the_wait() -> None:
    commander = Commander(0.5)
    commander.ask(ARM, (1.0,), 0, TARGET)
    commander.answered(ack(ARM, dialect.MAV_RESULT_IN_PROGRESS))
    assert confirmations(commander, ARM, 2001, 20) == [(2000, 1)]
    assert not commander.accepted(ARM)


def test_answers_belong_to_what_is_asked_now() -> None:
    commander = Commander(0.5)
    commander.answered(ack(ARM, dialect.MAV_RESULT_ACCEPTED))
    assert not commander.accepted(ARM)
    commander.ask(ARM, (1.0,), 0, TARGET)
    commander.answered(ack(dialect.MAV_CMD_NAV_LAND, dialect.MAV_RESULT_ACCEPTED))
    assert not commander.accepted(ARM)
    commander.answered(ack(ARM, dialect.MAV_RESULT_TEMPORARILY_REJECTED))
    assert commander.answer(ARM) == "temporarily rejected"
    commander.answered(ack(ARM, dialect.MAV_RESULT_ACCEPTED))
    assert commander.accepted(ARM)
    message = commander.ask(ARM, (0.0,), 10 * MS, TARGET)  # something else: sent at once, from the start
    assert message is not None and message[1][3] == 0
    assert not commander.accepted(ARM)
    commander.answered(ack(ARM, 99))
    assert commander.answer(ARM) == "result 99"


def test_exhausted_only_when_the_last_try_has_had_its_time() -> None:
    commander = Commander(0.5)
    confirmations(commander, ARM, 1001)
    assert commander.tries(ARM) == 3
    assert not commander.exhausted(ARM, 3, 1400 * MS) and commander.exhausted(ARM, 3, 1500 * MS)
    assert not commander.exhausted(ARM, 4, 1500 * MS)


def test_rates_over_the_last_second() -> None:
    rates = MessageRates({31: 50.0, 330: 10.0}, 0.5)
    assert rates.lacking(0) == [31, 330]
    for index in range(100):
        rates.count(31, index * 20 * MS)
        rates.count(999, index * 20 * MS)
    now = 1990 * MS
    assert "begun to arrive" in rates.describe(31, 400 * MS) and "begun" not in rates.describe(31, 950 * MS)
    assert rates.rate(31, now) == 50.0
    assert rates.lacking(now) == [330]
    assert "sensor" in rates.describe(330, now) and "0 of 10" in rates.describe(330, now)
    assert rates.lacking(now + 600 * MS) == [31, 330]
    assert "ATTITUDE_QUATERNION" in rates.describe(31, now + 900 * MS)
    assert rates.to_ask([31, 330]) == [(31, 20_000.0), (330, 100_000.0)]
    assert rates.to_ask([132], 10.0) == [(132, 100_000.0)]


DENIED, ACCEPTED = dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_ACCEPTED


def answers(rates: MessageRates, asked: list[int], results: list[int]) -> list[int]:
    """One round of requests with their answers; what would be asked in the next one."""
    rates.to_ask(asked)
    for result in results:
        rates.answered(result)
    rates.settle()
    return [message_id for message_id, _ in rates.to_ask(asked)]


def test_what_is_denied_is_not_asked_for_again() -> None:
    rates = MessageRates({31: 50.0, 330: 10.0, 245: 5.0}, 0.5)
    assert answers(rates, [31, 330, 245], [ACCEPTED, DENIED, ACCEPTED]) == [31, 245]
    assert "denies" in rates.describe(330, 0)
    rates.settle()
    assert answers(rates, [31, 245], [dialect.MAV_RESULT_TEMPORARILY_REJECTED, dialect.MAV_RESULT_UNSUPPORTED]) == [31]


def test_answers_that_can_not_be_told_apart_deny_nothing() -> None:
    rates = MessageRates({31: 50.0, 330: 10.0}, 0.5)
    assert answers(rates, [31, 330], [DENIED]) == [31, 330], "one was lost"
    rates.answered(ACCEPTED)
    for _ in range(9):
        rates.answered(DENIED)
    rates.settle()
    assert [each for each, _ in rates.to_ask([31, 330])] == [31], "and more than were asked for are somebody else's"
