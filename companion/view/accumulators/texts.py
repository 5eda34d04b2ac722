"""What the companion and the vehicles said."""

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, TypeVar

from companion.link.vehicle_texts import Said, VehicleTexts
from companion.view.lines import Floats

_MOST = 2000
WARNING, ERROR = 3, 4
"""Levels of texts."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Text:
    """A line that was said."""

    time: float
    """s"""
    level: int
    """As in `logging`, by tens: 2 info, 3 warning, 4 error, 5 fatal."""
    source: str
    text: str


def level_of(severity: int) -> int:
    """The level of a text for MAVLink's severity: emergency, alert, critical; error; warning; notice, info; debug."""
    return (5, 5, 5, 4, 3, 2, 2, 1)[min(int(severity), 7)]


class VehicleLines:
    """The vehicles' STATUSTEXT as lines; those that come in pieces are put together."""

    def __init__(self) -> None:
        self._texts: dict[str, VehicleTexts] = {}
        """By sender."""

    def take(self, sender: str, times: Floats, table: Any) -> list[Text]:
        """What is whole with n messages more, and what will not be: their times (n,) in s, and fields by name."""
        texts, lines = self._texts.setdefault(sender, VehicleTexts()), list[Text]()
        for at, row in zip(times.tolist(), table, strict=True):
            now_ns = round(at * 1e9)
            said = texts.take(SimpleNamespace(**row), now_ns)
            whole = [said] if said is not None and said.whole else []
            lines += [_line(sender, each) for each in (*texts.cut_short(now_ns), *whole)]
        return lines

    def over(self, at: float) -> list[Text]:
        """What is not waited for any more at a time (s): it was never said to its end."""
        return [_line(sender, each) for sender, texts in self._texts.items() for each in texts.cut_short(at * 1e9)]


def _line(sender: str, said: Said) -> Text:
    return Text(said.began_ns * 1e-9, level_of(said.severity), sender, said.text)


def without_middle(lines: list[T], most: int) -> list[T]:
    """The first and the last, `most` together."""
    first = most - most // 2
    return lines if len(lines) <= most else lines[:first] + lines[len(lines) - most + first :]


class Texts:
    """The first and the last thousand lines of the companion's own log and of the vehicles'."""

    def __init__(self) -> None:
        self.companion: list[Text] = []
        self.vehicle: list[Text] = []
        self._lines = VehicleLines()

    def add_log(self, times: Floats, table: list[dict[str, Any]]) -> None:
        """Times (n,) in s and n records of TEXT."""
        rows = zip(times.tolist(), table, strict=True)
        self.companion += [Text(at, row["level"], row["name"], row["message"]) for at, row in rows]
        self.companion = without_middle(self.companion, _MOST)

    def add_statustexts(self, sender: str, times: Floats, table: list[dict[str, Any]]) -> None:
        """Times (n,) in s and the fields of n messages."""
        self.vehicle += self._lines.take(sender, times, table)
        self.vehicle = without_middle(self.vehicle, _MOST)

    def finish(self) -> None:
        """The log ends."""
        self.vehicle += self._lines.over(math.inf)
