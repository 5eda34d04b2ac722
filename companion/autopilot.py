"""The autopilot: `handle(event)` -> what to send. A pure step over its own state: no clock, no socket, no file, no
chance.

datagram -> frames -> messages -> VehicleState, Scan -> mission -> reference -> avoidance -> supervisor
         -> backstepping -> thrust -> flatness -> LQR -> supervisor's gate -> messages -> datagram
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import numpy as np

from companion import trace
from companion.avoidance import methods as method
from companion.avoidance import steering as course
from companion.avoidance.guard import Guard, Verdict
from companion.avoidance.planner import PlanRequest, PlanResult
from companion.avoidance.steering import NO_WAY, Course
from companion.config import Settings
from companion.control import controller as cascade
from companion.estimate import Estimator
from companion.link import wire
from companion.link.commands import Commander
from companion.link.firmware import firmware_of
from companion.link.firmware.firmware import Firmware
from companion.link.message_rates import MessageRates
from companion.mission.altitude_search import AltitudeSearch, Place
from companion.mission.plan import Mission, Phase, Step, steps
from companion.mission.stall import Progress, Trail
from companion.perception.recent_returns import RecentReturns
from companion.perception.scans import SectorRing, obstacle_points
from companion.state import (
    Announcement,
    AvoidanceDecision,
    FlightMode,
    Output,
    Reason,
    Reference,
    Scan,
    Setpoint,
    Severity,
    VehicleState,
    VehicleStatus,
)
from companion.supervision.supervisor import FLYING, STREAMING, Health, State, Supervisor, unsound
from companion.trajectory import ReferenceGenerator, Track, track_of
from protocol.arrays import Array
from protocol.frames import yaw_of
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from protocol.peer import Peer
from protocol.vehicle_parameters import VehicleParameters

VEHICLE_COMPONENT = 1
_SECOND_NS = 1_000_000_000
_SUPERVISION_NS = 20_000_000
"""50 Hz; no time in the settings is finer."""
_REFUSALS_TOLERATED = 3
_REASON_NS = 5 * _SECOND_NS
_STEER_EVERY_NS = 15_000_000
"""At least, between two looks along the way over the map: each fourth control step. Course and guard's filter go on at
each one."""
_SLOW_AND_NEAR = 1.0
"""m and m/s: a goal that is stopped at is approached by the generator from there on, not along the map's way,"""
_NOT_NEAR = 2.0
"""until it is farther than this again."""


class Datagram(msgspec.Struct, frozen=True, gc=False):
    """Bytes arrived. `whole`: it is one datagram of a transport that keeps them apart."""

    time_ns: int
    data: bytes
    whole: bool = True


class Tick(msgspec.Struct, frozen=True, gc=False):
    """The loop's own beat, `late_ns` after it was due."""

    time_ns: int
    late_ns: int = 0


@dataclass(frozen=True, slots=True)
class Planned:
    """A question about the surroundings is answered."""

    time_ns: int
    answer: PlanResult


@dataclass(frozen=True, slots=True)
class Request:
    """The operator asks for a landing."""

    time_ns: int


@dataclass(frozen=True, slots=True)
class LogFault:
    """The flight log can't be written."""

    time_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class LogRecovered:
    """The flight log is written again."""

    time_ns: int


@dataclass(frozen=True, slots=True)
class PlannerFault:
    """There will be no more answers."""

    time_ns: int
    text: str


Event = Datagram | Tick | Planned | Request | LogFault | LogRecovered | PlannerFault


class Reaction(NamedTuple):
    """What an event led to."""

    datagram: bytes
    """To send; empty if there is nothing to say."""
    trace: bytes | None
    """The payload of a TRACE record if a control step was taken."""
    announcements: tuple[Announcement, ...]
    question: PlanRequest | None
    """What is to be answered outside of the loop."""


_NOTHING = Reaction(b"", None, (), None)


class Autopilot:
    """One flight of one mission."""

    def __init__(self, settings: Settings, body: VehicleParameters, mission: Mission, output: Output) -> None:
        self.settings = settings
        self.body = body
        self.mission = mission
        self.output = output
        self.supervisor = Supervisor(settings.supervision)
        self.step_index = 0
        self.steps: tuple[Step, ...] = ()
        self.released = False
        """The parcel is delivered."""
        self.vehicle: tuple[int, int] | None = None
        self.peer: Peer | None = None
        self.decision = AvoidanceDecision(np.zeros(3), mission.speed, math.inf, False)
        self.state: VehicleState | None = None
        self.refused_messages = 0

        self._framer = Framer()
        self._encoder = Encoder(settings.identity.system or 1, settings.identity.component)
        self._estimator = Estimator()
        self._reference = ReferenceGenerator(settings.trajectory)
        self._tracks = tuple(
            None if step.curve is None else track_of(step.curve, settings.trajectory, settings.limits.tilt)
            for step in steps(mission, np.zeros(3))
        )
        self._track: Track | None = None
        self._returns = RecentReturns(settings.avoidance.memory_s, settings.avoidance.grain)
        self._avoidance = method.choose(settings.avoidance)
        self._guard = Guard(settings.avoidance.guard) if settings.avoidance.looks_around else None
        self._plans = settings.avoidance.mapped and mission.profile != "step"
        self._question: PlanRequest | None = None
        self._asked = 0
        self._answer: PlanResult | None = None
        self._map_ns: int | None = None
        """When the ring arrived that the guard knows of; before, when it was asked for the first time."""
        self._course = Course(settings.avoidance.course)
        self._start_ned: Sequence[float] = (0.0, 0.0)
        """Where the course began (north, east) and the generator waits for its end."""
        self._wanted = np.zeros(2)
        """m/s, north and east: what the course takes up."""
        self._steer_at_ns = 0
        self._way = NO_WAY
        self._free = math.inf
        self._verdict: Verdict | None = None
        self._trail = Trail()
        self._progress = Progress()
        self._heights = AltitudeSearch(settings.avoidance.heights)
        self._gave_up = False
        self._commander = Commander(settings.supervision.command_interval)
        rates = settings.rates
        needed = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: rates.position}
        needed[dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION] = rates.attitude
        if settings.avoidance.method != "none":
            needed[dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE] = rates.scan
        needed[dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE] = 5.0
        self._rates = MessageRates(needed, rates.least_share)

        self._cascade = cascade.Controller(settings, body, output)
        self._longest_prediction_ns = round(settings.control.prediction.longest * 1e9)

        self._firmware: Firmware | None = None
        self._version: int | None = None
        self._status = VehicleStatus(FlightMode.OTHER, False, False)
        self._landed = dialect.MAV_LANDED_STATE_UNDEFINED
        self._prearm_ok: bool | None = None
        self._scan: Scan | None = None
        self._heard_ns: int | None = None
        self._scan_ns: int | None = None
        self._scan_boot_us: int | None = None
        self._sectors: SectorRing | None = SectorRing(wire.SECTORS)
        """For rings that come as sectors; None once one has come whole."""
        self._refusals: deque[int] = deque(maxlen=_REFUSALS_TOLERATED)
        self._refusal = ""
        self._unsound: str | None = None
        self._overrun_ns = 0
        self._land_requested = False
        self._log_fault: str | None = None
        self._vehicle_said = ""
        self._vehicle_said_ns = 0
        self._mode_reached = False
        self._ground_down = 0.0
        self._relinquished_ns = 0
        self._phase_since_ns = 0
        self._arrived_ns: int | None = None
        self._next_supervision_ns = 0
        self._next_beat_ns = 0
        self._outbox: list[bytes] = []
        self._announcements: list[Announcement] = []
        self._trace: bytes | None = None
        self._handlers: dict[int, Callable[[Any, int], None]] = {
            dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._on_attitude,
            dialect.MAVLINK_MSG_ID_ATTITUDE: self._on_euler_attitude,
            dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._on_position,
            dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: self._on_obstacle_distance,
            dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: self._on_distance_sensor,
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._on_extended_state,
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self._on_sys_status,
            dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._on_version,
            dialect.MAVLINK_MSG_ID_COMMAND_ACK: self._on_ack,
            dialect.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            dialect.MAVLINK_MSG_ID_STATUSTEXT: self._on_statustext,
        }

    # -- the loop ------------------------------------------------------------------------------------------------------

    def handle(self, event: Event) -> Reaction:
        """Take one event in. Raises nothing for whatever bytes come."""
        now = event.time_ns
        match event:
            case Datagram():
                self._receive(event)
            case Tick():
                if event.late_ns > self.settings.supervision.overrun * 1e9:
                    self._overrun_ns = event.late_ns
                self._look_around(now)
                if now >= self._next_supervision_ns:
                    self._next_supervision_ns = now + _SUPERVISION_NS
                    self._beat(now)
                    self._supervise(now)
            case Planned():
                self._answer = event.answer
            case Request():
                self._land_requested = True
            case LogFault():
                if self._log_fault is None:
                    self._say(Severity.CRITICAL, f"the flight log fails: {event.text}")
                self._log_fault = event.text
            case LogRecovered():
                self._log_fault = None
                self._say(Severity.NOTICE, "the flight log is written again")
            case PlannerFault():
                self._say(Severity.CRITICAL, f"no map any more: {event.text}")
        if not (self._outbox or self._announcements or self._trace or self._question):
            return _NOTHING
        reaction = Reaction(b"".join(self._outbox), self._trace, tuple(self._announcements), self._question)
        self._outbox.clear()
        self._announcements.clear()
        self._trace = self._question = None
        return reaction

    @property
    def ended(self) -> bool:
        """There is nothing more to do."""
        return self.supervisor.state is State.ENDED

    @property
    def phase(self) -> Phase:
        """Of the mission."""
        if self.supervisor.state is State.ENDED:
            return Phase.DONE
        return self.steps[self.step_index].phase if self.steps else Phase.PREPARE

    # -- telemetry -----------------------------------------------------------------------------------------------------

    def _receive(self, event: Datagram) -> None:
        frames = self._framer.datagram(event.data) if event.whole else self._framer.feed(event.data)
        now, peer, handlers, count = event.time_ns, self.peer, self._handlers, self._rates.count
        fresh_attitude = False
        for frame in frames:
            message_id = frame.message_id
            if peer is None:
                if message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT:
                    self._find(frame.system, frame.component, decode(frame))
                    peer = self.peer
                if peer is None:
                    continue
            if not peer.observe(frame, now):
                continue
            self._heard_ns = now
            count(message_id, now)
            handler = handlers.get(message_id)
            if handler is None:
                continue
            try:
                handler(decode(frame), now)
                fresh_attitude = fresh_attitude or message_id in _ATTITUDES
            except wire.RefusedError as refused:
                self.refused_messages += 1
                self._refusals.append(now)
                self._refusal = str(refused)
                if self.refused_messages == 1:
                    self._say(Severity.WARNING, f"telemetry refused: {refused}")
        if fresh_attitude:
            self.state = self._estimator.state()
            if self.state is not None:
                if self.supervisor.state is State.RELINQUISHED:
                    self._follow_along(self.state)
                self._control(self.state, now)

    def _find(self, system: int, component: int, heartbeat: Any) -> None:
        firmware = firmware_of(heartbeat.autopilot)
        if firmware is None or component != VEHICLE_COMPONENT:
            return
        self.vehicle = (system, VEHICLE_COMPONENT)
        self.peer = Peer(system, VEHICLE_COMPONENT)
        self._firmware = firmware
        self._encoder = Encoder(self.settings.identity.system or system, self.settings.identity.component)

    def _on_heartbeat(self, message: Any, now: int) -> None:
        assert self._firmware is not None and self.peer is not None
        self.peer.heartbeat(now)
        self._status = VehicleStatus(
            self._firmware.mode_of(message.custom_mode),
            bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED),
            message.system_status in (dialect.MAV_STATE_CRITICAL, dialect.MAV_STATE_EMERGENCY),
        )

    def _on_attitude(self, message: Any, now: int) -> None:
        self._boot_time(message.time_boot_ms, now)
        self._estimator.attitude(wire.attitude_quaternion(message), now)

    def _on_euler_attitude(self, message: Any, now: int) -> None:
        if self._rates.ever(dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION):
            return
        self._estimator.attitude(wire.attitude(message), now)

    def _on_position(self, message: Any, now: int) -> None:
        self._estimator.position(wire.local_position(message), now)

    def _boot_time(self, time_boot_ms: int, now: int) -> None:
        assert self.peer is not None
        if self.peer.observe_boot_time(time_boot_ms, now):
            self._estimator.restart()
            self._say(Severity.ERROR, "the vehicle has started anew")

    def _on_obstacle_distance(self, message: Any, now: int) -> None:
        scan = wire.obstacle_distance(message, now)
        if scan.known.any():
            self._sectors = None
        self._take_ring(scan, now)

    def _on_distance_sensor(self, message: Any, now: int) -> None:
        """Of a vehicle that reports its ring so, as ArduPilot does."""
        if self._sectors is None:
            return
        sector = wire.sector_distance(message)
        if sector is None:
            return
        ring = self._sectors.add(sector.sector, sector.range_m, sector.hit, sector.known, sector.boot_time_ms, now)
        if ring is not None:
            self._rates.count(dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, now)
            self._take_ring(ring, now)

    def _take_ring(self, scan: Scan, now: int) -> None:
        if not scan.known.any() or scan.boot_time_us == self._scan_boot_us:
            return  # blind, or the same ring again: it grows stale
        self._scan, self._scan_ns, self._scan_boot_us = scan, now, scan.boot_time_us

    def _look_around(self, now: int) -> None:
        """Take up what is known of the surroundings; at the tick after it came, so that no command waits for it."""
        answer, self._answer = self._answer, None
        if answer is not None:
            self._take_up(answer, now)
        scan, self._scan = self._scan, None
        if scan is None or not self.steps or self.state is None:
            return
        pose = self._estimator.pose_at(scan.boot_time_us)
        if pose is None:
            return
        ground_down = self._ground_down - self.settings.avoidance.ground_height
        state, goal, speed = self.state, self._goal_of(self.state), self._heights.slowed(self.mission.speed)
        if self._guard is not None:
            self._asked += 1
            self._map_ns = self._map_ns or now
            wanted = goal if self._plans and self.steps[self.step_index].avoids else None
            here, velocity = state.position_ned, state.velocity_ned
            self._question = PlanRequest(self._asked, now, scan, pose, ground_down, here, velocity, wanted, speed)
        if not self._plans:
            points = self._returns.add(obstacle_points(scan, *pose, ground_down), now)
            self.decision = self._avoidance.decide(points, state.position_ned, state.velocity_ned, goal, speed)

    def _goal_of(self, state: VehicleState) -> Array:
        """The present step's, at the height that is flown."""
        target = self.steps[self.step_index].target_ned
        if target is None:
            return state.position_ned
        down = self._heights.flown(float(target[2]))
        return target if down == target[2] else np.array([*target[:2], down])

    def _take_up(self, answer: PlanResult, now: int) -> None:
        """What is free, and the way; give the goal up if there has been no progress for too long."""
        assert self._guard is not None
        self._guard.look(answer.space)
        self._map_ns = answer.asked_ns
        if not self._plans or self.state is None:
            return
        step, here, goal = self.steps[self.step_index], self.state.position_ned, self._goal_of(self.state)
        self._way = answer.way
        self._steer_at_ns = now
        limit = self.decision.speed_limit if step.avoids else self.mission.speed
        target = self.decision.target_ned if step.avoids else goal
        self.decision = AvoidanceDecision(target, limit, answer.clearance, answer.blocked)
        if step.avoids and self.supervisor.state is State.FLY:
            self._trail.add(here)
            if self._heights.busy:
                self._progress = Progress()
            distance = math.hypot(*(goal - here)[:2].tolist())
            lacking = self._progress.lacking_s(self.step_index, distance, now)
            stuck = lacking > self.settings.avoidance.give_up_s
            if distance < _NOT_NEAR:
                return
            if not self._change_height(answer.way.detour, stuck, now) and stuck:
                self._give_up(self.state, now)

    def _change_height(self, detour: float, stuck: bool, now: int) -> bool:
        """To another one that is allowed, if that may help; whether there is a change."""
        target, settings = self.steps[self.step_index].target_ned, self.settings.avoidance.heights
        assert target is not None and self.state is not None
        place = Place(self.state.position_ned, float(target[2]), self._ground_down - settings.lowest)
        change = self._heights.consider(detour, stuck, place, now)
        if change is None:
            return False
        self._progress = Progress()
        self._phase_since_ns = now
        self._say(Severity.INFO, f"{change.why}: {self._ground_down - change.down:.1f} m of height")
        return True

    def _give_up(self, state: VehicleState, now: int) -> None:
        """Go home along the way flown, if that is where the mission ends and it is not tried already; else land."""
        back: list[Step] = []
        if self.mission.return_home and not self._gave_up:
            back += [Step(Phase.RETURN, place, passes=True, avoids=True) for place in self._trail.back()]
            back.append(Step(Phase.RETURN, self.steps[0].target_ned, avoids=True))
        way = "back the way it came" if back else "landing"
        text = f"no progress for {self.settings.avoidance.give_up_s:g} s: the goal is given up, {way}"
        self._gave_up = True
        self._heights.forbid()
        self.supervisor.failed(text)
        self._say(Severity.ERROR, text)
        rest = (*back, Step(Phase.LAND))
        self.steps = self.steps[: self.step_index + 1] + rest
        self._tracks = self._tracks[: self.step_index + 1] + (None,) * len(rest)
        self._next_step(state, now)

    def _on_extended_state(self, message: Any, now: int) -> None:
        self._landed = message.landed_state

    def _on_sys_status(self, message: Any, now: int) -> None:
        bit = dialect.MAV_SYS_STATUS_PREARM_CHECK
        if message.onboard_control_sensors_present & bit:
            self._prearm_ok = bool(message.onboard_control_sensors_health & bit)

    def _on_version(self, message: Any, now: int) -> None:
        self._version = message.flight_sw_version

    def _on_ack(self, message: Any, now: int) -> None:
        own = (self._encoder.system, self._encoder.component)
        if message.target_system in (0, own[0]) and message.target_component in (0, own[1]):
            self._commander.answered(message)

    def _on_timesync(self, message: Any, now: int) -> None:
        assert self.peer is not None
        if message.tc1 == 0:
            self.peer.timesync_asked(message.ts1, now)
            self._send(dialect.MAVLink_timesync_message, max(now, 1), message.ts1)
        else:
            self.peer.timesync_reply(message.tc1, message.ts1, now)

    def _on_statustext(self, message: Any, now: int) -> None:
        text = wire.vehicle_text(message)
        if message.severity <= Severity.WARNING:
            self._vehicle_said, self._vehicle_said_ns = f" ({text})", now
        self._announcements.append(Announcement(Severity(min(message.severity, 6)), f"vehicle: {text}"))

    # -- supervision ---------------------------------------------------------------------------------------------------

    def _beat(self, now: int) -> None:
        """Once a second: the heartbeat, and the clock's question."""
        if now < self._next_beat_ns:
            return
        self._next_beat_ns = now + _SECOND_NS
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
        self._send(dialect.MAVLink_timesync_message, *self.peer.timesync_request(max(now, 1)))
        if self.supervisor.state in STREAMING or self.supervisor.state is State.CHECK:
            lacking = self._rates.lacking(now)
            self._request_rates(lacking)
            if dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE in lacking and self._sectors is not None:
                sectors, interval_us = dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR, 1e6 / self.settings.rates.scan
                self._command_once(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, float(sectors), interval_us)

    def _request_rates(self, message_ids: Iterable[int]) -> None:
        for message_id in message_ids:
            interval_us = self._rates.interval_us(message_id)
            self._command_once(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), interval_us)

    def _supervise(self, now: int) -> None:
        state = self.supervisor.state
        health = self._health(now)
        announcement = self.supervisor.update(health, now)
        if announcement is not None:
            self._announcements.append(announcement)
            if self.vehicle is not None:
                for fields in wire.statustext_fields(announcement.severity, announcement.text):
                    self._send(dialect.MAVLink_statustext_message, *fields)
            self._entered(state, self.supervisor.state, now)
        self._unsound = None
        self._overrun_ns = 0
        self._ask(now)

    def _health(self, now: int) -> Health:
        settings = self.settings
        peer = self.peer
        telemetry_ns = self._estimator.age_ns(now)
        heartbeat_ns = peer.heartbeat_age_ns(now) if peer is not None else None
        ringless = settings.avoidance.method == "none"
        recent = len(self._refusals) == _REFUSALS_TOLERATED and now - self._refusals[0] < _SECOND_NS // 2
        state = self.supervisor.state
        return Health(
            seen=self.vehicle is not None,
            missing=self._missing(now) if state < State.FLY else None,
            mode=self._status.mode,
            armed=self._status.armed,
            failsafe=self._status.failsafe,
            mission_done=bool(self.steps) and self.steps[self.step_index].phase is Phase.LAND,
            silence=0.0 if self._heard_ns is None else (now - self._heard_ns) * 1e-9,
            telemetry_age=math.inf if telemetry_ns is None else telemetry_ns * 1e-9,
            heartbeat_age=math.inf if heartbeat_ns is None else heartbeat_ns * 1e-9,
            scan_age=0.0 if ringless else self._ring_age(now),
            refused_telemetry=self._refusal if recent else None,
            unsound_output=self._unsound,
            overrun=self._overrun_ns * 1e-9,
            exhausted=self._exhausted(state, now),
            land_requested=self._land_requested,
            taken_over=self._taken_over(),
            landed=self._landed == dialect.MAV_LANDED_STATE_ON_GROUND,
            overdue=self._overdue(now) if state is State.FLY else 0.0,
            reason=self._reason(now),
        )

    def _taken_over(self) -> bool:
        """The mode that is commanded was reached before, and is not the mode now."""
        wanted = _COMMANDED.get(self.supervisor.state)
        if wanted is None:
            return False
        self._mode_reached = self._mode_reached or self._status.mode is wanted
        return self._mode_reached and self._status.mode is not wanted

    def _overdue(self, now: int) -> float:
        """How much longer than it may (s) the present step takes; 0 while there is time."""
        step = self.steps[self.step_index]
        start = self.steps[self.step_index - 1].target_ned if self.step_index else None
        way = 0.0 if start is None or step.target_ned is None else math.dist(start.tolist(), step.target_ned.tolist())
        track = self._tracks[self.step_index]
        taken = step.hold_s if track is None else track.duration_s
        allowed = self.settings.supervision.step_timeout + taken + 3.0 * way / self._heights.slowed(self.mission.speed)
        return max((now - self._phase_since_ns) * 1e-9 - allowed, 0.0)

    def _reason(self, now: int) -> str:
        """What the vehicle warned of just now, to stand behind a sentence."""
        return self._vehicle_said if now - self._vehicle_said_ns < _REASON_NS else ""

    def _ring_age(self, now: int) -> float:
        """Of the last ring, and of the last one that is in the map that the guard looks at."""
        age = self._age(self._scan_ns, now)
        return age if self._map_ns is None else max(age, self._age(self._map_ns, now))

    @staticmethod
    def _age(then_ns: int | None, now: int) -> float:
        return math.inf if then_ns is None else (now - then_ns) * 1e-9

    def _missing(self, now: int) -> str | None:
        """The first requirement for the start that is not met."""
        if self._log_fault is not None:
            return f"the flight log fails ({self._log_fault})"
        if self._version is None or self._firmware is None:
            return "the vehicle does not say its version (AUTOPILOT_VERSION)"
        refusal = self._firmware.refusal(self.output, self._version)
        if refusal is not None:
            return refusal
        lacking = self._rates.lacking(now)
        if lacking:
            return f"telemetry too slow: {self._rates.describe(lacking[0], now)}"
        if self.state is None:
            return "no position and attitude"
        if self._landed != dialect.MAV_LANDED_STATE_ON_GROUND:
            return "the vehicle does not say that it stands on the ground"
        if self._prearm_ok is False:
            return f"the vehicle's own arming checks fail{self._reason(now)}"
        return None

    def _exhausted(self, state: State, now: int) -> str | None:
        asked = {State.ENGAGE: dialect.MAV_CMD_DO_SET_MODE, State.ARM: dialect.MAV_CMD_COMPONENT_ARM_DISARM}
        command = asked.get(state)
        if command is None or not self._commander.exhausted(command, self.settings.supervision.command_tries, now):
            return None
        name = "control (DO_SET_MODE)" if state is State.ENGAGE else "arming"
        return f"{name}: {self._commander.answer(command)}"

    def _entered(self, old: State, new: State, now: int) -> None:
        if old is State.FLY:
            self._leave_course(now)
            self._track = self._reference.remaining(now) or self._track
            self._reference.stop(now)
        if new is State.RELINQUISHED:
            self._relinquished_ns = now
        elif old is State.RELINQUISHED and new is State.HOLD:
            self._take_back(now)
        elif new is State.CHECK:
            self._request_rates(self._rates.wanted)
        elif new is State.STREAM:
            assert self.state is not None
            self._ground_down = float(self.state.position_ned[2])
            self._reference.place(self.state.position_ned, yaw_of(self.state.attitude_ned_frd))
            self.steps = steps(self.mission, self.state.position_ned)
            self.decision = AvoidanceDecision(self.state.position_ned, self.mission.speed, math.inf, False)
        elif new is State.FLY and old is State.ARM:
            self._phase_since_ns = now
        elif new in _COMMANDED:
            self._commander.forget(dialect.MAV_CMD_DO_SET_MODE)
            self._mode_reached = False

    def _follow_along(self, state: VehicleState) -> None:
        """Others fly: what is sent would keep the vehicle wherever it is; nothing is learnt meanwhile."""
        self._reference.place(state.position_ned, yaw_of(state.attitude_ned_frd))
        self._cascade.reset()

    def _take_back(self, now: int) -> None:
        """Brake from the present motion; the time that others flew counts for nothing."""
        state = self.state or self._estimator.state()  # after a restart its position may have come since the attitude
        assert state is not None  # the telemetry is fresh
        self._reference.carry_on(now, state.position_ned, state.velocity_ned, np.zeros(3))
        self._phase_since_ns += now - self._relinquished_ns
        self._arrived_ns = None
        self._progress = Progress()
        self._heights.begin()

    def _ask(self, now: int) -> None:
        """Keep asking the vehicle for what the state needs."""
        state = self.supervisor.state
        if state is State.CHECK and self._version is None:
            self._command(now, dialect.MAV_CMD_REQUEST_MESSAGE, float(dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION))
        elif state is State.ENGAGE:
            self._ask_mode(now, FlightMode.EXTERNAL)
        elif state is State.ARM:
            self._command(now, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        elif state in _COMMANDED and not self._mode_reached:
            self._ask_mode(now, _COMMANDED[state])

    def _ask_mode(self, now: int, mode: FlightMode) -> None:
        assert self._firmware is not None
        self._command(now, dialect.MAV_CMD_DO_SET_MODE, *self._firmware.mode_command(mode))

    def _command(self, now: int, command: int, *parameters: float) -> None:
        assert self.vehicle is not None
        message = self._commander.ask(command, parameters, now, self.vehicle)
        if message is not None:
            self._send(message[0], *message[1])

    def _command_once(self, command: int, *parameters: float) -> None:
        assert self.vehicle is not None
        padded = parameters + (0.0,) * (7 - len(parameters))
        self._send(dialect.MAVLink_command_long_message, *self.vehicle, command, 0, *padded)

    # -- flight --------------------------------------------------------------------------------------------------------

    def _control(self, state: VehicleState, now: int) -> None:
        """One control step, at each attitude."""
        supervised = self.supervisor.state
        if supervised not in STREAMING:
            return
        if supervised is State.FLY:
            self._fly(state, now)
        effective_ns, followed_ns = self._cascade.reference_times(now)
        reference, ahead = self._reference_at(effective_ns), self._reference_at(followed_ns)
        mass = self.body.mass_kg + (0.0 if self.released else self.body.parcel_mass_kg)
        airborne = supervised in FLYING and self._landed != dialect.MAV_LANDED_STATE_ON_GROUND
        acceleration = self._cascade.wish(state, now, self._measured_ns(now), reference, mass, airborne)
        self._verdict = None
        if supervised is State.FLY and airborne and self._guards():
            acceleration = self._guarded(acceleration, reference, state, now)
        changed = self._verdict is not None and self._verdict.reason is not Reason.NONE
        control, limited = self._cascade.obey(acceleration, now, ahead, mass, changed)
        if supervised not in FLYING:  # a stream that does nothing
            control[cascade.RATES] = control[cascade.TORQUE] = control[cascade.THRUST] = 0.0
            self._cascade.reset()
        values = control.tolist()
        setpoint = Setpoint(
            values[cascade.ATTITUDE], values[cascade.RATES], values[cascade.TORQUE], values[cascade.THRUST]
        )
        self._emit(setpoint, now)
        self._trace = trace.pack(
            supervised,
            self.phase,
            self.step_index,
            state,
            reference,
            control,
            limited,
            self.decision,
            self._free if self._course.active else math.inf,
            self._verdict,
        )

    def _reference_at(self, time_ns: int) -> Reference:
        """The generator's; on a course its height and heading only."""
        reference = self._reference.at(time_ns)
        if self._course.active:
            self._course.put(time_ns, reference.rows)
        return reference

    def _guards(self) -> bool:
        """The guard has the last word at this step: not on vertical ones, on tracks and where the reference jumps."""
        step = self.steps[self.step_index]
        return self.settings.avoidance.guarded and step.avoids and self.mission.profile != "step"

    def _guarded(self, acceleration_ned: Array, reference: Reference, state: VehicleState, now: int) -> Array:
        """What the guard lets through. Where it changes much, the reference gives in, or it would wind up."""
        assert self._guard is not None
        here, velocity = state.position_ned, state.velocity_ned
        verdict = self._verdict = self._guard.filter(here, velocity, acceleration_ned, now)
        allowed = verdict.acceleration_ned
        if verdict.changed > self.settings.avoidance.course.give_in:
            if self._course.active:
                self._course.give_in(here, velocity, allowed)
            else:
                place, moves = np.array([*here[:2], reference.position_ned[2]]), reference.velocity_ned[2]
                pushed = np.array([*allowed[:2], reference.acceleration_ned[2]])
                self._reference.carry_on(now, place, np.array([*velocity[:2], moves]), pushed)
        return allowed

    def _leave_course(self, now: int) -> None:
        """The generator takes the motion over, and brakes."""
        if not self._course.active:
            return
        motion = self._reference_at(now)
        self._course.stop()
        braking = self.settings.avoidance.guard.braking
        self._reference.carry_on(now, motion.position_ned, motion.velocity_ned, motion.acceleration_ned, braking)

    def _measured_ns(self, now: int) -> int:
        """When the present state was measured, on our clock: now, as long as the vehicle's clock is not known."""
        assert self.peer is not None
        if self.peer.offset_ns is None:
            return now
        measured_ns = self._estimator.boot_time_ms * 1_000_000 - self.peer.offset_ns
        return min(max(measured_ns, now - self._longest_prediction_ns), now)

    def _emit(self, setpoint: Setpoint, now: int) -> None:
        """The last gate: an unsound setpoint stays here, and the supervisor hears of it."""
        assert self.vehicle is not None
        reason = unsound(setpoint)
        if reason is not None:
            self._unsound = reason
            return
        message, fields = wire.setpoint_fields(setpoint, self.output, self._estimator.boot_time_ms, self.vehicle)
        self._send(message, *fields)

    def _fly(self, state: VehicleState, now: int) -> None:
        """Move the reference along the mission, and the mission along itself."""
        step = self.steps[self.step_index]
        if step.target_ned is not None:
            self._steer(step, state, now)
        if self._completed(step, state, now):
            self._next_step(state, now)

    def _next_step(self, state: VehicleState, now: int) -> None:
        self._heights.next_leg(stopped=not self.steps[self.step_index].passes)
        self.step_index += 1
        self._track = None
        self._phase_since_ns = self._steer_at_ns = now
        self._arrived_ns = None
        following = self.steps[self.step_index]
        self.decision = AvoidanceDecision(
            following.target_ned if following.target_ned is not None else state.position_ned,
            self.decision.speed_limit,
            self.decision.clearance,
            False,
        )
        self._say(Severity.INFO, f"{following.phase.name.lower()}, step {self.step_index + 1} of {len(self.steps)}")

    def _steer(self, step: Step, state: VehicleState, now: int) -> None:
        assert step.target_ned is not None
        if self.mission.profile == "step" and step.phase is not Phase.TAKEOFF:
            self._reference.place(step.target_ned)
            return
        if self._reference.following:
            return
        if self._plans and step.avoids and not self._arrives(step, state):
            self._steer_over_map(self._goal_of(state), state, now)
            return
        self._leave_course(now)
        settings = self.settings.trajectory
        target, speed = step.target_ned, self.mission.speed
        track = self._track_to_join(step)
        if track is not None:
            target = track.start_ned
            if track.start_yaw is not None:
                self._reference.turn(now, track.start_yaw)
        if step.avoids and not self._plans:
            target, speed = self.decision.target_ned, self.decision.speed_limit
            way = target - state.position_ned
            if math.hypot(way[0], way[1]) > 1.0:
                self._reference.turn(now, math.atan2(way[1], way[0]))
        climbs = target[2] < state.position_ned[2]
        self._reference.go(now, target, speed, settings.climb_speed if climbs else settings.descent_speed)

    def _arrives(self, step: Step, state: VehicleState) -> bool:
        """So near to a goal that is stopped at that no way over the map is needed."""
        assert step.target_ned is not None
        if step.passes:
            return False
        away = math.dist(step.target_ned.tolist()[:2], state.position_ned.tolist()[:2])
        if not self._course.active:
            return away < _NOT_NEAR
        return away < _SLOW_AND_NEAR and math.hypot(*state.velocity_ned[:2].tolist()) < _SLOW_AND_NEAR

    def _steer_over_map(self, goal: Array, state: VehicleState, now: int) -> None:
        """Move the course along the way, no faster than it can stop within what was seen free."""
        if not self._course.active:
            base = self._reference.at(now)
            self._course.start(now, base.position_ned, base.velocity_ned, base.acceleration_ned)
            self._start_ned = base.position_ned[:2].tolist()
            self._steer_at_ns = now
        if now >= self._steer_at_ns:
            self._steer_at_ns = now + _STEER_EVERY_NS
            self._wanted = self._velocity_over_map(goal, state, now)
        self._course.advance(now, self._wanted, state.position_ned[:2])

    def _velocity_over_map(self, goal: Array, state: VehicleState, now: int) -> Array:
        """(2,) What is wanted of the course; heading and height follow."""
        assert self._guard is not None
        settings, generator = self.settings.avoidance, self._reference
        here, velocity = state.position_ned, state.velocity_ned
        highest = self._heights.slowed(self.mission.speed)
        wish = course.wish(self._way, here[:2], velocity[:2], goal[:2], highest, settings.course.braking)
        wanted, speed = wish.velocity, math.hypot(*wish.velocity.tolist())
        if self._heights.busy:
            self._heights.advance(float(here[2]), math.hypot(*velocity[:2].tolist()), now)
            wanted, speed = np.zeros(2), 0.0
        limit = self._guard.limit(here, velocity, wish.places, settings.guard.delay, speed)
        self._free = limit.free
        if speed > limit.speed:
            wanted = wanted * (limit.speed / speed)
        if speed > 1.0:
            generator.turn(now, math.atan2(wish.velocity[1], wish.velocity[0]))
        down = float(goal[2])
        climbs = down < generator.at(now).position_ned[2]
        vertical_speed = self.settings.trajectory.climb_speed if climbs else self.settings.trajectory.descent_speed
        generator.go(now, np.array((*self._start_ned, down)), self.mission.speed, vertical_speed)
        target = np.array((*wish.places[0].tolist(), down))
        self.decision = AvoidanceDecision(target, limit.speed, self.decision.clearance, self.decision.blocked)
        return wanted

    def _track_to_join(self, step: Step) -> Track | None:
        """The step's, from its beginning or, after a hold, from where it was left."""
        track = self._tracks[self.step_index]
        if track is None or self._track is not None:
            return self._track
        assert step.target_ned is not None
        return track.moved(step.target_ned)

    def _completed(self, step: Step, state: VehicleState, now: int) -> bool:
        if step.phase is Phase.RELEASE:
            return self._release(now)
        if step.target_ned is None:
            return False
        if self._reference.following:
            if self._reference.rests(now):
                self._reference.leave(now)
                return True
            return False
        settings = self.settings.trajectory
        if step.passes:
            return math.dist(self._goal_of(state).tolist(), state.position_ned.tolist()) < settings.acceptance_radius
        track = self._track_to_join(step)
        target = step.target_ned if track is None else track.start_ned
        if self._arrived_ns is None:
            distance = math.dist(target.tolist(), state.position_ned.tolist())
            if (
                distance < settings.settled_distance
                and math.hypot(*state.velocity_ned.tolist()) < settings.settled_speed
            ):
                self._arrived_ns = now
        if self.mission.profile == "step" and self._arrived_ns is None:
            self._arrived_ns = now
        if track is not None:
            if self._arrived_ns is not None and self._reference.rests(now):
                self._reference.follow(now, track)
                self._arrived_ns = None
            return False
        return self._arrived_ns is not None and now - self._arrived_ns >= step.hold_s * 1e9

    def _release(self, now: int) -> bool:
        """Ask for it until it is done; go home with the parcel if it is refused."""
        command = dialect.MAV_CMD_DO_GRIPPER
        self._command(now, command, 1.0, float(dialect.GRIPPER_ACTION_RELEASE))
        if self._commander.accepted(command):
            self.released = True
            self._say(Severity.NOTICE, "parcel released")
            return True
        if self._commander.tries(command) > self.settings.supervision.command_tries:
            self._say(Severity.ERROR, f"parcel not released: {self._commander.answer(command)}")
            return True
        return False

    # -- sending -------------------------------------------------------------------------------------------------------

    def _send(self, message: type[Any], *fields: Any) -> None:
        self._outbox.append(self._encoder.encode_fields(message, *fields))

    def _say(self, severity: Severity, text: str) -> None:
        self._announcements.append(Announcement(severity, text))
        if self.vehicle is not None:
            for fields in wire.statustext_fields(severity, text):
                self._send(dialect.MAVLink_statustext_message, *fields)


_COMMANDED = {State.WITHDRAW: FlightMode.HOLD, State.LAND: FlightMode.LAND}
"""The mode that a state asks the vehicle for, until it is there once."""
_ATTITUDES = (dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, dialect.MAVLINK_MSG_ID_ATTITUDE)
