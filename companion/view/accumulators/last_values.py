"""The last record of each topic, in words."""

from collections.abc import Iterable
from numbers import Real
from typing import Any

import numpy as np

from companion.logs.message_names import decoded

_MOST = 6
"""Values of an array that are shown."""


class LastValues:
    """Keeps the last record of each topic."""

    def __init__(self) -> None:
        self._records: dict[str, Any] = {}

    def add(self, topic: str, table: Any) -> None:
        """A batch of records: a structured array (n,), or n dicts."""
        last = table[-1].copy()  # not a view of the whole batch
        self._records[topic] = last if isinstance(last, dict) else {name: last[name] for name in last.dtype.names}

    def text(self, topic: str) -> str:
        """The fields of the last record with their values. What the dialect lacks is as pymavlink's others decode it;
        its checksum was not verified."""
        record = self._records.get(topic, {})
        return ", ".join(f"{name} {_shown(value)}" for name, value in (decoded(topic, record) or record).items())


def _shown(value: Any) -> str:
    if isinstance(value, bytes):
        value = np.frombuffer(value, np.uint8)
    if isinstance(value, str) or not isinstance(value, Iterable):
        return _number(value)
    values = [_number(each) for each in value]
    more = f" and {len(values) - _MOST} more" if len(values) > _MOST else ""
    return f"[{', '.join(values[:_MOST])}{more}]"


def _number(value: Any) -> str:
    if isinstance(value, np.generic):
        value = value.item()
    return f"{value:.5g}" if isinstance(value, Real) and not isinstance(value, int) else str(value).rstrip("\0")
