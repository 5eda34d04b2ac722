"""Events become records of the log and come back from them, from those of version 0.1, too."""

from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.events import Tick, operation_of, operation_record, tick_of, tick_record
from companion.records import LEGACY_REQUEST, OPERATION, TICK, OperationKind
from companion.supervision.operations import (
    LandRequest,
    LogFault,
    LogRecovered,
    Operation,
    OrderRequest,
    PlannerFault,
    PlannerReady,
    PlannerStarting,
)

TIMES = st.integers(0, 2**62)
TEXTS = st.text(max_size=40)
OPERATIONS: st.SearchStrategy[Operation] = st.one_of(
    st.builds(LandRequest, TIMES),
    st.builds(LogFault, TIMES, TEXTS),
    st.builds(LogRecovered, TIMES),
    st.builds(PlannerFault, TIMES, TEXTS),
    st.builds(OrderRequest, TIMES, TEXTS),
    st.builds(PlannerStarting, TIMES),
    st.builds(PlannerReady, TIMES),
)


@settings(max_examples=100)
@given(event=OPERATIONS)
def test_an_operation_comes_back_from_its_record(event: Operation) -> None:
    assert operation_of(OPERATION, event.time_ns, operation_record(event)) == event


def test_every_operation_has_a_kind_of_its_own() -> None:
    faults: list[Operation] = [LogFault(5, "x"), LogRecovered(5), PlannerFault(5, "x")]
    events = [LandRequest(5), *faults, OrderRequest(5, "x"), PlannerStarting(5), PlannerReady(5)]
    assert {type(event) for event in events} == set(get_args(Operation))
    kinds = [OPERATION.unpack(operation_record(event))["kind"] for event in events]
    assert sorted(kinds) == [kind.value for kind in OperationKind]


@pytest.mark.parametrize(
    ("what", "event"),
    [
        ("land", LandRequest(5)),
        ("log fault: disk full", LogFault(5, "disk full")),
        ("log fault: ", LogFault(5, "")),
        ("log fault: planner fault: both", LogFault(5, "planner fault: both")),
        ("log recovered", LogRecovered(5)),
        ("planner fault: it has ended", PlannerFault(5, "it has ended")),
        ("planner fault: log recovered", PlannerFault(5, "log recovered")),
    ],
)
def test_a_record_of_version_0_1_is_the_same_event(what: str, event: Operation) -> None:
    assert operation_of(LEGACY_REQUEST, 5, LEGACY_REQUEST.pack(what)) == event


@pytest.mark.parametrize("kind", [7, 255])
def test_a_kind_that_is_not_known_is_an_error(kind: int) -> None:
    with pytest.raises(ValueError, match=str(kind)):
        operation_of(OPERATION, 5, OPERATION.pack(kind, "text"))


@settings(max_examples=100)
@given(time_ns=TIMES, late_ns=st.integers(-(2**63), 2**63 - 1))
def test_a_tick_comes_back_from_its_record(time_ns: int, late_ns: int) -> None:
    record = tick_record(Tick(time_ns, late_ns))
    assert tick_of(time_ns, record) == Tick(time_ns, late_ns)
    assert TICK.unpack(record)["late_ns"] == late_ns, "as by the record's own definition"
