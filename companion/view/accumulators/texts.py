"""What the companion and the vehicles said."""

from dataclasses import dataclass
from typing import Any

from companion.view.lines import Floats

_MOST = 2000


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


class Texts:
    """The first 2000 lines of the companion's own log and of the vehicles' STATUSTEXT."""

    def __init__(self) -> None:
        self.companion: list[Text] = []
        self.vehicle: list[Text] = []

    def add_log(self, times: Floats, table: list[dict[str, Any]]) -> None:
        """Times (n,) in s and n records of TEXT."""
        rows = zip(times.tolist(), table, strict=True)
        self.companion += [Text(at, row["level"], row["name"], row["message"]) for at, row in rows]
        del self.companion[_MOST:]

    def add_statustexts(self, sender: str, times: Floats, table: list[dict[str, Any]]) -> None:
        """Times (n,) in s and the fields of n messages."""
        for at, row in zip(times.tolist(), table, strict=True):
            self.vehicle.append(Text(at, level_of(row["severity"]), sender, row["text"]))
        del self.vehicle[_MOST:]
