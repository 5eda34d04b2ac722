"""The log service (https://mavlink.io/en/messages/common.html, LOG_REQUEST_LIST and its like): lists the vehicle's
logs, sends and erases them."""

import struct
from collections.abc import Callable, Iterator
from typing import Any

from protocol.messages import dialect
from vehicle_sim.services.flight_logs import FlightLogs
from vehicle_sim.services.outbox import Outbox, Payload

_PIECE_BYTES = 90
_pack_data = struct.Struct(f"<IHB{_PIECE_BYTES}s").pack


class LogService:
    """Answers at once, also that there is no log, so that nobody waits for one."""

    capabilities = 0

    def __init__(self, logs: FlightLogs, outbox: Outbox) -> None:
        self._logs = logs
        self._outbox = outbox
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_LOG_REQUEST_LIST: self._list,
            dialect.MAVLINK_MSG_ID_LOG_REQUEST_DATA: self._data,
            dialect.MAVLINK_MSG_ID_LOG_REQUEST_END: lambda _: self._outbox.pace(self, iter(())),
            dialect.MAVLINK_MSG_ID_LOG_ERASE: lambda _: self._logs.erase(),
        }

    def _list(self, message: Any) -> None:
        logs, entry = self._logs.whole, dialect.MAVLink_log_entry_message
        asked = list(enumerate(logs))[message.start : message.end + 1]
        for number, log in asked:
            self._outbox.send(entry, number, len(logs), len(logs) - 1, log.begun_s, len(log.content))
        if not asked:
            self._outbox.send(entry, 0, len(logs), max(len(logs) - 1, 0), 0, 0)

    def _data(self, message: Any) -> None:
        number, logs = message.id, self._logs.whole
        content = logs[number].content if number < len(logs) else b""
        self._outbox.pace(self, _pieces(number, content, message.ofs, message.ofs + message.count))


def _pieces(number: int, content: bytes | bytearray, start: int, end: int) -> Iterator[Payload]:
    """A part of a log, one piece at least. If the log ends within it, the last piece is not full, and empty if need be,
    which says so."""
    size = _PIECE_BYTES
    while size == _PIECE_BYTES:
        piece = bytes(content[start : min(start + _PIECE_BYTES, end)])
        size = len(piece)
        yield dialect.MAVLink_log_data_message, _pack_data(start, number, size, piece)
        start += size
        if start >= end:
            return
