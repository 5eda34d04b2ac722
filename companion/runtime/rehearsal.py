"""A rehearsal: the whole mission against canned telemetry, so that nothing is compiled or met for the first time in
flight."""

import math
from collections import Counter, deque
from collections.abc import Callable

import msgspec
import numpy as np

from companion.autopilot import Autopilot
from companion.avoidance.path import NO_PATH, Path
from companion.avoidance.planner import PlanRequest, PlanResult
from companion.avoidance.steering import steer
from companion.avoidance_methods import methods_in_use
from companion.config import Settings
from companion.config_avoidance import Avoidance, AvoidanceAltitudeSearch
from companion.events import Datagram, Event, Reaction
from companion.link.audit import LONGEST_HOLD_OF_RATES_S
from companion.link.firmware.px4 import FIRMWARE as PX4
from companion.mission.plan import Delivery, Mission, Phase, Waypoint
from companion.perception.free_space import MOVER_COLUMNS, POINT_COLUMNS, FreeSpace
from companion.perception.ring_check import RingCheck
from companion.plausibility import Plausibility
from companion.plugins import PluginError
from companion.reports import AttitudeReport, PositionReport
from companion.runtime.driver import Driver
from companion.runtime.planning import InProcessPlanner, PlannerBackend, Planning
from companion.state import Output, Scan, Setpoint
from companion.supervision.states import State
from companion.trace import Thinning
from protocol.messages import Encoder, dialect
from protocol.vehicle_parameters import VehicleParameters

_TICK_NS = 4_000_000
_FLIGHT_TICK_NS = 40_000_000
"""From the take-off on: the rates of the telemetry are looked at before it."""
_LONGEST_TICKS = 50_000
_STREAMS_S = 0.1
"""For at most so long before it asks for control."""
_ON_GROUND_NS = 20_000_000
_ON_THE_WAY_NS = 1_000_000_000
"""So long the vehicle is short of the first waypoint, with obstacles before it; then it is there."""
_ON_OTHER_WAYS_NS = 200_000_000
_SHORT_OF_M = 12.0
_WAYS_OF_A_PHASE = 20
"""What a mission of hundreds of waypoints has beyond, it has had before: there the vehicle is at once."""
_EULER_UNTIL_NS = 64_000_000
"""So long the attitude comes as Euler angles, too, as a vehicle sends it that was not asked for the quaternion yet."""
_SCAN_EVERY_NS = 60_000_000
_SCANS, _SCANS_WITH_A_THING = 16, 14
"""Number of scans, and how many of them show something. It turns with the vehicle, long enough to be seen to move."""
_SCANS_WITH_A_MOVER = 4
"""How many of them show something that comes, where no map is rehearsed."""
_REHEARSED_LAPS = 0.1
_REHEARSED_RAMP_S = 0.2
_REHEARSED_REACH_M = 3.0
_OFFBOARD, _LANDING, _POSITION = 6 << 16, 4 << 16 | 6 << 24, 3 << 16
"""PX4's custom modes."""
_HOLDS_S = (1.0, LONGEST_HOLD_OF_RATES_S)
"""Times that a vehicle may follow the last setpoint: one for each output that may be chosen."""
_FREE_M = 6.0
_UNKNOWN_PARAMETER, _FLOAT = 0.0, dialect.MAV_PARAM_TYPE_REAL32
_NO_HASHES = ([0] * 8, [0] * 8, [0] * 8)


class RehearsalError(Exception):
    """The autopilot does not get through its own mission on perfect telemetry."""


class OpenField:
    """A planner that answers at once, without map or search: the way is free, and something comes along it, but not all
    the time, or the reference would never come to rest. For where both have a process of their own, which rehearses
    them."""

    ready = True
    fault: str | None = None

    def __init__(self, settings: Avoidance) -> None:
        self._map = settings.map
        self._asked: deque[PlanRequest] = deque()

    def ask(self, request: PlanRequest) -> None:
        self._asked.append(request)

    def take(self, patience_s: float) -> PlanResult | None:
        if not self._asked:
            return None
        request = self._asked.popleft()
        cell, cells, tight = self._map.cell, self._map.cells, request.number % 2 == 0
        north, east, _ = request.here.tolist()
        corner = math.floor(north / cell) - cells // 2, math.floor(east / cell) - cells // 2
        free = np.full((cells, cells), _FREE_M, np.float32)
        comes = request.number % _SCANS < _SCANS_WITH_A_MOVER
        points, movers = np.zeros((1, POINT_COLUMNS)), np.zeros((int(comes), MOVER_COLUMNS))
        points[0] = movers[:, :POINT_COLUMNS] = north + _FREE_M, east, -1.0, 0.0, 0.5
        space = FreeSpace(request.asked_ns, free, free.copy(), corner, cell, points, tight, movers)
        path = NO_PATH
        if request.goal is not None:
            path = Path(np.array((request.here[:2], request.goal[:2])), np.array((request.speed, 0.0)), tight=tight)
        return PlanResult(request.number, request.asked_ns, space, _FREE_M, path, False)

    def close(self) -> None:
        """Nothing to give back."""


def rehearse(
    settings: Settings,
    body: VehicleParameters,
    mission: Mission,
    output: Output | None,
    planner: Callable[[Avoidance], PlannerBackend] = InProcessPlanner,
) -> None:
    """Fly a vehicle that is always where it should be, on each output that may be chosen and by each method: not by all
    pairs, as neither depends on the other. Raises RehearsalError if that does not lead to the end,
    and PluginError where a law or an output of another package fails."""
    _judge()
    _follow_a_curve()
    holds_s = _HOLDS_S if output is None else _HOLDS_S[:1]
    methods = methods_in_use(settings.avoidance.method)
    for k in range(max(len(holds_s), len(methods))):
        chosen = msgspec.structs.replace(settings, avoidance=settings.avoidance.by(methods[k % len(methods)]))
        planning = Planning(planner(settings.avoidance), settings.avoidance.answer_delay)
        _fly(chosen, body, mission, output, holds_s[k % len(holds_s)], planning)


def _judge() -> None:
    """What a flight looks at and the made-up one can't pass: a reset, a ring from two places, and another one."""
    told, check, level = Plausibility(), RingCheck(), np.array((1.0, 0.0, 0.0, 0.0))
    flags, still = np.ones(72, np.bool_), np.zeros(3)
    told.watch(stands=False)
    bearings, turned = np.radians(np.arange(0.0, 360.0, 5.0)), np.array((0.0, 0.0, 0.0, 1.0))
    for ms, attitude, away in ((4, level, 3.0), (8, turned, 3.0), (12, turned, 4.0)):
        ring = Scan(0, 0, bearings, np.full(72, away), flags, flags)
        told.attitude(AttitudeReport(ms, attitude, still), ms)
        told.position(PositionReport(ms, np.array((float(ms), 0.0, 0.0)), still), ms)
        check.believes(ring, (np.array((float(ms), 0.0, 0.0)), attitude), ms)
    told.setpoint(Setpoint((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0))


def _follow_a_curve() -> None:
    """What is steered along once a mission is flown faster than it asks for."""
    start, end = np.zeros(2), np.array((5.0, 0.0))
    steer(Path(np.array((start, end)), np.array((5.0, 0.0)), smooth=True), start, start, end, 5.0, Avoidance())


def _fly(
    settings: Settings,
    body: VehicleParameters,
    mission: Mission,
    output: Output | None,
    hold_s: float,
    planning: Planning,
) -> None:
    autopilot = Autopilot(_hurried_settings(settings), body, _hurried(mission), output)
    autopilot.sensing.judges = False
    thinning = Thinning(settings.log.trace_rate)

    def thin(event: Event, reaction: Reaction) -> None:
        if reaction.trace is not None:
            thinning.step(event.time_ns, reaction.trace)

    driver = Driver(autopilot, planning, after=thin)
    vehicle = _CannedVehicle(autopilot, hold_s, settings.identity.vehicle or 1)
    now = 0
    for _ in range(_LONGEST_TICKS):
        now += _TICK_NS if autopilot.supervisor.state < State.FLY else _FLIGHT_TICK_NS
        driver.handle(Datagram(now, vehicle.telemetry(now)))
        driver.tick(now)
        if autopilot.ended:
            break
    if autopilot.own.plugin_fault is not None:
        raise PluginError(autopilot.own.plugin_fault)
    if autopilot.supervisor.fault is not None or not autopilot.ended:
        reason = autopilot.supervisor.fault or f"it does not get past {autopilot.supervisor.state.name}"
        raise RehearsalError(f"the rehearsal of {mission.name} fails: {reason}")


class _CannedVehicle:
    """Telemetry of a vehicle that is in the mode and at the place where the autopilot wants it."""

    def __init__(self, autopilot: Autopilot, hold_s: float, system: int) -> None:
        self._autopilot = autopilot
        self._parameters = {name: _UNKNOWN_PARAMETER for (name, *_) in PX4.parameters} | {PX4.hold_parameter: hold_s}
        self._encoder = Encoder(system, 1)
        self._step, self._step_began = -1, 0
        self._seen = Counter[Phase]()
        """Steps of each phase up to now."""
        self._scans_sent, self._scan_due = 0, 0

    def telemetry(self, now: int) -> bytes:
        """All messages of a time (ns)."""
        boot_ms, yaw = now // 1_000_000, 0.5 * math.sin(2.5e-9 * now)
        north, east, down = self._place(now)
        data = b""
        if now <= _EULER_UNTIL_NS:
            data += self._send(dialect.MAVLink_attitude_message, boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, 0.0)
        turned = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
        data += self._send(dialect.MAVLink_attitude_quaternion_message, boot_ms, *turned, 0.0, 0.0, 0.0)
        data += self._send(dialect.MAVLink_local_position_ned_message, boot_ms, north, east, down, 0.1, 0.0, 0.0)
        if now < self._scan_due:
            return data
        self._scan_due = now + _SCAN_EVERY_NS
        self._scans_sent += 1
        return data + self._scans(now) + self._services(now)

    def _place(self, now: int) -> list[float]:
        """At the present step's target, or for a while before it."""
        navigator, place = self._autopilot.navigator, [0.0, 0.0, 0.0]
        if self._autopilot.supervisor.state is not State.FLY or not navigator.steps:
            return place
        if navigator.step_index != self._step:
            self._step, self._step_began = navigator.step_index, now
            self._seen[navigator.phase] += 1
        if self._step == 0 and now - self._step_began < _ON_GROUND_NS:
            return place
        target = navigator.step.target_ned
        place = target.tolist() if target is not None else place
        if now - self._step_began < (_ON_THE_WAY_NS if self._step == 1 else _ON_OTHER_WAYS_NS):
            place[0] -= _SHORT_OF_M if self._seen[navigator.phase] <= _WAYS_OF_A_PHASE else 0.0
        return place

    def _scans(self, now: int) -> bytes:
        """One in sectors, and a whole one."""
        sensor = (now // 1_000_000, 20, 1500, 300, 0, 10, 0, 0, 0.0, 0.0, (0.0,) * 4, 0)
        shows = self._scans_sent % _SCANS < _SCANS_WITH_A_THING
        ranges = [300] * 4 + [1501] * 68 if shows else [1501] * 72
        scan = (now // 1000, 0, ranges, 5, 20, 1500, 5.0, 0.0, 12)
        return self._send(dialect.MAVLink_distance_sensor_message, *sensor) + self._send(
            dialect.MAVLink_obstacle_distance_message, *scan
        )

    def _services(self, now: int) -> bytes:
        """What a vehicle says of itself."""
        state, send = self._autopilot.supervisor.state, self._send
        armed = state >= State.ARM and state is not State.LAND
        mode = _LANDING if state is State.LAND else _OFFBOARD if state >= State.ENGAGE else _POSITION
        landed = dialect.MAV_LANDED_STATE_IN_AIR if state is State.FLY else dialect.MAV_LANDED_STATE_ON_GROUND
        base = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
        version = (0xFFFFFFFF, 0x010D00FF, 0, 0, 0, *_NO_HASHES, 0, 0, 0)
        return b"".join(
            (
                send(dialect.MAVLink_extended_sys_state_message, 0, landed),
                send(dialect.MAVLink_heartbeat_message, 2, dialect.MAV_AUTOPILOT_PX4, base, mode, 4, 3),
                send(dialect.MAVLink_autopilot_version_message, *version),
                send(dialect.MAVLink_command_ack_message, dialect.MAV_CMD_DO_GRIPPER, 0),
                send(dialect.MAVLink_timesync_message, 0, now),
                send(dialect.MAVLink_timesync_message, now, now),
                send(dialect.MAVLink_sys_status_message, *[0] * 13),
                *(
                    send(dialect.MAVLink_param_value_message, name.encode(), value, _FLOAT, len(self._parameters), 0)
                    for name, value in self._parameters.items()
                ),
                send(dialect.MAVLink_statustext_message, dialect.MAV_SEVERITY_INFO, b"rehearsal"),
            )
        )

    def _send(self, message: type, *fields: object) -> bytes:
        return self._encoder.encode_fields(message, *fields)


def _hurried_settings(settings: Settings) -> Settings:
    """At the route's altitudes, where the vehicle here is, without a long wait before it asks for control, and with a
    reference that does not wait for a vehicle that is never on its way."""
    avoidance = msgspec.structs.replace(settings.avoidance, altitude_search=AvoidanceAltitudeSearch())
    streams_s = min(settings.supervision.stream_before_engaging, _STREAMS_S)
    supervision = msgspec.structs.replace(settings.supervision, stream_before_engaging=streams_s)
    trajectory = msgspec.structs.replace(settings.trajectory, max_lead=math.inf)
    return msgspec.structs.replace(settings, avoidance=avoidance, supervision=supervision, trajectory=trajectory)


def _hurried(mission: Mission) -> Mission:
    """The same with short holds and short curves; one that waits for orders is ordered all that there is."""
    if mission.waits:
        ordered = [*mission.waypoints, Waypoint(_REHEARSED_REACH_M, 0.0, mission.takeoff_height)]
        low = Delivery(min(Delivery().release_height, mission.takeoff_height))
        mission = msgspec.structs.replace(mission, waits=False, waypoints=ordered, delivery=low)
    waypoints = [msgspec.structs.replace(waypoint, hold_s=min(waypoint.hold_s, 0.1)) for waypoint in mission.waypoints]
    shape = mission.trajectory
    if shape is not None:
        laps = 1.0 if shape.shape == "loop" else min(shape.laps, _REHEARSED_LAPS)
        ramp_s = min(shape.ramp_s, _REHEARSED_RAMP_S)
        shape = msgspec.structs.replace(shape, laps=laps, ramp_s=ramp_s)
    if mission.profile == "minimum_snap":
        reach = max(math.hypot(waypoint.north, waypoint.east) for waypoint in waypoints)
        scale = _REHEARSED_REACH_M / max(reach, _REHEARSED_REACH_M)
        waypoints = [
            msgspec.structs.replace(waypoint, north=scale * waypoint.north, east=scale * waypoint.east)
            for waypoint in waypoints
        ]
    return msgspec.structs.replace(mission, waypoints=waypoints, trajectory=shape)
