"""The parameters that the vehicle told."""

from collections.abc import Container
from typing import Any

from companion.link.parameters import INTEGERS, same_bits

_MOST = 2000


class Parameters:
    """The last value of each parameter, of the first 2000 of them."""

    def __init__(self) -> None:
        self._told: dict[str, tuple[str, float, int]] = {}
        """Sender, value and MAV_PARAM_TYPE by name."""

    def add(self, sender: str, table: list[dict[str, Any]]) -> None:
        """Fields of PARAM_VALUE."""
        for row in table:
            name = row["param_id"]
            if name in self._told or len(self._told) < _MOST:
                self._told[name] = sender, row["param_value"], row["param_type"]

    def values(self, bytewise: Container[str]) -> dict[str, float]:
        """By name. Senders in `bytewise` put an integer's bits into the message's float, all others its value."""
        return {
            name: same_bits(value, kind) if kind in INTEGERS and sender in bytewise else value
            for name, (sender, value, kind) in self._told.items()
        }
