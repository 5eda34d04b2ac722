"""STATUSTEXT, in numbered pieces for a long text."""

from protocol.messages import dialect
from vehicle_sim.autopilot.modes import Severity
from vehicle_sim.services.outbox import Outbox

_PIECE_CHARACTERS = 50


class StatusTexts:
    """Numbers the texts that need more than one piece."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._text_id = 0

    def send(self, severity: Severity, text: str) -> None:
        """Queue a text; a character that is not ASCII becomes a question mark."""
        data = text.encode("ascii", "replace")
        pieces = [data[i : i + _PIECE_CHARACTERS] for i in range(0, len(data), _PIECE_CHARACTERS)]
        number = 0
        if len(pieces) > 1:
            if len(pieces[-1]) == _PIECE_CHARACTERS:
                pieces.append(b"")  # a piece that is not full ends the text
            self._text_id = number = self._text_id % 65535 + 1
        for chunk, piece in enumerate(pieces):
            self._outbox.send(dialect.MAVLink_statustext_message, int(severity), piece, number, chunk)
