"""The parameter service: list, read and set, with integers bytewise as PX4 sends them.

PX4 1.16 is silent about a name that it does not have and a type that is wrong; here PARAM_ERROR says so.
"""

import struct
from collections.abc import Callable, Iterator
from typing import Any

from protocol.messages import dialect
from vehicle_sim.services.outbox import Outbox, Payload
from vehicle_sim.services.parameter_store import Parameters, Refusal, Value

HASH = "_HASH_CHECK"

_INTEGER, _FLOAT = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32
_HASH_INDEX = 65535
_pack_value = struct.Struct("<4sHH16sB").pack
"""PARAM_VALUE. Its value is handed on as bytes, since some integers are no float that survives being copied."""


class ParameterService:
    """Answers questions for one parameter or all, and changes them."""

    capabilities = dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE

    def __init__(self, parameters: Parameters, outbox: Outbox) -> None:
        self._parameters = parameters
        self._outbox = outbox
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._read,
            dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._list,
            dialect.MAVLINK_MSG_ID_PARAM_SET: self._set,
        }

    def reset(self) -> None:
        """All of them as they were at first; what changes is told to all."""
        self.tell(self._parameters.reset())

    def tell(self, names: list[str]) -> None:
        """To all, what others have changed."""
        self._outbox.pace_to_all(lambda: map(self._value, names))

    def _read(self, message: Any) -> None:
        names, name, index = self._parameters.names, message.param_id, message.param_index
        if 0 <= index < len(names):
            name = names[index]
        if name == HASH or name in self._parameters:
            self._outbox.put(self._value(name))
        else:
            self._refuse(message, index, Refusal.DOES_NOT_EXIST)

    def _list(self, message: Any) -> None:
        """The hash first: a ground station that has these values already stops the rest by setting it."""
        self._outbox.pace(self, self._all())

    def _all(self) -> Iterator[Payload]:
        yield self._value(HASH)
        for name in self._parameters.names:
            yield self._value(name)

    def _set(self, message: Any) -> None:
        name = message.param_id
        if name == HASH:
            self._outbox.pace(self, iter(()))
            return
        refusal = self._try_to_set(name, message)
        if refusal is not None:
            self._refuse(message, -1, refusal)
        if name in self._parameters:
            self._outbox.put(self._value(name), to_all=refusal is None)

    def _try_to_set(self, name: str, message: Any) -> Refusal | None:
        value: Value = message.param_value
        if message.param_type == _INTEGER:
            value = int.from_bytes(message.get_payload()[:4].ljust(4, b"\0"), "little", signed=True)
        elif message.param_type != _FLOAT and name in self._parameters:
            return Refusal.TYPE_MISMATCH
        return self._parameters.set(name, value)

    def _value(self, name: str) -> Payload:
        """PARAM_VALUE of one of `names`, or of the hash."""
        parameters = self._parameters
        if name == HASH:
            data, index, kind = parameters.checksum(), _HASH_INDEX, dialect.MAV_PARAM_TYPE_UINT32
        else:
            data, index = parameters.packed(name), parameters.names.index(name)
            kind = _INTEGER if parameters.is_integer(name) else _FLOAT
        count = len(parameters.names)
        return dialect.MAVLink_param_value_message, _pack_value(data, count, index, name.encode(), kind)

    def _refuse(self, message: Any, index: int, refusal: Refusal) -> None:
        self._outbox.send(
            dialect.MAVLink_param_error_message,
            message.get_srcSystem(),
            message.get_srcComponent(),
            message.param_id.encode(),
            index,
            int(refusal),
        )
