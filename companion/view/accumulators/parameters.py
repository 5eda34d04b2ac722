"""The parameters that the vehicle told."""

from collections.abc import Container
from typing import Any

from companion.link.parameters import INTEGERS, same_bits

_MOST = 2000


class Parameters:
    """The last value of each parameter of each sender, of the first 2000 of them."""

    def __init__(self) -> None:
        self._told: dict[str, dict[str, tuple[float, int]]] = {}
        """Value and MAV_PARAM_TYPE by sender and name."""

    def add(self, sender: str, table: list[dict[str, Any]]) -> None:
        """Fields of PARAM_VALUE."""
        told = self._told.setdefault(sender, {})
        for row in table:
            name = row["param_id"]
            if name in told or len(told) < _MOST:
                told[name] = row["param_value"], row["param_type"]

    def values(self, sender: str, bytewise: Container[str]) -> dict[str, float]:
        """What a sender told, by name. Those in `bytewise` put an integer's bits into the message's float, all others
        its value."""
        return {
            name: same_bits(value, kind) if kind in INTEGERS and sender in bytewise else value
            for name, (value, kind) in self._told.get(sender, {}).items()
        }
