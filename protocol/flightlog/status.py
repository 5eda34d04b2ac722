"""What a person who watches a flight is shown of it at a moment."""

import json
from typing import NamedTuple


class Status(NamedTuple):
    """The state of a flight in words."""

    title: str
    figures: tuple[tuple[str, str], ...] = ()
    """Names and values, the units with them."""
    done: float | None = None
    """Share of the whole, 0..1; None while that is not known."""
    hint: str = ""
    """What one can do."""

    @property
    def line(self) -> str:
        """All of it but the hint in one line."""
        done = [] if self.done is None else [f"{self.done:.0%}"]
        return "  ".join((self.title, *done, *(f"{name} {value}" for name, value in self.figures)))

    def encode(self) -> bytes:
        """For `decode`."""
        return json.dumps(self).encode()

    @classmethod
    def decode(cls, data: bytes) -> "Status":
        """From `encode`."""
        title, figures, done, hint = json.loads(data)
        return cls(title, tuple((name, value) for name, value in figures), done, hint)
