"""What goes into the autopilot and comes out of it; and the events as records of the log, both ways."""

from dataclasses import dataclass
from typing import NamedTuple

import msgspec

from companion.avoidance.planner import PlanRequest, PlanResult
from companion.records import LEGACY_REQUEST, OPERATION, TICK, OperationKind
from companion.state import Announcement
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
from protocol.flightlog import RecordType


class Datagram(msgspec.Struct, frozen=True, gc=False):
    """Bytes arrived. `whole`: they are one datagram of a transport that keeps datagrams apart. `sensor`: by the link of
    a sensor, not by the vehicle's."""

    time_ns: int
    data: bytes
    whole: bool = True
    sensor: bool = False


class Tick(msgspec.Struct, frozen=True, gc=False):
    """The loop's own beat, `late_ns` after it was due."""

    time_ns: int
    late_ns: int = 0


@dataclass(frozen=True, slots=True)
class PlanReady:
    """A request to the planner is answered."""

    time_ns: int
    result: PlanResult


Event = Datagram | Tick | PlanReady | Operation


class Reaction(NamedTuple):
    """What an event led to."""

    datagram: bytes
    """To send; empty if there is nothing to say."""
    trace: bytes | None
    """The payload of a TRACE record if a control step was taken."""
    announcements: tuple[Announcement, ...]
    plan_request: PlanRequest | None
    """What is to be answered outside of the loop."""


NOTHING = Reaction(b"", None, (), None)

_KINDS: dict[type[Operation], OperationKind] = {
    LandRequest: OperationKind.LAND_REQUEST,
    LogFault: OperationKind.LOG_FAULT,
    LogRecovered: OperationKind.LOG_RECOVERED,
    PlannerFault: OperationKind.PLANNER_FAULT,
    OrderRequest: OperationKind.ORDER,
    PlannerStarting: OperationKind.PLANNER_STARTING,
    PlannerReady: OperationKind.PLANNER_READY,
}
_LEGACY_LOG_FAULT, _LEGACY_PLANNER_FAULT, _LEGACY_RECOVERED = "log fault: ", "planner fault: ", "log recovered"
"""How logs of version 0.1 begin the text of a LEGACY_REQUEST."""


def operation_record(event: Operation) -> bytes:
    """The payload of an OPERATION record."""
    text = event.text if isinstance(event, LogFault | PlannerFault | OrderRequest) else ""
    return OPERATION.pack(_KINDS[type(event)], text)


def operation_of(kind: RecordType, time_ns: int, record: bytes) -> Operation:
    """The event of an OPERATION record, or of a LEGACY_REQUEST of an older log. Raises ValueError for an unknown
    kind."""
    if kind.topic == LEGACY_REQUEST.topic:
        return _legacy_operation(time_ns, LEGACY_REQUEST.unpack(record)["what"])
    fields = OPERATION.unpack(record)
    match OperationKind(fields["kind"]):
        case OperationKind.LAND_REQUEST:
            return LandRequest(time_ns)
        case OperationKind.LOG_FAULT:
            return LogFault(time_ns, fields["text"])
        case OperationKind.LOG_RECOVERED:
            return LogRecovered(time_ns)
        case OperationKind.PLANNER_FAULT:
            return PlannerFault(time_ns, fields["text"])
        case OperationKind.ORDER:
            return OrderRequest(time_ns, fields["text"])
        case OperationKind.PLANNER_STARTING:
            return PlannerStarting(time_ns)
        case OperationKind.PLANNER_READY:
            return PlannerReady(time_ns)


def _legacy_operation(time_ns: int, what: str) -> Operation:
    if what.startswith(_LEGACY_LOG_FAULT):
        return LogFault(time_ns, what.removeprefix(_LEGACY_LOG_FAULT))
    if what.startswith(_LEGACY_PLANNER_FAULT):
        return PlannerFault(time_ns, what.removeprefix(_LEGACY_PLANNER_FAULT))
    return LogRecovered(time_ns) if what == _LEGACY_RECOVERED else LandRequest(time_ns)


def tick_record(event: Tick) -> bytes:
    """The payload of a TICK record."""
    return TICK.pack(event.late_ns)


def tick_of(time_ns: int, record: bytes) -> Tick:
    """The event of a TICK record, quicker than by its `unpack`."""
    return Tick(time_ns, int.from_bytes(record, "little", signed=True))
