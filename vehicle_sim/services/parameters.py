"""The parameter service: what this vehicle does, under the names that PX4 has for it. None of it can be changed."""

import math
import struct
from collections.abc import Callable
from typing import Any

from protocol.messages import dialect
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.flight_control import DISARM_LANDED_NS, DISARM_PREFLIGHT_NS, FAILSAFE_HOLD_NS, LINK_LOSS_NS
from vehicle_sim.autopilot.setpoints import STREAM_LOSS_NS
from vehicle_sim.services.identity import is_for_vehicle
from vehicle_sim.services.outbox import Outbox

_LAND_ON_STREAM_LOSS, _LAND_ON_LINK_LOSS = 4, 3
_NO_TRANSMITTER_NEEDED = 7
_NO_TERMINATION = 121212


def parameters(airframe: Airframe) -> dict[str, float | int]:
    """By name, in the order of the names; integers are integer parameters."""
    tilt = math.atan(airframe.auto.acceleration_limit_m_s2 / GRAVITY)
    values: dict[str, float | int] = {
        "CBRK_FLIGHTTERM": _NO_TERMINATION,
        "COM_DISARM_LAND": DISARM_LANDED_NS * 1e-9,
        "COM_DISARM_PRFLT": DISARM_PREFLIGHT_NS * 1e-9,
        "COM_DL_LOSS_T": LINK_LOSS_NS // 1_000_000_000,
        "COM_FAIL_ACT_T": FAILSAFE_HOLD_NS * 1e-9,
        "COM_OBL_RC_ACT": _LAND_ON_STREAM_LOSS,
        "COM_OF_LOSS_T": STREAM_LOSS_NS * 1e-9,
        "COM_RCL_EXCEPT": _NO_TRANSMITTER_NEEDED,
        "FD_FAIL_P": 0,
        "FD_FAIL_R": 0,
        "GF_MAX_HOR_DIST": airframe.fence.radius_m,
        "GF_MAX_VER_DIST": airframe.fence.max_height_m,
        "MPC_THR_HOVER": airframe.body.hover_thrust,
        "MPC_TILTMAX_AIR": math.degrees(tilt),
        "NAV_DLL_ACT": _LAND_ON_LINK_LOSS,
    }
    return dict(sorted(values.items()))


class ParameterService:
    """Answers requests for one parameter or for all of them."""

    def __init__(self, airframe: Airframe, outbox: Outbox) -> None:
        self._outbox = outbox
        self._values = parameters(airframe)
        self._names = list(self._values)
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._read,
            dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._list,
            dialect.MAVLINK_MSG_ID_PARAM_SET: self._set,
        }

    def _read(self, message: Any) -> None:
        if not is_for_vehicle(message):
            return
        name, index = message.param_id, message.param_index
        if 0 <= index < len(self._names):
            name = self._names[index]
        if name in self._values:
            self._send(name)
        else:
            self._refuse(message, index, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST)

    def _list(self, message: Any) -> None:
        if is_for_vehicle(message):
            for name in self._names:
                self._send(name)

    def _set(self, message: Any) -> None:
        if is_for_vehicle(message):
            known = message.param_id in self._values
            error = dialect.MAV_PARAM_ERROR_READ_ONLY if known else dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST
            self._refuse(message, -1, error)

    def _send(self, name: str) -> None:
        """PARAM_VALUE; the bytes of an integer stand where the float's would, as PX4 sends them."""
        value, kind = self._values[name], dialect.MAV_PARAM_TYPE_REAL32
        if isinstance(value, int):
            value, kind = struct.unpack("<f", struct.pack("<i", value))[0], dialect.MAV_PARAM_TYPE_INT32
        self._outbox.send(
            dialect.MAVLink_param_value_message,
            name.encode(),
            value,
            kind,
            len(self._names),
            self._names.index(name),
        )

    def _refuse(self, message: Any, index: int, error: int) -> None:
        self._outbox.send(
            dialect.MAVLink_param_error_message,
            message.get_srcSystem(),
            message.get_srcComponent(),
            message.param_id.encode(),
            index,
            error,
        )
