"""Requests that the vehicle does not serve: each is answered at once, as its protocol refuses, or by a text."""

from collections.abc import Callable
from typing import Any

from protocol.messages import dialect
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Severity
from vehicle_sim.services.identity import Identity
from vehicle_sim.services.outbox import Channel, Outbox
from vehicle_sim.timing import TICK_NS

AGAIN_TICKS = 1_000_000_000 // TICK_NS
"""A message that comes in a stream has its text once in so many ticks on each link."""

NO_REQUESTS = frozenset(
    {
        dialect.MAVLINK_MSG_ID_COMMAND_ACK,
        dialect.MAVLINK_MSG_ID_PARAM_ERROR,
        dialect.MAVLINK_MSG_ID_LOGGING_DATA,
        dialect.MAVLINK_MSG_ID_LOGGING_DATA_ACKED,
        dialect.MAVLINK_MSG_ID_LOGGING_ACK,
        dialect.MAVLINK_MSG_ID_REMOTE_LOG_DATA_BLOCK,
        dialect.MAVLINK_MSG_ID_REMOTE_LOG_BLOCK_STATUS,
        dialect.MAVLINK_MSG_ID_MOUNT_STATUS,
        dialect.MAVLINK_MSG_ID_CAMERA_STATUS,
        dialect.MAVLINK_MSG_ID_CAMERA_FEEDBACK,
        dialect.MAVLINK_MSG_ID_GIMBAL_REPORT,
        dialect.MAVLINK_MSG_ID_GIMBAL_TORQUE_CMD_REPORT,
        dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
        dialect.MAVLINK_MSG_ID_AUTOPILOT_STATE_FOR_GIMBAL_DEVICE,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_SENSOR,
        dialect.MAVLINK_MSG_ID_CUBEPILOT_FIRMWARE_UPDATE_RESP,
        dialect.MAVLINK_MSG_ID_SETUP_SIGNING,  # nobody is told about keys
    }
)
"""Messages to one receiver that answer or report, or that must have no answer."""

_REQUESTS = {
    number: message_class
    for number, message_class in dialect.mavlink_map.items()
    if "target_system" in message_class.fieldnames and number not in NO_REQUESTS
}


class RefusalService:
    """Takes what no other service does."""

    capabilities = 0

    def __init__(self, flight: FlightControl, outbox: Outbox, identity: Identity) -> None:
        self._flight = flight
        self._outbox = outbox
        self._system = identity.system
        self._said: dict[tuple[Channel, int], int] = {}
        """When a text was last sent for a message (ns), by link and message."""
        self.handlers: dict[int, Callable[[Any], None]] = {
            **dict.fromkeys(_REQUESTS, self._say),
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST_PARTIAL_LIST: self._partial_list,
            dialect.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST: self._partial_list,
            dialect.MAVLINK_MSG_ID_PARAM_EXT_SET: self._extended_parameter,
            dialect.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: self._stream,
            dialect.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN: self._set_origin,
            dialect.MAVLINK_MSG_ID_TERRAIN_CHECK: self._terrain,
        }

    def _say(self, message: Any) -> None:
        """Not for a message to all, which somebody else may serve."""
        if message.target_system != self._system:
            return
        key, now_ns = (self._outbox.here, message.get_msgId()), self._flight.motion.time_ns
        if now_ns - self._said.get(key, -AGAIN_TICKS * TICK_NS) >= AGAIN_TICKS * TICK_NS:
            channels = self._outbox.channels
            self._said = {each: when for each, when in self._said.items() if each[0] in channels} | {key: now_ns}
            self._flight.announce(Severity.WARNING, f"{message.get_type()} is not supported")

    def _partial_list(self, message: Any) -> None:
        self._outbox.send(
            dialect.MAVLink_mission_ack_message,
            message.get_srcSystem(),
            message.get_srcComponent(),
            dialect.MAV_MISSION_UNSUPPORTED,
            message.mission_type,
        )

    def _extended_parameter(self, message: Any) -> None:
        """There are none: cameras have them."""
        self._outbox.send(
            dialect.MAVLink_param_ext_ack_message,
            message._param_id_raw,
            message._param_value_raw,
            message.param_type,
            dialect.PARAM_ACK_VALUE_UNSUPPORTED,
        )

    def _stream(self, message: Any) -> None:
        """Groups of messages are ArduPilot's; here each message has its own interval."""
        self._outbox.send(dialect.MAVLink_data_stream_message, message.req_stream_id, 0, 0)

    def _set_origin(self, message: Any) -> None:
        """It is the world's; the answer says what stays."""
        origin = self._outbox.streams.request(dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
        assert origin is not None
        self._outbox.here.append(origin)
        self._say(message)

    def _terrain(self, message: Any) -> None:
        """A spacing of 0: nothing is known about that place."""
        self._outbox.send(dialect.MAVLink_terrain_report_message, message.lat, message.lon, 0, 0.0, 0.0, 0, 0)
