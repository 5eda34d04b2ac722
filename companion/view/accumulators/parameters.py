"""The parameters that the vehicle told."""

import struct
from collections.abc import Container
from typing import Any

from protocol.messages import dialect

_MOST = 2000
_INTEGERS = {
    dialect.MAV_PARAM_TYPE_UINT8: "<B",
    dialect.MAV_PARAM_TYPE_INT8: "<b",
    dialect.MAV_PARAM_TYPE_UINT16: "<H",
    dialect.MAV_PARAM_TYPE_INT16: "<h",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}


class Parameters:
    """The last value of each parameter, the first 2000 or so of them."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[str, float, int]] = {}
        """Sender, value and MAV_PARAM_TYPE by name."""

    def add(self, sender: str, table: list[dict[str, Any]]) -> None:
        """Fields of PARAM_VALUE."""
        for row in table[:_MOST] if len(self._told) < _MOST else ():
            self._told[row["param_id"]] = sender, row["param_value"], row["param_type"]

    def values(self, bytewise: Container[str]) -> dict[str, float]:
        """By name. Senders in `bytewise` put an integer's bits into the message's float, all others its value."""
        return {
            name: _integer(value, _INTEGERS[kind]) if kind in _INTEGERS and sender in bytewise else value
            for name, (sender, value, kind) in self._told.items()
        }


def _integer(value: float, form: str) -> int:
    """The integer that has the same bits as a 32-bit float."""
    (whole,) = struct.unpack_from(form, struct.pack("<f", value))
    return int(whole)
