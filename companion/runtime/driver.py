"""The one order of a flight's events: at a tick, the plans that are due and then the tick; what the autopilot asks the
planner at an event is asked right after it."""

from collections.abc import Callable
from typing import Protocol

from companion.autopilot import Autopilot
from companion.avoidance.planner import PlanRequest, PlanResult
from companion.events import Event, PlanReady, Reaction, Tick


class Plans(Protocol):
    """Requests out, results in when they count."""

    def ask(self, request: PlanRequest) -> None:
        """Returns at once."""

    def due(self, now_ns: int) -> PlanResult | None:
        """The next result that counts by now; to be called until there is none."""


def nobody(*_: object) -> None:
    """Looks on where nobody else does."""


class Driver:
    """Feeds an autopilot with events. `before` sees each event, `after` what it led to."""

    def __init__(
        self,
        autopilot: Autopilot,
        plans: Plans,
        before: Callable[[Event], None] = nobody,
        after: Callable[[Event, Reaction], None] = nobody,
    ) -> None:
        self.autopilot = autopilot
        self._plans = plans
        self._before = before
        self._after = after

    def handle(self, event: Event) -> bytes:
        """Feed one event in; what is to be sent."""
        self._before(event)
        reaction = self.autopilot.handle(event)
        if reaction.plan_request is not None:
            self._plans.ask(reaction.plan_request)
        self._after(event, reaction)
        return reaction.datagram

    def tick(self, now_ns: int, late_ns: int = 0) -> bytes:
        """The plans that are due, and a beat of the loop, `late_ns` after it was due; what is to be sent."""
        sent = b""
        while (result := self._plans.due(now_ns)) is not None:
            sent += self.handle(PlanReady(now_ns, result))
        return sent + self.handle(Tick(now_ns, late_ns))
