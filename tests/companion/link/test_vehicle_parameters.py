"""Parameters: what a PARAM_VALUE means, and that each is asked for until it is known, or known as missing."""

import math
import struct
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.link.parameters import ParameterReader, value_of
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from tests.companion.link.test_real_telemetry import frames

MS = 1_000_000
PERIOD_MS, INTERVAL_S, TRIES = 20, 0.5, 6
REAL32, INT32, UINT8 = dialect.MAV_PARAM_TYPE_REAL32, dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_UINT8


def over_the_wire(message: dialect.MAVLink_message) -> dialect.MAVLink_message:
    (frame,) = Framer().datagram(Encoder(1, 1).encode(message))
    return decode(frame)


def told(name: str, value: float, kind: int = REAL32) -> dialect.MAVLink_message:
    """PARAM_VALUE; `value` as it stands in the message."""
    return over_the_wire(dialect.MAVLink_param_value_message(name.encode(), value, kind, 1, 0))


def unknown(name: str) -> dialect.MAVLink_message:
    """PARAM_ERROR."""
    error = dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST
    return over_the_wire(dialect.MAVLink_param_error_message(1, 191, name.encode(), -1, error))


def as_float(integer: int, code: str = "<i") -> float:
    """The float that has an integer's bytes."""
    value: float = struct.unpack("<f", struct.pack(code, integer).ljust(4, b"\0"))[0]
    return value


def reader(*questions: tuple[str, ...], bytewise: bool = False) -> ParameterReader:
    return ParameterReader(questions, bytewise=bytewise, interval_s=INTERVAL_S, tries=TRIES)


def converse(
    asking: ParameterReader, answer: Callable[[str, int], dialect.MAVLink_message | None], seconds: float = 60.0
) -> list[tuple[int, str]]:
    """(ms, name) of each request until the reader is done. `answer`: to the n-th request for a name."""
    asked: list[tuple[int, str]] = []
    for ms in range(0, round(seconds * 1e3), PERIOD_MS):
        for name in asking.due(ms * MS):
            asked.append((ms, name))
            message = answer(name, sum(each == name for _, each in asked))
            if message is None:
                continue
            take = asking.take if message.get_type() == "PARAM_VALUE" else asking.refuse
            take(message)
        if asking.done:
            return asked
    raise AssertionError(f"not done after {seconds} s")


# -- values ------------------------------------------------------------------------------------------------------------


@given(integer=st.integers(-(2**22), 2**31 - 1))
@settings(max_examples=200)
def test_an_integer_of_px4_stands_bytewise_in_the_float(integer: int) -> None:
    if 0x7F800001 <= integer < 0x7FC00000:
        return  # the bytes of a signalling NaN, which a float does not keep
    assert value_of(told("A", as_float(integer), INT32), bytewise=True) == integer


@given(integer=st.integers(-(2**24), 2**24))
@settings(max_examples=100)
def test_an_integer_of_ardupilot_is_cast_to_the_float(integer: int) -> None:
    assert value_of(told("A", float(integer), INT32), bytewise=False) == integer


def test_small_integers_take_their_own_bytes_only() -> None:
    assert value_of(told("A", as_float(200, "<B"), UINT8), bytewise=True) == 200
    assert value_of(told("A", as_float(-3, "<b"), dialect.MAV_PARAM_TYPE_INT8), bytewise=True) == -3
    assert value_of(told("A", as_float(-300, "<h"), dialect.MAV_PARAM_TYPE_INT16), bytewise=True) == -300


@pytest.mark.parametrize("bytewise", [True, False])
def test_what_is_not_finite_or_does_not_fit_is_no_value(bytewise: bool) -> None:
    for value in (math.nan, math.inf, -math.inf):
        assert value_of(told("A", value), bytewise=bytewise) is None
    for kind in (dialect.MAV_PARAM_TYPE_INT64, dialect.MAV_PARAM_TYPE_UINT64, dialect.MAV_PARAM_TYPE_REAL64, 0, 99):
        assert value_of(told("A", 1.0, kind), bytewise=bytewise) is None
    assert value_of(told("A", 0.25), bytewise=bytewise) == 0.25


@pytest.mark.parametrize(
    ("recording", "bytewise", "expected"),
    [
        (
            "px4_offboard.tlog",
            True,
            {"CAL_ACC0_ID": 1310988, "CAL_BARO0_PRIO": 50, "SYS_AUTOSTART": 10040, "SENS_DPRES_OFF": 0.001},
        ),
        ("ardupilot_guided.tlog", False, {"GUID_OPTIONS": 8, "MOT_THST_HOVER": 0.39, "MIS_TOTAL": 1}),
    ],
)
def test_real_vehicles_answers_are_read(recording: str, bytewise: bool, expected: dict[str, float]) -> None:
    asking = reader(*((name,) for name in expected), ("NOBODY_HAS_IT",), bytewise=bytewise)
    for _, raw in frames(recording):
        for frame in Framer().datagram(raw):
            if (frame.message_id, frame.component) == (dialect.MAVLINK_MSG_ID_PARAM_VALUE, 1):
                asking.take(decode(frame))
    assert asking.values == pytest.approx(expected)
    assert not asking.done


# -- the conversation --------------------------------------------------------------------------------------------------

NAMES = [f"P{number}" for number in range(13)]
QUESTIONS = [(name,) for name in NAMES]


def test_each_is_asked_once_where_all_are_answered() -> None:
    asking = reader(*QUESTIONS)
    asked = converse(asking, lambda name, _: told(name, 2.0))
    assert sorted(name for _, name in asked) == sorted(NAMES)
    assert asking.values == dict.fromkeys(NAMES, 2.0)
    assert asking.due(10**12) == []


@pytest.mark.parametrize("nth", [1, 2, 3, 4, 7])
def test_a_lost_answer_is_asked_for_again(nth: int) -> None:
    """Every n-th answer is lost; the first `TRIES - 1` of each, if all are."""
    asking, count = reader(*QUESTIONS), 0

    def answer(name: str, time: int) -> dialect.MAVLink_message | None:
        nonlocal count
        count += 1
        lost = time < TRIES if nth == 1 else count % nth == 0
        return None if lost else told(name, 1.0)

    converse(asking, answer)
    assert set(asking.values) == set(NAMES)


def test_what_is_never_answered_is_missing_after_the_tries() -> None:
    asking = reader(("SILENT",), ("THERE",))
    asked = converse(asking, lambda name, _: told(name, 1.0) if name == "THERE" else None)
    assert [ms for ms, name in asked if name == "SILENT"] == [500 * k for k in range(TRIES)]
    assert asking.values == {"THERE": 1.0}


def test_what_the_vehicle_does_not_have_is_not_asked_for_again() -> None:
    asking = reader(("NO",), ("YES",))
    asked = converse(asking, lambda name, _: told(name, 1.0) if name == "YES" else unknown(name))
    assert sorted(asked) == [(0, "NO"), (0, "YES")] and asking.values == {"YES": 1.0}


@pytest.mark.parametrize("refuses", [True, False])
def test_one_of_a_parameter_s_names_is_enough(refuses: bool) -> None:
    """The other one is neither waited for nor asked for again."""
    asking = reader(("NEW", "OLD"))
    asked = converse(asking, lambda name, _: told(name, 3.0) if name == "OLD" else unknown(name) if refuses else None)
    assert sorted(asked) == [(0, "NEW"), (0, "OLD")] and asking.values == {"OLD": 3.0}


def test_a_name_that_is_missing_does_not_settle_what_has_another_one() -> None:
    asking = reader(("NEW", "OLD"))
    asking.due(0)
    asking.refuse(unknown("NEW"))
    assert not asking.done
    asking.refuse(unknown("OLD"))
    assert asking.done and asking.values == {}


def test_no_more_than_a_few_are_asked_for_at_once() -> None:
    asking = reader(*QUESTIONS)
    assert asking.due(0) == NAMES[:5]
    assert asking.due(20 * MS) == []
    asking.take(told(NAMES[1], 0.0))
    assert asking.due(40 * MS) == [NAMES[5]]


def test_what_was_not_asked_about_is_ignored() -> None:
    asking = reader(("A",))
    asking.take(told("B", 1.0))
    asking.refuse(unknown("C"))
    asking.take(told("A", math.nan))
    assert asking.values == {} and not asking.done
    asking.take(told("A", 1.0))
    asking.take(told("A", 2.0))
    assert asking.values == {"A": 1.0}, "it is settled"


@given(lost=st.lists(st.booleans(), max_size=80), refused=st.sets(st.sampled_from(NAMES)))
@settings(max_examples=50)
def test_whatever_is_lost_it_comes_to_an_end(lost: list[bool], refused: set[str]) -> None:
    """A value is known exactly where an answer with one came."""
    asking, losses, came = reader(*QUESTIONS), iter(lost), set()

    def answer(name: str, _: int) -> dialect.MAVLink_message | None:
        if next(losses, False):
            return None
        if name in refused:
            return unknown(name)
        came.add(name)
        return told(name, 1.0)

    asked = converse(asking, answer)
    assert set(asking.values) == came and came.isdisjoint(refused)
    assert all(sum(each == name for _, each in asked) <= TRIES for name in NAMES)
