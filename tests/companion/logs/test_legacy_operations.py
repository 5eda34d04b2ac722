"""Logs of version 0.1, whose faults and requests are texts, replay as the events that they were."""

from collections.abc import Callable
from pathlib import Path

import pytest

from companion.avoidance.planner import PlanRequest, PlanResult
from companion.config_avoidance import Avoidance
from companion.events import operation_of
from companion.logs.replay import replay
from companion.logs.writer import Writer
from companion.records import LEGACY_REQUEST, OPERATION, TRACE
from companion.runtime.planning import InProcessPlanner
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
from companion.supervision.states import State
from protocol.flightlog import LogReader, Record
from tests.companion.runtime.hop import LOG, fly

INTERRUPT_NS = 4_000_000_000
"""The vehicle holds then, for want of a map."""


class FailingPlanner(InProcessPlanner):
    """It fails after some answers, as a process does that has ended: in flight, when asked for the 35th."""

    def __init__(self, settings: Avoidance) -> None:
        super().__init__(settings)
        self._left = 35

    def ask(self, question: PlanRequest) -> None:
        self._left -= 1
        if self._left < 0:
            self.fault = "the planner's process has ended by itself"
        else:
            super().ask(question)

    def take(self, patience_s: float) -> PlanResult | None:
        return super().take(patience_s) if self.fault is None else None


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a flight in which the planner fails, and that is called off then."""
    folder = tmp_path_factory.mktemp("hop")
    fly(folder, planner=FailingPlanner, interrupt_ns=INTERRUPT_NS)
    return folder / LOG


def text_of(event: Operation) -> str:
    """As version 0.1 wrote it."""
    match event:
        case LandRequest():
            return "land"
        case LogFault():
            return f"log fault: {event.text}"
        case LogRecovered():
            return "log recovered"
        case PlannerFault():
            return f"planner fault: {event.text}"
        case OrderRequest() | PlannerStarting() | PlannerReady():
            raise ValueError("version 0.1 has none")


def legacy(source: Path, target: Path, text: Callable[[Operation], str] = text_of) -> Path:
    """The same log with the records of version 0.1 for its operations."""
    log = LogReader(source)
    metadata = {name: table for name, table in log.metadata.items() if name != "flightlog"}
    with Writer(target, log.epoch_ns, metadata) as writer:
        for name, content in log.attachments.items():
            writer.attach(name, content)
        for record in log.records():
            kind, data = log.topics[record.topic], record.data
            if record.topic == OPERATION.topic:
                kind, data = LEGACY_REQUEST, LEGACY_REQUEST.pack(text(operation_of(OPERATION, record.time_ns, data)))
            writer.record(kind, record.time_ns, record.sequence, data)
    return target


def operations(path: Path) -> list[Record]:
    return list(LogReader(path).records((OPERATION.topic, LEGACY_REQUEST.topic)))


def test_the_flight_has_a_planner_fault_and_a_request_to_land(flown: Path) -> None:
    fault, land = (operation_of(OPERATION, each.time_ns, each.data) for each in operations(flown))
    assert fault == PlannerFault(fault.time_ns, "the planner's process has ended by itself")
    assert land == LandRequest(INTERRUPT_NS) and fault.time_ns < land.time_ns
    states = LogReader(flown).array(TRACE.topic)["state"].tolist()
    assert [State(each) for each in dict.fromkeys(states)][-3:] == [State.FLY, State.HOLD, State.LAND], (
        "no map any more"
    )
    assert replay(flown).differences == []


def test_a_legacy_log_replays_equal(flown: Path, tmp_path: Path) -> None:
    path = legacy(flown, tmp_path / "legacy.mcap")
    assert {each.topic for each in operations(path)} == {LEGACY_REQUEST.topic}
    assert OPERATION.topic not in LogReader(path).topics
    now, then = replay(path), replay(flown)
    assert now.differences == [] and now.notes == []
    assert (now.datagrams, now.bytes, now.traces) == (then.datagrams, then.bytes, then.traces)
    assert now.datagrams > 500


@pytest.mark.parametrize("kind", [PlannerFault, LandRequest])
def test_each_of_its_records_counts(flown: Path, tmp_path: Path, kind: type[Operation]) -> None:
    """With another text in the place of one of them, the replay says so."""

    def text(event: Operation) -> str:
        return "log recovered" if isinstance(event, kind) else text_of(event)

    assert replay(legacy(flown, tmp_path / "changed.mcap", text)).differences != []


def test_a_copy_of_a_legacy_log_is_one(flown: Path, tmp_path: Path) -> None:
    """Replayed with its whole trace, it keeps its records."""
    path, copy = legacy(flown, tmp_path / "legacy.mcap"), tmp_path / "copy.mcap"
    replay(path, trace=copy)
    assert [(each.time_ns, each.data) for each in operations(copy)] == [
        (each.time_ns, each.data) for each in operations(path)
    ]
    assert replay(copy).differences == []
