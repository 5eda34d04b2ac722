"""The fields of a recorded message as attributes."""

from collections.abc import Mapping
from typing import Any

import numpy as np


class MessageFields:
    """The fields of a message, a dict or a row of a structured array, with plain numbers."""

    __slots__ = ("_fields",)

    def __init__(self, fields: Mapping[str, Any] | np.void) -> None:
        self._fields = fields

    def __getattr__(self, name: str) -> Any:
        value = self._fields[name]
        return value.item() if isinstance(value, np.generic) else value
