"""What the vehicle says in words: STATUSTEXT (253), of which a text longer than 50 characters comes in pieces.

Protocol: https://mavlink.io/en/messages/common.html#STATUSTEXT
"""

from typing import Any, NamedTuple

_PIECE = 50
"""Characters of a piece; a shorter one is the last."""
_MOST_PIECES = 8
_MOST_TEXTS = 4
"""At a time."""
_PATIENCE_NS = 1_000_000_000
"""What is not whole after so long is said as it is."""
_LOST = " ... "


class Said(NamedTuple):
    """A text as far as it is known."""

    severity: int
    text: str
    whole: bool
    """Nothing more of it comes."""
    began_ns: int
    """When the first of it came."""


class _Pieces:
    """The pieces of one text, by their numbers."""

    def __init__(self, severity: int, now_ns: int) -> None:
        self.severity = severity
        self.began_ns = now_ns
        self.over = False
        """It was whole."""
        self._pieces: dict[int, str] = {}

    def fits(self, number: int, piece: str) -> bool:
        """It is the same piece once more, or a new one."""
        return self._pieces.get(number, piece) == piece

    def add(self, number: int, piece: str) -> None:
        self._pieces[number] = piece

    def said(self) -> Said:
        """The text so far."""
        last = max(self._pieces)
        pieces = [self._pieces.get(number, _LOST) for number in range(last + 1)]
        ended = len(pieces[-1]) < _PIECE or last + 1 == _MOST_PIECES
        whole = ended and len(self._pieces) == last + 1
        return Said(self.severity, vehicle_text("".join(pieces)), whole, self.began_ns)


class VehicleTexts:
    """The texts of one vehicle."""

    def __init__(self) -> None:
        self._begun: dict[int, _Pieces] = {}
        """By their numbers."""
        self._cut: list[Said] = []

    def take(self, message: Any, now_ns: int) -> Said | None:
        """The text as far as it is known with this message; None of a piece that says nothing new."""
        number, piece = message.id, message.text
        if number == 0:
            return Said(message.severity, vehicle_text(piece), whole=True, began_ns=now_ns)
        if message.chunk_seq >= _MOST_PIECES:
            return None
        begun = self._begun.get(number)
        if begun is not None and not begun.fits(message.chunk_seq, piece):  # the number of another text by now
            self._cut_short(number)
        if number not in self._begun and len(self._begun) == _MOST_TEXTS:
            self._cut_short(next(iter(self._begun)))
        pieces = self._begun.setdefault(number, _Pieces(message.severity, now_ns))
        if pieces.over:  # a piece that comes once more
            return None
        pieces.add(message.chunk_seq, piece)
        said = pieces.said()
        pieces.over = said.whole
        return said

    def cut_short(self, now_ns: float) -> list[Said]:
        """Texts of which nothing more has come; at a time of infinity, all that are not whole."""
        for number in [each for each, text in self._begun.items() if now_ns - text.began_ns > _PATIENCE_NS]:
            self._cut_short(number)
        cut, self._cut = self._cut, []
        return cut

    def _cut_short(self, number: int) -> None:
        pieces = self._begun.pop(number)
        if not pieces.over:
            self._cut.append(pieces.said()._replace(whole=True))


def vehicle_text(text: str) -> str:
    """A text of STATUSTEXT (253) as one that does nothing to a terminal. PX4 ends those with a tab that it tells as
    events, too."""
    return "".join(letter if letter.isprintable() else "?" for letter in text.rstrip("\0 \t"))
