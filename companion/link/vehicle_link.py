"""The vehicle at the other end of the link: datagrams in and reports out, requests in and bytes out.

No I/O and no clock: time is an argument.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from companion.config import Settings
from companion.link import wire
from companion.link.firmware import firmware_of
from companion.link.firmware.firmware import Firmware
from companion.link.message_rates import MessageRates
from companion.link.requests import Requests
from companion.link.sector_scans import SectorScans
from companion.outputs import OUTPUTS
from companion.reports import (
    AttitudeReport,
    CommandReport,
    LinkReport,
    Motors,
    Rebooted,
    RepeatedAttitude,
    Report,
)
from companion.state import Announcement, FlightMode, Output, Scan, Setpoint, Severity, VehicleRequest, VehicleStatus
from protocol.framing import Frame, Framer
from protocol.messages import Encoder, decode, dialect
from protocol.peer import Peer

VEHICLE_COMPONENT = 1
"""MAV_COMP_ID_AUTOPILOT1, the component that flies."""
_SECOND_NS = 1_000_000_000
_REFUSALS_TOLERATED = 3
_REFUSALS_NS = _SECOND_NS // 2
"""So many refusals within this time are a fault."""
_COMPLAINT_NS = 5 * _SECOND_NS
"""A warning of the vehicle explains what happens within this time after it."""

_ATTITUDE_QUATERNION = dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
_OBSTACLE_DISTANCE = dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE
_EXTENDED_STATE = dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
"""Asked for, and done without where a vehicle does not send it."""


@dataclass(frozen=True, slots=True)
class Traffic:
    """What was wrong with the traffic from the vehicle, as counts."""

    messages_lost: int
    """Sequence numbers that never came."""
    messages_late: int
    """Overtaken by later ones."""
    messages_refused: int
    """Telemetry that can't be true."""
    duplicates: int
    frames_bad: int
    """Pieces of the byte stream that are no frame: a wrong checksum, or no frame's beginning."""
    sequence_restarts: int
    """Jumps of the sequence number that no loss explains."""
    reboots: int
    """Falls of the vehicle's time since boot."""


class VehicleLink:
    """The first vehicle that is heard with a known firmware, and all that is said to it and by it."""

    def __init__(self, settings: Settings, output: Output) -> None:
        self.vehicle: tuple[int, int] | None = None
        """(system, component), once one was found."""
        self.peer: Peer | None = None
        self.firmware: Firmware | None = None
        self.status = VehicleStatus(FlightMode.OTHER, False, False)
        self.on_ground: bool | None = None
        """The vehicle says that it stands on the ground; None: it says nothing of it."""
        self.motors = Motors()
        self.refused_messages = 0
        self.framer = Framer()
        self._settings = settings
        self._output = output
        self._encode_setpoint = OUTPUTS[output].encode
        self._longest_age_ns = round(settings.control.prediction.longest * 1e9)
        self._encoder = Encoder(settings.identity.system or 1, settings.identity.component)
        self._requests = Requests(settings.supervision)
        self._rates = MessageRates(_needed(settings), settings.rates.least_share)
        self._version: int | None = None
        self._prearm_ok = True
        self._sectors = SectorScans()
        self._whole_scans = False
        """A scan has come as one OBSTACLE_DISTANCE: DISTANCE_SENSORs are not needed."""
        self._refusals: deque[int] = deque(maxlen=_REFUSALS_TOLERATED)
        self._refusal = ""
        self._complaint = 0, ""
        """When the vehicle warned of something last (ns), and the text."""
        self._next_beat_ns = 0
        self._outbox: list[bytes] = []
        self._handlers: dict[int, Callable[[Any, int], Report | Announcement | None]] = {
            _ATTITUDE_QUATERNION: wire.attitude_quaternion,
            dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: wire.local_position,
            dialect.MAVLINK_MSG_ID_ATTITUDE: self._on_euler_attitude,
            _OBSTACLE_DISTANCE: self._on_obstacle_distance,
            dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: self._on_distance_sensor,
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            _EXTENDED_STATE: self._on_extended_state,
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self._on_sys_status,
            dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._on_version,
            dialect.MAVLINK_MSG_ID_COMMAND_ACK: self._on_ack,
            dialect.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            dialect.MAVLINK_MSG_ID_STATUSTEXT: self._on_statustext,
        }

    # -- datagrams in, reports out -------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_ns: int, *, whole: bool) -> list[Report | Announcement]:
        """The reports of one datagram (`whole`) or of a piece of a byte stream, and what the vehicle says, in order.

        What is to be answered goes into the outbox. Raises nothing for any bytes.
        """
        frames = self.framer.datagram(data) if whole else self.framer.feed(data)
        reports: list[Report | Announcement] = []
        peer, handlers, count = self.peer, self._handlers, self._rates.count
        for frame in frames:
            message_id = frame.message_id
            if peer is None:
                peer = self._find(frame)
            if peer is None or not peer.observe(frame, now_ns):
                continue
            count(message_id, now_ns)
            handler = handlers.get(message_id)
            if handler is None:
                continue
            message: Any = decode(frame)
            if message_id == _ATTITUDE_QUATERNION and peer.observe_boot_time(message.time_boot_ms, now_ns):
                reports += Rebooted(), self._complain(Severity.ERROR, "the vehicle rebooted")
            try:
                report = handler(message, now_ns)
            except wire.RefusedError as refused:
                report = self._refuse(str(refused), now_ns)
            if report is not None:
                reports.append(report)
        return reports

    def _find(self, frame: Frame) -> Peer | None:
        """Take the sender for the vehicle if this is the heartbeat of an autopilot that is known. No vehicle is system
        0, which addresses all systems."""
        if frame.message_id != dialect.MAVLINK_MSG_ID_HEARTBEAT or frame.component != VEHICLE_COMPONENT:
            return None
        if frame.system == 0:
            return None
        heartbeat: Any = decode(frame)
        firmware = firmware_of(heartbeat.autopilot)
        if firmware is None:
            return None
        self.vehicle = (frame.system, VEHICLE_COMPONENT)
        self.peer = Peer(frame.system, VEHICLE_COMPONENT)
        self.firmware = self._requests.firmware = firmware
        self.motors = Motors(angle_boost=firmware.angle_boost)
        identity = self._settings.identity
        self._encoder = Encoder(identity.system or frame.system, identity.component)
        return self.peer

    def _complain(self, severity: Severity, text: str) -> Announcement:
        announcement = Announcement(severity, text)
        self.say(announcement)
        return announcement

    def _refuse(self, text: str, now_ns: int) -> Announcement | None:
        """Count telemetry that can't be true; the first time it is worth a word."""
        self.refused_messages += 1
        self._refusals.append(now_ns)
        self._refusal = text
        return self._complain(Severity.WARNING, f"telemetry refused: {text}") if self.refused_messages == 1 else None

    def _on_euler_attitude(self, message: Any, now_ns: int) -> AttitudeReport | RepeatedAttitude:
        return RepeatedAttitude() if self._rates.ever(_ATTITUDE_QUATERNION) else wire.attitude(message)

    def _on_obstacle_distance(self, message: Any, now_ns: int) -> Scan:
        scan = wire.obstacle_distance(message, now_ns)
        self._whole_scans = self._whole_scans or bool(scan.known.any())
        return scan

    def _on_distance_sensor(self, message: Any, now_ns: int) -> Scan | None:
        sector = None if self._whole_scans else wire.sector_distance(message)
        scan = None if sector is None else self._sectors.add(sector, now_ns)
        if scan is not None:
            self._rates.count(_OBSTACLE_DISTANCE, now_ns)
        return scan

    def _on_heartbeat(self, message: Any, now_ns: int) -> None:
        assert self.firmware is not None and self.peer is not None
        self.peer.heartbeat(now_ns)
        self.status = VehicleStatus(
            self.firmware.mode_of(message.custom_mode),
            bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED),
            message.system_status in (dialect.MAV_STATE_CRITICAL, dialect.MAV_STATE_EMERGENCY),
        )

    def _on_extended_state(self, message: Any, now_ns: int) -> None:
        firmware, on_ground = self.firmware, message.landed_state == dialect.MAV_LANDED_STATE_ON_GROUND
        assert firmware is not None
        if on_ground is not self.on_ground:
            self.on_ground = on_ground
            self.motors = Motors(spooling=on_ground and firmware.spools_on_ground, angle_boost=firmware.angle_boost)

    def _on_sys_status(self, message: Any, now_ns: int) -> None:
        bit = dialect.MAV_SYS_STATUS_PREARM_CHECK
        if message.onboard_control_sensors_present & bit:
            self._prearm_ok = bool(message.onboard_control_sensors_health & bit)

    def _on_version(self, message: Any, now_ns: int) -> None:
        self._version = message.flight_sw_version

    def _on_ack(self, message: Any, now_ns: int) -> None:
        system, component = self._encoder.system, self._encoder.component
        if message.target_system in (0, system) and message.target_component in (0, component):
            self._requests.answered(message)

    def _on_timesync(self, message: Any, now_ns: int) -> None:
        assert self.peer is not None
        if message.tc1 == 0:
            self.peer.timesync_asked(message.ts1, now_ns)
            self._send(dialect.MAVLink_timesync_message, max(now_ns, 1), message.ts1)
        else:
            self.peer.timesync_reply(message.tc1, message.ts1, now_ns)

    def _on_statustext(self, message: Any, now_ns: int) -> Announcement:
        text = wire.vehicle_text(message)
        if message.severity <= Severity.WARNING:
            self._complaint = now_ns, f" ({text})"
        return Announcement(Severity(min(message.severity, 6)), f"vehicle: {text}")

    @property
    def traffic(self) -> Traffic:
        """Counts up to now."""
        peer, bad = self.peer or Peer(0, 0), self.framer.bad_frames
        counts = peer.lost, peer.late, self.refused_messages, peer.duplicates, bad, peer.restarts, peer.reboots
        return Traffic(*counts)

    # -- what is known of the vehicle ----------------------------------------------------------------------------------

    def measured_ns(self, boot_time_ms: int, now_ns: int) -> int:
        """When telemetry with this time was measured, on the companion's clock: now while the vehicle's clock is not
        known, and no longer ago than is predicted over."""
        if self.peer is None or self.peer.offset_ns is None:
            return now_ns
        return min(max(boot_time_ms * 1_000_000 - self.peer.offset_ns, now_ns - self._longest_age_ns), now_ns)

    def report(self, now_ns: int, wanted: VehicleRequest | None, *, before_flight: bool) -> LinkReport:
        """The vehicle as it is known now, and what came of what is `wanted` of it; what a flight would lack is looked
        for `before_flight` alone."""
        heartbeat_ns = self.peer.heartbeat_age_ns(now_ns) if self.peer is not None else None
        heard_ns = self.peer.heard_ns if self.peer is not None else None
        repeated = len(self._refusals) == _REFUSALS_TOLERATED and now_ns - self._refusals[0] < _REFUSALS_NS
        return LinkReport(
            found=self.vehicle is not None,
            status=self.status,
            on_ground=self.on_ground,
            silence=0.0 if heard_ns is None else (now_ns - heard_ns) * 1e-9,
            heartbeat_age=math.inf if heartbeat_ns is None else heartbeat_ns * 1e-9,
            refused=self._refusal if repeated else None,
            complaint=self._complaint[1] if now_ns - self._complaint[0] < _COMPLAINT_NS else "",
            exhausted=self._requests.exhausted(wanted, now_ns),
            shortcoming=self._shortcoming(now_ns) if before_flight else None,
            prearm_ok=self._prearm_ok,
        )

    def _shortcoming(self, now_ns: int) -> str | None:
        """The first thing that the link lacks for a flight."""
        if self._version is None or self.firmware is None:
            return "the vehicle does not say its version (AUTOPILOT_VERSION)"
        refusal = self.firmware.refusal(self._output, self._version)
        if refusal is not None:
            return refusal
        lacking = [each for each in self._rates.lacking(now_ns) if each != _EXTENDED_STATE]
        return f"telemetry too slow: {self._rates.describe(lacking[0], now_ns)}" if lacking else None

    # -- requests in, bytes out ----------------------------------------------------------------------------------------

    def request(self, wanted: VehicleRequest | None, now_ns: int) -> None:
        """Ask the vehicle for something, and again in intervals; to be called again and again while it is wanted."""
        if wanted is None or (wanted is VehicleRequest.VERSION and self._version is not None):
            return
        assert self.vehicle is not None
        message = self._requests.ask(wanted, now_ns, self.vehicle)
        if message is not None:
            self._send(message[0], *message[1])

    def answer(self, wanted: VehicleRequest) -> CommandReport:
        """What has come of a request so far."""
        return self._requests.answer(wanted)

    def forget_mode(self) -> None:
        """The mode that was asked for is not wanted any more."""
        self._requests.forget_mode()

    def beat(self, now_ns: int, *, asks_rates: bool) -> None:
        """Once a second: the heartbeat, the question for the vehicle's clock and, if `asks_rates`, requests for the
        messages that come too slowly."""
        if now_ns < self._next_beat_ns:
            return
        self._next_beat_ns = now_ns + _SECOND_NS
        self._send(
            dialect.MAVLink_heartbeat_message,
            dialect.MAV_TYPE_ONBOARD_CONTROLLER,
            dialect.MAV_AUTOPILOT_INVALID,
            0,
            0,
            dialect.MAV_STATE_ACTIVE,
            3,
        )
        if self.peer is None:
            return
        self._send(dialect.MAVLink_timesync_message, *self.peer.timesync_request(max(now_ns, 1)))
        if not asks_rates:
            return
        lacking = self._rates.lacking(now_ns)
        for message_id in lacking:
            self._request_interval(message_id, self._rates.interval_us(message_id))
        if _OBSTACLE_DISTANCE in lacking and not self._whole_scans:
            self._request_interval(dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR, 1e6 / self._settings.rates.scan)

    def request_rates(self) -> None:
        """Ask once for all messages that a flight needs, at their rates."""
        for message_id in self._rates.wanted:
            self._request_interval(message_id, self._rates.interval_us(message_id))

    def _request_interval(self, message_id: int, interval_us: float) -> None:
        assert self.vehicle is not None
        parameters = (float(message_id), interval_us, 0.0, 0.0, 0.0, 0.0, 0.0)
        command = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
        self._send(dialect.MAVLink_command_long_message, *self.vehicle, command, 0, *parameters)

    def say(self, announcement: Announcement) -> None:
        """STATUSTEXT to the ground station, once a vehicle is there to pass it on."""
        if self.vehicle is not None:
            for fields in wire.statustext_fields(announcement.severity, announcement.text):
                self._send(dialect.MAVLink_statustext_message, *fields)

    def command(self, setpoint: Setpoint, boot_time_ms: int) -> None:
        """Send a setpoint on the layer of this flight's output."""
        assert self.vehicle is not None
        message, fields = self._encode_setpoint(setpoint, boot_time_ms, self.vehicle)
        self._send(message, *fields)

    def _send(self, message: type[Any], *fields: Any) -> None:
        self._outbox.append(self._encoder.encode_fields(message, *fields))

    def flush(self) -> bytes:
        """All that is to be sent now, as one datagram; empty if there is nothing."""
        if not self._outbox:
            return b""
        datagram = b"".join(self._outbox)
        self._outbox.clear()
        return datagram


def _needed(settings: Settings) -> dict[int, float]:
    """Rates (Hz) by message."""
    rates = settings.rates
    needed = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: rates.position, _ATTITUDE_QUATERNION: rates.attitude}
    if settings.avoidance.needs_scan:
        needed[_OBSTACLE_DISTANCE] = rates.scan
    needed[_EXTENDED_STATE] = 5.0
    return needed
