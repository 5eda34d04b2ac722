"""The vehicle at the other end of the link: datagrams in and reports out, requests in and messages into the outbox.

No I/O and no clock: time is an argument.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from companion.config import Settings
from companion.link import wire
from companion.link.candidates import VEHICLE_COMPONENT, may_be_vehicle
from companion.link.delays import Delays
from companion.link.firmware import firmware_of
from companion.link.firmware.firmware import Firmware
from companion.link.outbox import Outbox
from companion.link.readiness import Readiness
from companion.link.refusals import Refusals, RefusedError
from companion.link.requests import Requests
from companion.link.rings import DISTANCE_SENSOR, OBSTACLE_DISTANCE, RING_MESSAGES, Source
from companion.link.stamps import Stamps
from companion.link.telemetry import Telemetry
from companion.link.vehicle_status import StatusWatch
from companion.reports import (
    AttitudeReport,
    BatteryReading,
    ClockSet,
    LinkReport,
    Motors,
    Rebooted,
    RepeatedAttitude,
    Report,
)
from companion.state import Announcement, Output, Severity, VehicleRequest
from protocol.framing import Frame, Framer
from protocol.messages import decoder_of, dialect
from protocol.peer import Peer

_SECOND_NS = 1_000_000_000
_QUESTION_NS = _SECOND_NS // 10
"""Between two questions for the vehicle's clock."""

_ATTITUDE_QUATERNION = dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
_POSITION = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
_STAMPED = frozenset({_ATTITUDE_QUATERNION, _POSITION})
_HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
_SET_MODE = dialect.MAV_CMD_DO_SET_MODE


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

    def __init__(self, settings: Settings, output: Output | None, *, needs_home: bool = False) -> None:
        """`output`: None for whichever the vehicle is flown more safely on. `needs_home`: the vehicle is asked where it
        took off."""
        self.peer: Peer | None = None
        self.firmware: Firmware | None = None
        self.readiness = Readiness(settings, output)
        self.said = StatusWatch()
        self.motors = Motors()
        self.framer = Framer()
        self.telemetry = Telemetry(settings)
        self.outbox = Outbox(settings, self.readiness.output)
        self.requests = Requests(settings.supervision)
        self._settings = settings
        self._needs_home = needs_home
        self.delays = Delays(1.0 / settings.rates.attitude, settings.control.prediction)
        self._beside: list[Report] = []
        """What a message reports beside its first report."""
        self._refusals, self._stamps = Refusals(), Stamps()
        self._next_beat_ns = self._next_question_ns = 0
        self._active = False
        handlers: dict[int, Callable[[Any, int], Report | Announcement | None]] = {
            _ATTITUDE_QUATERNION: wire.attitude_quaternion,
            _POSITION: wire.local_position,
            dialect.MAVLINK_MSG_ID_ATTITUDE: self._on_euler_attitude,
            OBSTACLE_DISTANCE: self._on_ring,
            DISTANCE_SENSOR: self._on_ring,
            _HEARTBEAT: self._on_heartbeat,
            dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._on_extended_state,
            dialect.MAVLINK_MSG_ID_HOME_POSITION: self._on_home,
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self._on_sys_status,
            dialect.MAVLINK_MSG_ID_BATTERY_STATUS: wire.battery_status,
            dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self.readiness.on_estimator,
            dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self.readiness.on_estimator,
            dialect.MAVLINK_MSG_ID_PARAM_VALUE: self.readiness.on_parameter,
            dialect.MAVLINK_MSG_ID_PARAM_ERROR: self.readiness.on_parameter_error,
            dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.readiness.on_version,
            dialect.MAVLINK_MSG_ID_COMMAND_ACK: self._on_ack,
            dialect.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            dialect.MAVLINK_MSG_ID_STATUSTEXT: self.readiness.on_statustext,
        }
        if settings.rates.odometry > 0.0:
            handlers[dialect.MAVLINK_MSG_ID_ODOMETRY] = wire.odometry
        self._handlers = {message_id: (decoder_of(message_id), handler) for message_id, handler in handlers.items()}

    # -- datagrams in, reports out -------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_ns: int, *, whole: bool, sensor: bool = False) -> list[Report | Announcement]:
        """The reports of one datagram (`whole`) or of a piece of a byte stream, and what the vehicle says, in order; of
        the link of a `sensor` its scans alone.

        What is to be answered goes into the outbox. Raises nothing for any bytes.
        """
        if sensor:
            ours = self.telemetry.rings.framer.feed(data)
            return [report for frame in ours for report in self._others(frame, Source.SENSOR_LINK, now_ns)]
        frames = self.framer.datagram(data) if whole else self.framer.feed(data)
        reports: list[Report | Announcement] = []
        peer, handlers, count = self.peer, self._handlers, self.telemetry.rates.count
        for frame in frames:
            message_id = frame.message_id
            if peer is None:
                peer = self._find(frame)
            if peer is None:
                continue
            if not peer.observe(frame, now_ns):
                if message_id in RING_MESSAGES and frame.system == peer.system:
                    reports += self._others(frame, Source.COMPONENT, now_ns)
                elif message_id == _HEARTBEAT and (frame.system, frame.component) == self.outbox.own:
                    said = self.readiness.on_double(decoder_of(_HEARTBEAT)(frame), self.outbox.own, now_ns)
                    reports += (self._complain(Severity.WARNING, text) for text in said)
                continue
            count(message_id, now_ns)
            if (handling := handlers.get(message_id)) is None:
                continue
            decoder, handler = handling
            message = decoder(frame)
            if message_id in _STAMPED:
                attitude, flies = message_id == _ATTITUDE_QUATERNION, self.said.status.armed
                shows = self._stamps.take(message.time_boot_ms, now_ns, peer, of_attitude=attitude, flies=flies)
                if shows is not True:
                    said = self.readiness.on_odd_stamp(peer, now_ns)
                    reports += (self._complain(Severity.WARNING, text) for text in said)
                    if shows is False:
                        self._refusals.add("a stamp that the vehicle's clock can't have", now_ns, grave=False)
                        continue
                    reports += shows, self._on_new_clock(shows)
            try:
                report = handler(message, now_ns)
            except RefusedError as refused:
                report = self._refuse(refused, now_ns)
            if report is not None:
                reports.append(report)
        reports += self._beside
        self._beside.clear()
        return reports

    def _on_new_clock(self, shown: ClockSet | Rebooted) -> Announcement:
        self.delays.clock_changed()
        if isinstance(shown, ClockSet):
            text = f"the vehicle's clock was set by {1e-3 * shown.by_ms:.2f} s: gone along with"
            return self._complain(Severity.WARNING, text)
        self.telemetry.rates.restart()
        self.said.rebooted = True
        if not self.said.status.armed:
            assert self.firmware is not None
            self.readiness.begin(self.firmware, self.outbox.system)
        return self._complain(Severity.ERROR, "the vehicle rebooted")

    def _find(self, frame: Frame) -> Peer | None:
        """Take the sender for the vehicle if it may be."""
        heartbeat = may_be_vehicle(frame, self._settings.identity.vehicle)
        if heartbeat is None or (firmware := firmware_of(heartbeat.autopilot)) is None:
            return None
        self.outbox.address((frame.system, VEHICLE_COMPONENT))
        self.peer = Peer(frame.system, VEHICLE_COMPONENT)
        self.firmware, self.readiness.kind = firmware, heartbeat.type
        self.requests.firmware = firmware
        self.telemetry.expect(firmware)
        self.readiness.begin(firmware, self.outbox.system)
        return self.peer

    def _complain(self, severity: Severity, text: str) -> Announcement:
        announcement = Announcement(severity, text)
        self.outbox.say(announcement)
        return announcement

    def _refuse(self, refused: RefusedError, now_ns: int) -> Announcement | None:
        """Count telemetry that can't be true; the first time it is worth a word."""
        first = self._refusals.add(str(refused), now_ns, grave=refused.grave)
        return self._complain(Severity.WARNING, f"telemetry refused: {refused}") if first else None

    def _on_euler_attitude(self, message: Any, now_ns: int) -> AttitudeReport | RepeatedAttitude:
        return RepeatedAttitude() if self.telemetry.rates.ever(_ATTITUDE_QUATERNION) else wire.attitude(message)

    def _on_ring(self, message: Any, now_ns: int) -> Report | None:
        return self.telemetry.rings.take(message, Source.AUTOPILOT, self.peer, now_ns)

    def _others(self, frame: Frame, source: Source, now_ns: int) -> list[Report | Announcement]:
        """What others than the autopilot report: scans alone."""
        try:
            report: Report | Announcement | None = self.telemetry.rings.of_others(frame, source, self.peer, now_ns)
        except RefusedError as refused:
            report = self._refuse(refused, now_ns)
        return [] if report is None else [report]

    def _on_heartbeat(self, message: Any, now_ns: int) -> None:
        assert self.firmware is not None and self.peer is not None
        self.peer.heartbeat(now_ns)
        self.said.heartbeat(message, self.firmware.mode_of(message.custom_mode), self.peer, now_ns)
        self._know_motors()

    def _on_extended_state(self, message: Any, now_ns: int) -> None:
        self.said.extended_state(message, self.peer, now_ns)
        self._know_motors()

    def _know_motors(self) -> None:
        assert self.firmware is not None and self.readiness.audit is not None
        spooling = bool(self.said.on_ground) and self.firmware.spools_on_ground
        motors = Motors(spooling, self.readiness.audit.vehicle.angle_boost, self.firmware.own_loops)
        self.motors = self.motors if motors == self.motors else motors  # users ask whether they are others than before

    def _on_home(self, message: Any, now_ns: int) -> None:
        self.said.home_ned = wire.home_position(message)

    def _on_sys_status(self, message: Any, now_ns: int) -> BatteryReading:
        assert self.peer is not None
        self.readiness.on_sys_status(message, now_ns)
        scan = self.telemetry.rings.silent(message, self.peer, now_ns)
        if scan is not None:
            self._beside.append(scan)
        return wire.system_battery(message, now_ns)

    def _on_ack(self, message: Any, now_ns: int) -> None:
        if self.outbox.is_addressed(message):
            self.requests.answered(message)
            if message.command == _SET_MODE:
                self.said.mode_answered(now_ns)
            elif message.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                self.telemetry.rates.answered(message.result)

    def _on_timesync(self, message: Any, now_ns: int) -> None:
        assert self.peer is not None
        if message.tc1 == 0:
            self.peer.timesync_asked(message.ts1, now_ns)
            self.outbox.send(dialect.MAVLink_timesync_message, max(now_ns, 1), message.ts1)
        else:
            self.readiness.answers |= self.peer.timesync_reply(message.tc1, message.ts1, now_ns)
            self.delays.answered(self.peer.clock)

    @property
    def traffic(self) -> Traffic:
        """Counts up to now."""
        peer, bad = self.peer or Peer(0, 0), self.framer.bad_frames
        counts = peer.lost, peer.late, self._refusals.count, peer.duplicates, bad, peer.restarts, peer.reboots
        return Traffic(*counts)

    # -- what is known of the vehicle ----------------------------------------------------------------------------------

    @property
    def vehicle(self) -> tuple[int, int] | None:
        """(system, component), once one was found."""
        return self.outbox.vehicle

    def measured_rates(self, now_ns: int) -> str:
        """What really arrives, in words."""
        return self.telemetry.rates.measured(now_ns)

    def is_old(self, boot_time_ms: int, now_ns: int) -> bool:
        """Telemetry with this time queued up in a gap of our own: it is nothing to act on."""
        if not self.said.catching_up:
            return False
        offset_ns = None if self.peer is None else self.peer.offset_ns
        return self.said.is_old(None if offset_ns is None else boot_time_ms * 1_000_000 - offset_ns, now_ns)

    def report(self, now_ns: int, wanted: VehicleRequest | None, *, before_flight: bool) -> LinkReport:
        """The vehicle as it is known now, and what came of what is `wanted` of it; what a flight would lack is looked
        for `before_flight` alone."""
        heartbeat_ns = self.peer.heartbeat_age_ns(now_ns) if self.peer is not None else None
        heard_ns = self.peer.heard_ns if self.peer is not None else None
        too_late = self.delays.shortcoming(self._settings.supervision.longest_delay)
        exhausted, shortcoming = self.requests.exhausted(wanted, now_ns), None
        if before_flight:
            shortcoming = self.readiness.shortcoming(now_ns) or self.telemetry.shortcoming(now_ns) or too_late
        return LinkReport(
            found=self.vehicle is not None,
            status=self.said.status,
            on_ground=self.said.stands(now_ns),
            word=self.said.report(now_ns),
            home_known=self.said.home_ned is not None,
            silence=0.0 if heard_ns is None else (now_ns - heard_ns) * 1e-9,
            heartbeat_age=math.inf if heartbeat_ns is None else heartbeat_ns * 1e-9,
            refused=self._refusals.fault(now_ns) or too_late,
            exhausted=exhausted,
            complaint=self.readiness.complaint(now_ns, refused=exhausted is not None),
            refusal=self.readiness.refusal if before_flight else None,
            shortcoming=shortcoming,
            rival=self.readiness.rival(now_ns),
            prearm_ok=self.readiness.prearm_ok,
            failed_check=self.readiness.failed_check(now_ns) if before_flight else "",
            emergency=self.readiness.emergency,
            position_lost=self.readiness.position_lost,
        )

    # -- requests in, to the outbox ------------------------------------------------------------------------------------

    def request(self, wanted: VehicleRequest | None, now_ns: int) -> None:
        """Ask the vehicle for something, and again in intervals; to be called again and again while it is wanted."""
        if wanted is VehicleRequest.VERSION and self.readiness.version is not None:
            wanted = VehicleRequest.HOME if self.said.home_ned is None and self._needs_home else None
        if wanted is None:
            return
        if wanted is VehicleRequest.STATUS and self.said.catching_up:
            return  # the answer would find no room behind what has queued up
        assert self.vehicle is not None
        message = self.requests.ask(wanted, now_ns, self.vehicle)
        if message is not None:
            self.outbox.send(message[0], *message[1])
            if message[1][2:4] == (_SET_MODE, 0):  # the command, for the first time
                self.said.mode_asked(now_ns)

    def beat(self, now_ns: int, *, asks_rates: bool, active: bool = False) -> list[Announcement]:
        """Once a second: the heartbeat and, if `asks_rates`, requests for the messages that come too slowly; ten times
        a second the question for the vehicle's clock. Whenever it is called: the vehicle's parameters, until they are
        known, and a heartbeat of the vehicle's that is late; what is to be said of them. `active`: setpoints have
        begun; the next heartbeat, which says so, is sent at once."""
        said = self._go_on_with_audit(now_ns) + self.readiness.cut_short(now_ns)
        if asks_rates and self.said.is_due(self._settings.rates.heartbeat, now_ns):
            self.outbox.command(dialect.MAV_CMD_REQUEST_MESSAGE, float(_HEARTBEAT))
        if now_ns >= self._next_beat_ns or active is not self._active:
            self._next_beat_ns, self._active = now_ns + _SECOND_NS, active
            self.outbox.heartbeat(active=active)
            self._ask_for_rates(now_ns, asks_rates=asks_rates)
        if self.peer is not None and now_ns >= self._next_question_ns:
            self._next_question_ns = now_ns + _QUESTION_NS
            self.outbox.send(dialect.MAVLink_timesync_message, *self.peer.timesync_request(max(now_ns, 1)))
        return said

    def _go_on_with_audit(self, now_ns: int) -> list[Announcement]:
        audit = self.readiness.audit
        if audit is None or audit.done:
            return []
        names, said = audit.go_on(now_ns)
        self.outbox.ask_for_parameters(names)
        self.outbox.use(audit.output)
        self._know_motors()
        return said

    def _ask_for_rates(self, now_ns: int, *, asks_rates: bool) -> None:
        if self.peer is None:
            return
        self.telemetry.rates.settle()
        if asks_rates:
            self.outbox.ask_for_intervals(self.telemetry.once_more(now_ns))

    def request_rates(self) -> None:
        """Ask once for all messages that a flight needs, at their rates."""
        self.outbox.ask_for_intervals(self.telemetry.at_first())
