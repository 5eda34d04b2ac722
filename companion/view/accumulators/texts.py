"""What the companion and the vehicles said."""

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Protocol, TypeVar

from companion.link.vehicle_texts import Said, VehicleTexts
from companion.view.lines import Floats

_MOST = 2000
WARNING, ERROR = 3, 4
"""Levels of texts."""


class _Levelled(Protocol):
    @property
    def level(self) -> int: ...


T = TypeVar("T", bound=_Levelled)


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


def shortened(lines: list[T], most: int) -> list[T]:
    """`most` at most, in their order: all warnings, and of the others (or of too many warnings) the first and the
    last."""
    if len(lines) <= most:
        return lines
    warnings = _ends([number for number, line in enumerate(lines) if line.level >= WARNING], most)
    others = _ends([number for number, line in enumerate(lines) if line.level < WARNING], most - len(warnings))
    return [lines[number] for number in sorted((*warnings, *others))]


def _ends(numbers: list[int], most: int) -> list[int]:
    first = most - most // 2
    return numbers if len(numbers) <= most else numbers[:first] + numbers[len(numbers) - most + first :]


class Story(list[Text]):
    """The lines of a source, shortened to two thousand."""

    def __init__(self) -> None:
        super().__init__()
        self.left_out = 0
        """Lines that are not in it."""

    def tell(self, lines: list[Text]) -> None:
        """Add lines."""
        every = [*self, *lines]
        self[:] = shortened(every, _MOST)
        self.left_out += len(every) - len(self)


class Texts:
    """What the companion's own log and the vehicles said."""

    def __init__(self) -> None:
        self.companion = Story()
        self.vehicle = Story()
        self._lines = VehicleLines()

    def add_log(self, times: Floats, table: list[dict[str, Any]]) -> None:
        """Times (n,) in s and n records of TEXT."""
        rows = zip(times.tolist(), table, strict=True)
        self.companion.tell([Text(at, row["level"], row["name"], row["message"]) for at, row in rows])

    def add_statustexts(self, sender: str, times: Floats, table: list[dict[str, Any]]) -> None:
        """Times (n,) in s and the fields of n messages."""
        self.vehicle.tell(self._lines.take(sender, times, table))

    def finish(self) -> None:
        """The log ends."""
        self.vehicle.tell(self._lines.over(math.inf))
