"""One order of events, whoever drives: the plans that are due, the tick, and what the autopilot asks of the planner."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from companion.autopilot import Autopilot
from companion.avoidance.path import NO_PATH
from companion.avoidance.planner import PlanRequest, PlanResult
from companion.events import NOTHING, Datagram, Event, PlanReady, Reaction, Tick
from companion.logs import replay as replaying
from companion.perception.free_space import FreeSpace
from companion.runtime.driver import Driver
from companion.runtime.planning import Planning
from companion.state import Scan
from companion.supervision.operations import LandRequest
from studies.joined import Joined
from tests.companion.runtime.hop import LOG, OVERRIDES, fly, hop_in

MS = 1_000_000
HERE = np.zeros(3)


def request(number: int, asked_ns: int) -> PlanRequest:
    pose = HERE, np.array([1.0, 0.0, 0.0, 0.0])
    return PlanRequest(number, asked_ns, cast(Scan, None), pose, 0.0, HERE, HERE, None, 4.0)


def answer(asked: PlanRequest) -> PlanResult:
    return PlanResult(asked.number, asked.asked_ns, cast(FreeSpace, None), 1.0, NO_PATH, False)


@dataclass
class Observed:
    """A driver whose autopilot reacts as it is told, and whose planner answers at once; everything in its order."""

    delay_s: float = 0.02
    seen: list[tuple[str, Any]] = field(default_factory=list)
    reactions: deque[Reaction] = field(default_factory=deque)
    """To the next events; nothing from there on."""
    ready: bool = True
    fault: str | None = None
    open: deque[PlanRequest] = field(default_factory=deque)

    def __post_init__(self) -> None:
        planning = Planning(self, self.delay_s)
        self.driver = Driver(cast(Autopilot, self), planning, self._before, self._after)

    def _before(self, event: Event) -> None:
        self.seen.append(("before", event))

    def _after(self, event: Event, reaction: Reaction) -> None:
        self.seen.append(("after", (event, reaction)))

    def handle(self, event: Event) -> Reaction:
        self.seen.append(("handle", event))
        return self.reactions.popleft() if self.reactions else NOTHING

    def ask(self, question: PlanRequest) -> None:
        self.seen.append(("ask", question))
        self.open.append(question)

    def take(self, patience_s: float) -> PlanResult | None:
        return answer(self.open.popleft()) if self.open else None

    def close(self) -> None: ...

    def events(self) -> list[tuple[str, int, int]]:
        """Type, time and, of a plan, number of what the autopilot was given."""
        return [
            (type(each).__name__, each.time_ns, each.result.number if isinstance(each, PlanReady) else 0)
            for what, each in self.seen
            if what == "handle"
        ]


def asking(number: int, asked_ns: int) -> Reaction:
    return Reaction(b"%d" % number, None, (), request(number, asked_ns))


def test_plans_that_are_due_come_before_the_tick_each_as_its_own_event() -> None:
    observed = Observed()
    for number, now in ((1, 0), (2, 5 * MS), (3, 9 * MS)):
        observed.reactions.append(asking(number, now))
        observed.driver.tick(now)
    observed.driver.tick(20 * MS - 1)
    observed.driver.tick(28 * MS)
    observed.driver.tick(29 * MS)
    assert observed.events() == [
        ("Tick", 0, 0),
        ("Tick", 5 * MS, 0),
        ("Tick", 9 * MS, 0),
        ("Tick", 20 * MS - 1, 0),
        ("PlanReady", 28 * MS, 1),
        ("PlanReady", 28 * MS, 2),
        ("Tick", 28 * MS, 0),
        ("PlanReady", 29 * MS, 3),
        ("Tick", 29 * MS, 0),
    ]


def test_what_is_asked_at_a_tick_is_answered_at_a_later_one() -> None:
    """Even if its plan is there at once; what is asked at a plan that is taken up comes in the same tick's turn."""
    observed = Observed(delay_s=0.0)
    observed.reactions.extend((asking(1, 0), asking(2, 4 * MS)))
    observed.driver.tick(0)
    observed.driver.tick(4 * MS)
    assert observed.events() == [
        ("Tick", 0, 0),
        ("PlanReady", 4 * MS, 1),
        ("PlanReady", 4 * MS, 2),
        ("Tick", 4 * MS, 0),
    ]


def test_observers_see_each_event_before_and_its_reaction_after_with_the_request_made_in_between() -> None:
    observed = Observed()
    reactions = [Reaction(b"a", b"trace", (), None), asking(1, 7), NOTHING, Reaction(b"b", None, (), None)]
    observed.reactions.extend(reactions)
    datagram, land, tick = Datagram(5, b"data"), LandRequest(6), Tick(7, 3)
    assert observed.driver.handle(datagram) == b"a"
    assert observed.driver.tick(7, 3) == b"1"
    assert observed.driver.handle(land) == b""
    assert observed.seen == [
        ("before", datagram),
        ("handle", datagram),
        ("after", (datagram, reactions[0])),
        ("before", tick),
        ("handle", tick),
        ("ask", request_of(reactions[1])),
        ("after", (tick, reactions[1])),
        ("before", land),
        ("handle", land),
        ("after", (land, NOTHING)),
    ]


def request_of(reaction: Reaction) -> PlanRequest:
    assert reaction.plan_request is not None
    return reaction.plan_request


def test_what_plans_and_tick_lead_to_is_sent_in_their_order() -> None:
    observed = Observed(delay_s=0.0)
    observed.reactions.append(asking(1, 0))
    observed.driver.tick(0)
    observed.reactions.extend((Reaction(b"plan ", None, (), None), Reaction(b"tick", None, (), None)))
    assert observed.driver.tick(4 * MS) == b"plan tick"


def test_a_driver_needs_no_observer() -> None:
    observed = Observed()
    driver = Driver(cast(Autopilot, observed), Planning(observed, 0.0))
    observed.reactions.append(asking(1, 0))
    assert driver.handle(Datagram(0, b"")) == b"1" and driver.tick(0) == b""
    assert observed.events() == [("Datagram", 0, 0), ("PlanReady", 0, 1), ("Tick", 0, 0)]


# -- three drivers -----------------------------------------------------------------------------------------------------


class Recording(Autopilot):
    """The real one, with a list of its events."""

    made: "list[Recording]" = []  # noqa: RUF012

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.events: list[Event] = []
        self.made.append(self)

    def handle(self, event: Event) -> Reaction:
        self.events.append(event)
        return super().handle(event)


def compared(events: list[Event]) -> Iterator[tuple[type, int, object]]:
    """Type, time and contents; of a plan its number and what it answers."""
    for event in events:
        if isinstance(event, PlanReady):
            yield type(event), event.time_ns, (event.result.number, event.result.asked_ns)
        else:
            yield type(event), event.time_ns, event


def test_three_drivers_hand_the_same_events_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The runner in lockstep, the replay of its log, and the studies' flight in one thread."""
    flown = fly(tmp_path, Recording)
    assert isinstance(flown, Recording) and flown.ended and flown.supervisor.fault is None
    assert {type(event) for event in flown.events} == {Datagram, Tick, PlanReady}
    monkeypatch.setattr(replaying, "Autopilot", Recording)
    result = replaying.replay(tmp_path / LOG)
    assert result.differences == [] and result.notes == []
    again = Recording.made[-1]
    assert again is not flown
    joined = Joined(hop_in(tmp_path), overrides=OVERRIDES).fly()
    assert joined.autopilot.ended
    expected = list(compared(flown.events))
    assert list(compared(again.events)) == expected
    assert list(compared(joined.events)) == expected
