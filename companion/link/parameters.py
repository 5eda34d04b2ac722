"""The vehicle's parameters: asked for by name, a few at a time, and again until each is known, or known as missing."""

import math
import struct
from collections.abc import Sequence
from typing import Any

from protocol.messages import dialect

Question = tuple[str, ...]
"""The names that a parameter has had; the first that the vehicle knows answers for all."""

_AT_ONCE = 5
"""Questions that wait for an answer; ArduPilot has room for so many."""
_DIGITS = 7
"""That a float of 32 bits has: 0.3 is read as 0.3."""
INTEGERS = {
    dialect.MAV_PARAM_TYPE_UINT8: "<B",
    dialect.MAV_PARAM_TYPE_INT8: "<b",
    dialect.MAV_PARAM_TYPE_UINT16: "<H",
    dialect.MAV_PARAM_TYPE_INT16: "<h",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}
"""How the bytes of each integer type of MAV_PARAM_TYPE are packed."""


def same_bits(value: float, kind: int) -> int:
    """The integer of one of the types INTEGERS that has the same bits as a 32-bit float."""
    (whole,) = struct.unpack_from(INTEGERS[kind], struct.pack("<f", value))
    return int(whole)


def value_of(message: Any, *, bytewise: bool) -> float | None:
    """The value in a PARAM_VALUE (22); None if it has a type that does not fit into one, or is not finite.

    `bytewise`: an integer's bytes stand where the float's would (PX4); otherwise it is given as a float (ArduPilot).
    """
    if message.param_type in INTEGERS:
        if bytewise:
            return float(same_bits(message.param_value, message.param_type))
        value = float(message.param_value)
    elif message.param_type == dialect.MAV_PARAM_TYPE_REAL32:
        value = float(f"{message.param_value:.{_DIGITS}g}")
    else:
        return None
    return value if math.isfinite(value) else None


class ParameterReader:
    """Reads the parameters of some questions. A question is settled once a value has come under one of its names, or
    once each of its names is missing: the vehicle says so, or does not answer as often as it is asked."""

    def __init__(self, questions: Sequence[Question], *, bytewise: bool, interval_s: float, tries: int) -> None:
        self.values: dict[str, float] = {}
        """What has come, by the name that it has come under."""
        self._open = list(questions)
        self._count = len(self._open)
        self._bytewise = bytewise
        self._interval_ns = round(interval_s * 1e9)
        self._tries = tries
        self._asked: dict[str, tuple[int, int]] = {}
        """By name: how often it was asked for, and when (ns) last."""
        self._missing: set[str] = set()

    @property
    def done(self) -> bool:
        """Each question is settled."""
        return not self._open

    def __str__(self) -> str:
        return f"{self._count - len(self._open)} of {self._count}"

    def due(self, now_ns: int) -> list[str]:
        """The names to ask for now; to be called again and again until it is done."""
        names = []
        for question in self._open[:_AT_ONCE]:
            for name in question:
                times, last_ns = self._asked.get(name, (0, now_ns - self._interval_ns))
                if name in self._missing or now_ns - last_ns < self._interval_ns:
                    continue
                if times < self._tries:
                    names.append(name)
                    self._asked[name] = times + 1, now_ns
                else:
                    self._missing.add(name)
        self._settle()
        return names

    def take(self, message: Any) -> None:
        """PARAM_VALUE (22). What was not asked about, or has no value that fits, is ignored."""
        name, value = message.param_id, value_of(message, bytewise=self._bytewise)
        if value is not None and any(name in question for question in self._open):
            self.values[name] = value
            self._settle()

    def refuse(self, message: Any) -> None:
        """PARAM_ERROR (345): the vehicle does not have the parameter, or does not give it."""
        if any(message.param_id in question for question in self._open):
            self._missing.add(message.param_id)
            self._settle()

    def _settle(self) -> None:
        self._open = [
            question
            for question in self._open
            if not self._missing.issuperset(question) and not any(name in self.values for name in question)
        ]
