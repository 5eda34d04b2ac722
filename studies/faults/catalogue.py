"""The faults that are flown, each with what is promised of it (docs/failsafes.md)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from studies.faults import changes
from studies.faults.changes import ATTITUDE, HEARTBEAT, POSITION, RING
from studies.faults.injector import PERFECT, Change, Link

DELIVERED, ASTRAY, LANDED, WITHDREW, REFUSED, CONTACT, NOT_ENDED, RAISED = OUTCOMES = (
    "delivered",
    "astray",
    "landed",
    "withdrew",
    "refused",
    "contact",
    "not ended",
    "raised",
)
"""How a flight ends: the mission done; done, but elsewhere by the truth; landed by the companion; handed to the
vehicle's own autopilot, which holds, and on the ground; never begun; ...; an exception."""


@dataclass(frozen=True, slots=True)
class Promise:
    text: str
    ends: frozenset[str]
    """Outcomes."""
    answer: str | None = None
    """One of ANSWERS; None: it need not be said."""
    within_s: float | None = None


ANSWERS = {
    "asked to hold": "withdraw",
    ": holding": "hold",
    "gone along with": "follow",
    "not followed": "refuse",
    "left to it": "watch",
    "left to its own": "watch",
    "no setpoint before": "gap",
    ": landing": "land",
    "landing on request": "land",
    "rebooted": "reboot",
    "mode changed": "let go",
    "disarmed in flight": "disarmed",
    "given up": "give up",
}
"""What a sentence of the companion that has these words says of its answer."""

FLIES_ON = Promise("flies on", frozenset({DELIVERED}))
FOLLOWS = Promise("flies on in the frame of the take-off, says so", frozenset({DELIVERED}), "follow", 0.3)
SLOW_OR_LANDED = Promise("flies on slowly, or is landed or refused", frozenset({DELIVERED, LANDED, WITHDREW, REFUSED}))
HOLDS = Promise("holds within 0.5 s, lands after 5 s", frozenset({LANDED}), "hold", 0.5)
WITHDRAWS = Promise("withdraws within 0.3 s, lands after 5 s", frozenset({WITHDREW}), "withdraw", 0.3)
LOST = Promise("brakes at once, withdraws at 0.5 s, lands after 5 s", frozenset({WITHDREW}), "withdraw", 0.55)
NEW_CLOCK = Promise("flies on by the new clock, says so", frozenset({DELIVERED}), "follow", 0.3)

COMBINED = Link(there=0.05, back=0.05, jitter=0.02, loss=0.1, duplicated=0.05, reordered=0.05, corrupted=0.02)


@dataclass(frozen=True, slots=True)
class Fault:
    """`link` or `change` says what is wrong; `change` makes one, by seed, with a state of its own."""

    name: str
    level: str
    promise: Promise
    link: Link | None = None
    change: Callable[[int], Change] | None = None
    from_start: bool = False
    """From before the take-off; otherwise from a random moment of the flight."""
    before: Link = PERFECT
    """The link until then."""
    missions: tuple[str, ...] = ("courier", "square")
    over_udp: bool = False
    """Flown in real time, too."""
    on_rates: bool = False
    """Flown on rates alone: the vehicle's own attitude control knows nothing of the change."""

    @property
    def key(self) -> str:
        return f"{self.name}, {self.level}" if self.level else self.name


def _new(make: Callable[..., Change], *arguments: Any, **options: Any) -> Callable[[int], Change]:
    """The same for each seed."""
    return lambda seed: make(*arguments, **options)


def _links() -> tuple[Fault, ...]:
    late = tuple(
        Fault(
            "delay each way",
            f"{ms} ms",
            FLIES_ON if ms <= 100 else SLOW_OR_LANDED,
            Link(there=ms * 1e-3, back=ms * 1e-3),
            from_start=True,
            over_udp=ms == 50,
        )
        for ms in (20, 50, 100, 200)
    )
    jumps = tuple(
        Fault(
            "delay each way jumps",
            f"20 to {ms} ms",
            FLIES_ON if ms <= 100 else SLOW_OR_LANDED,
            Link(there=ms * 1e-3, back=ms * 1e-3),
            before=Link(there=0.02, back=0.02),
        )
        for ms in (100, 200)
    )
    return (
        *late,
        *jumps,
        Fault("position late", "150 ms", FLIES_ON, change=_new(changes.late, POSITION, 0.15), from_start=True),
        Fault("jitter", "55 +- 50 ms", FLIES_ON, Link(there=0.055, back=0.055, jitter=0.05), from_start=True),
        Fault("loss", "40 %", FLIES_ON, Link(loss=0.4)),
        Fault("reordered", "20 %", FLIES_ON, Link(reordered=0.2)),
        Fault("duplicated", "5 %", FLIES_ON, Link(duplicated=0.05)),
        Fault("corrupted", "2 %", FLIES_ON, Link(corrupted=0.02)),
        Fault("combined", "", FLIES_ON, COMBINED, from_start=True, over_udp=True),
        Fault("flood", "9,216 x 0xFE, 1 a datagram", FLIES_ON, Link(flood=1)),
    )


def _rings() -> tuple[Fault, ...]:
    courier = ("courier",)
    return (
        Fault("ring", "frozen", HOLDS, change=_new(changes.frozen, RING), missions=courier),
        Fault("ring", "random", HOLDS, change=changes.random_ring, missions=courier, over_udp=True),
        Fault("ring", "increment_f = 100", HOLDS, change=_new(changes.impossible_ring), missions=courier),
    )


def _telemetry() -> tuple[Fault, ...]:
    resets = tuple(
        Fault(
            "yaw reset",
            f"{degrees} deg, {'the whole frame' if whole else 'the heading alone'}",
            FOLLOWS,
            change=_new(changes.turned, degrees, whole_frame=whole),
            on_rates=True,
        )
        for degrees in (45, 90)
        for whole in (False, True)
    )
    stamps = tuple(
        Fault(
            "a stamp 4 s ahead",
            f"one of the {what}",
            FLIES_ON,
            change=_new(changes.stamped_ahead, ids, 4.0),
        )
        for what, ids in (("attitude", ATTITUDE[:1]), ("position", POSITION))
    )
    return (
        Fault("position", "frozen", WITHDRAWS, change=_new(changes.frozen, POSITION), over_udp=True),
        Fault("attitude", "frozen", WITHDRAWS, change=_new(changes.frozen, ATTITUDE)),
        *resets,
        Fault("position reset", "3 m up", FOLLOWS, change=_new(changes.shifted, down=-3.0)),
        Fault("position reset", "90 km north", FOLLOWS, change=_new(changes.shifted, north=90_000.0)),
        Fault("vx = 140 m/s", "once", FLIES_ON, change=_new(changes.swift, 140.0, one=True)),
        Fault("vx = 140 m/s", "for good", WITHDRAWS, change=_new(changes.swift, 140.0, one=False)),
        Fault("position", "lost", LOST, change=_new(changes.missing, POSITION)),
        *stamps,
        Fault("clock back", "by 0.5 s", NEW_CLOCK, change=_new(changes.clock_back, 0.5), over_udp=True),
        Fault("clock back", "to 0", NEW_CLOCK, change=_new(changes.clock_back, None)),
        Fault("heartbeat", "none for 3.2 s", FLIES_ON, change=_new(changes.missing, HEARTBEAT, 3.2)),
    )


FAULTS: dict[str, Fault] = {fault.key: fault for fault in (*_links(), *_rings(), *_telemetry())}
