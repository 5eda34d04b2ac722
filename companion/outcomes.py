"""How a flight came out: one word of a table and the cause, judged once and written into the log.

The companion judges while it flies (each row of the table of transitions says what it makes of the flight), and `judge`
has the last word: it knows the mission too, and in a demo what the simulator saw.
"""

from collections.abc import Mapping
from enum import Enum

import msgspec


class Outcome(Enum):
    """How a flight came out, the best first: of several that apply, the last counts."""

    DELIVERED = "delivered"
    """To its end, and each parcel was released."""
    FLOWN = "flown"
    """To its end; the mission has no parcel."""
    NOT_DELIVERED = "not delivered"
    """Flown to its end, and a parcel was not released."""
    EMERGENCY = "emergency"
    """Flown to its end, but the vehicle reported a critical state or an emergency."""
    RETURNED = "returned"
    """Before the mission was done."""
    CALLED_OFF = "called off"
    """By Ctrl-C, or by the end of the program that gave the orders."""
    OPERATOR = "landed by the operator"
    """By a ground station or the live page."""
    NOT_STARTED = "not started"
    """Refused, or given up before the take-off."""
    NO_TAKE_OFF = "could not take off"
    """Armed, and it stayed on the ground."""
    LANDED_EARLY = "landed early"
    """Before the end of the mission, because something failed."""
    LEFT = "left to others"
    """In the air, to whoever flies it, or to its own failsafe."""
    FAILED = "failed"
    """The companion itself."""
    LOST = "lost"
    """How the vehicle ended is not known."""
    CRASHED = "crashed"
    """It hit something, or the ground too hard."""
    UNFINISHED = "unfinished"
    """The log ends before the flight does, or is still being written."""

    @property
    def leaves_it_whole(self) -> bool:
        """The vehicle neither crashed nor was lost: if it is disarmed, it has landed."""
        return self not in (Outcome.LOST, Outcome.CRASHED)

    @property
    def succeeded(self) -> bool:
        """The mission was done."""
        return self in _SUCCESSES

    @property
    def wanted(self) -> bool:
        """It ended as somebody wished."""
        return self in _WANTED


_ORDER = {outcome: number for number, outcome in enumerate(Outcome)}
_SUCCESSES = frozenset({Outcome.DELIVERED, Outcome.FLOWN})
_WANTED = _SUCCESSES | {Outcome.CALLED_OFF, Outcome.OPERATOR}


class Verdict(msgspec.Struct, frozen=True):
    """How a flight came out, and why."""

    outcome: Outcome
    """In a word."""
    cause: str = ""
    """In a few; empty where the word says it all."""

    @property
    def text(self) -> str:
        """In one line that begins with the outcome's word."""
        word = self.outcome.value
        if not self.cause or self.cause.startswith(word):
            return self.cause or word
        return f"{word}: {self.cause}"

    @property
    def sentence(self) -> str:
        """The same as a sentence."""
        return f"{self.text[0].upper()}{self.text[1:]}."


_KEPT = Verdict(Outcome.NOT_DELIVERED, "the vehicle did not release the parcel")


class Testimony(msgspec.Struct, frozen=True):
    """What a simulator knows of a flight that the companion does not."""

    contact_with: str | None = None
    contacts: int = 0
    least_clearance_m: float | None = None
    """Least true distance between the hull and an obstacle; None if the world has none."""
    released: bool = False
    landed: bool = True
    """It ended on the ground, disarmed and whole."""
    problem: str = ""
    """Why it knows nothing."""


def judge(
    found: Verdict | None,
    delivered: bool | None,
    testimony: Testimony | None = None,
    *,
    failure: str | None = None,
    ended: bool = True,
    began: bool = True,
) -> Verdict:
    """The verdict on a flight. `found`: what the supervisor found wrong with it. `delivered`: None for a flight that
    was to deliver nothing. `failure`: of the companion's own loop or link. `ended`: it was not abandoned. `began`: the
    vehicle was asked to arm, or taken over."""
    verdicts = [] if found is None else [found]
    if failure is not None:
        verdicts.append(Verdict(Outcome.FAILED, failure))
    elif not ended and not began:
        verdicts.append(Verdict(Outcome.CALLED_OFF, "abandoned before the start"))
    elif not ended:
        verdicts.append(Verdict(Outcome.LEFT, "abandoned: a vehicle in the air holds and lands by itself"))
    if delivered is not None:
        verdicts.append(Verdict(Outcome.DELIVERED) if delivered else _KEPT)
    if testimony is not None:
        verdicts += _told(testimony, delivered)
    return worst(verdicts) or Verdict(Outcome.FLOWN)


def _told(testimony: Testimony, delivered: bool | None) -> list[Verdict]:
    if testimony.problem:
        return [Verdict(Outcome.LOST, testimony.problem)]
    if testimony.contacts:
        return [Verdict(Outcome.CRASHED, f"hit {testimony.contact_with}")]
    found = []
    if delivered and not testimony.released:
        found.append(_KEPT)
    if not testimony.landed:
        found.append(Verdict(Outcome.LOST, "the vehicle was not seen to land"))
    return found


def worst(verdicts: list[Verdict]) -> Verdict | None:
    """The verdict that counts, the first of several alike; None of none."""
    return max(verdicts, key=lambda verdict: _ORDER[verdict.outcome], default=None)


CRITICAL_STATE = "the vehicle reports a critical state"


def crash_words(said: str, *, fallen: bool) -> str:
    """How a vehicle crashed, from what it said of an emergency ("" if nothing) and whether it is disarmed in a state of
    emergency; empty if it did not crash."""
    if "crash" in said.lower():
        return said.partition(":")[2].strip() or said
    return (said or "the vehicle reports an emergency") if fallen else ""


def recorded(result: Mapping[str, str]) -> Verdict | None:
    """The verdict in a log's metadata "result", where versions up to 0.1 have the fault alone; None without one."""
    if not result:
        return None
    try:
        return Verdict(Outcome(result["outcome"]), result.get("cause", ""))
    except (KeyError, ValueError):
        pass
    fault = result.get("fault", "")
    if fault:
        words = (outcome for outcome in Outcome if fault.startswith(outcome.value))
        return Verdict(next(words, Outcome.FAILED), fault)
    if result.get("landed") != "True":
        return Verdict(Outcome.LOST, "the vehicle was not seen to land")
    return Verdict(Outcome.DELIVERED if result.get("delivered") == "True" else Outcome.FLOWN)
