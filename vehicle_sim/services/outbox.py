"""Frames of the services, until the next tick sends them."""

from typing import Any

from protocol.messages import Encoder


class Outbox:
    """Frames in the order in which they were encoded, which is that of their sequence numbers."""

    def __init__(self, encoder: Encoder) -> None:
        self._encode = encoder.encode_fields
        self._frames: list[bytes] = []

    def send(self, message_class: type[Any], *fields: Any) -> None:
        """Encode a message from the arguments of its constructor."""
        self._frames.append(self._encode(message_class, *fields))

    def append(self, frames: bytes) -> None:
        """Add frames that are already encoded."""
        self._frames.append(frames)

    def take(self) -> list[bytes]:
        """All frames; the outbox is empty afterwards."""
        frames, self._frames = self._frames, []
        return frames
