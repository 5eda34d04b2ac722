"""What was said in a flight and what changed, in order of time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from companion.mission.plan import Phase
from companion.supervision.states import State
from companion.view.accumulators.texts import WARNING, shortened
from companion.view.gather import GatheredFlight
from companion.view.lines import Stretch

_MOST_EVENTS = 600


@dataclass(frozen=True, slots=True)
class Event:
    """Something that was said or that changed."""

    time: float
    """s"""
    level: int
    """As in `logging`, by tens."""
    source: str
    text: str


def phase_name(number: int) -> str:
    """The name of a phase by its number in the trace."""
    known = {phase.value: phase.name.lower() for phase in Phase}
    return known.get(number, f"phase {number}")


def state_name(number: int) -> str:
    """The name of a state of the supervisor by its number in the trace."""
    known = {state.value: state.name.lower() for state in State}
    return known.get(number, f"state {number}")


def events(flight: GatheredFlight) -> list[Event]:
    """What was said and what changed, in order of time. Of more than 600 the warnings are kept, and of the others (or
    of too many warnings) the first and the last; then the last one says how many are left out."""
    senders = flight.senders
    said = flight.texts.companion or flight.texts.vehicle
    story = [Event(text.time, text.level, text.source, text.text) for text in said]
    story += _changes(flight.phases.finish(), "phase", phase_name)
    for sender, stretches in senders.modes.items():
        source = f"mode of {senders.name(sender)}"
        story += _changes(stretches.finish(), source, partial(senders.mode, sender))
    for sender, stretches in senders.armed.items():
        story += _changes(stretches.finish(), senders.name(sender), lambda armed: "armed" if armed else "disarmed")
    story.sort(key=lambda event: event.time)
    told = shortened(story, _MOST_EVENTS)
    left_out = said.left_out + len(story) - len(told)
    return [*told, Event(told[-1].time, WARNING, "report", f"{left_out} more are left out")] if left_out else told


def _changes(stretches: list[Stretch], source: str, name: Callable[[int], str]) -> list[Event]:
    """The first value and each change, as events that a source of that name tells."""
    changes = [(after.start, after.value) for before, after in pairwise(stretches) if before.value != after.value]
    first = [(stretches[0].start, stretches[0].value)] if stretches else []
    return [Event(at, 2, source, name(value)) for at, value in (*first, *changes)]
