"""A sentence about a flight, with the figures behind it."""

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How much a finding matters, the worst first."""

    PROBLEM = "problem"
    WARNING = "warning"
    NOTE = "note"
    GOOD = "good"


@dataclass(frozen=True, slots=True)
class Finding:
    """One sentence that stands by itself, and the figures behind it."""

    level: Level
    about: str
    text: str
    evidence: tuple[str, ...] = ()
    at: tuple[float, ...] = ()
    """Times (s) to look at, the most telling first."""
    chart: str = ""
    """The title of the chart to look at."""


def at_text(seconds: float) -> str:
    return f"{seconds:.2f} s"


def times_text(count: int, what: str) -> str:
    return f"one {what}" if count == 1 else f"{count} {what}s"
