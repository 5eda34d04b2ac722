"""The log service. The vehicle keeps no log: the list is empty, and says so."""

from collections.abc import Callable
from typing import Any

from protocol.messages import dialect
from vehicle_sim.services.outbox import Outbox


class LogService:
    """Answers at once, so that nobody waits for logs."""

    capabilities = 0

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_LOG_REQUEST_LIST: self._list,
            dialect.MAVLINK_MSG_ID_LOG_REQUEST_DATA: self._data,
        }

    def _list(self, message: Any) -> None:
        self._outbox.send(dialect.MAVLink_log_entry_message, 0, 0, 0, 0, 0)

    def _data(self, message: Any) -> None:
        """No bytes: the end of the log that was asked for."""
        self._outbox.send(dialect.MAVLink_log_data_message, message.id, message.ofs, 0, bytes(90))
