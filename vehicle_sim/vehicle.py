"""The whole vehicle as a pure step: bytes in, 4 ms of flight, bytes out. It has no clock and no socket."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from protocol.arrays import Array, Vector
from protocol.framing import Frame
from protocol.messages import Encoder, decode, dialect
from vehicle_sim.airframe import Airframe, parameters
from vehicle_sim.autopilot.control_laws import COMMAND, Level
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Mode, Severity
from vehicle_sim.estimation.delayed_truth import DelayedTruth
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.estimation.ground import RangeFinder
from vehicle_sim.failures import Failures, Unit
from vehicle_sim.physics.battery import battery_state, is_empty
from vehicle_sim.physics.integrator import work_array
from vehicle_sim.physics.motion import FEEDBACK, Motion
from vehicle_sim.physics.rigid_body import STATES
from vehicle_sim.sensors.faults import Fault
from vehicle_sim.sensors.lidar import Lidar
from vehicle_sim.sensors.suite import SensorSuite
from vehicle_sim.services.flight_commands import Actions
from vehicle_sim.services.identity import FIRST, Identity
from vehicle_sim.services.outbox import Channel
from vehicle_sim.services.parameter_store import Parameters
from vehicle_sim.services.profiles import Profile
from vehicle_sim.services.sensor_messages import Scans, Senses
from vehicle_sim.services.services import Services
from vehicle_sim.services.snapshot import Snapshot
from vehicle_sim.services.telemetry import Telemetry
from vehicle_sim.tick import COMMANDS, EXACT, advance
from vehicle_sim.timing import TICK_NS
from vehicle_sim.truth import TruthRecorder
from vehicle_sim.world import Scene, World
from vehicle_sim.world.clearance import ClearanceMonitor
from vehicle_sim.world.wind import Wind

DATAGRAM_BYTES = 1400
"""Frames are put into one datagram up to this size."""

_BATTERY_TICKS = 25
"""Between two looks at the battery."""
_SENSED_TICKS = 150
"""Until then every sensor was read and fused, a receiver's first fix after its delay, too."""
_NO_FORCE = (0.0, 0.0, 0.0)
_FURTHEST_M = 1e6
"""From the pad; further away is nothing that the local axes and the messages have room for."""


class MotionError(Exception):
    """The vehicle's motion is not to be computed any more; the message says when."""


@dataclass(frozen=True, slots=True)
class Summary:
    """How a run ended."""

    outcome: str
    """landed | crashed | stopped"""
    contacts: int
    contact_with: str | None
    least_clearance_m: float | None
    """Hull to obstacle, in the air."""
    flight_time_s: float
    released: bool
    released_at_ned: Vector | None
    simulated_s: float
    final_position_ned: Vector

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


class Vehicle:
    """A vehicle with its parcel, at first at rest on its pad (0, 0) of a world, with its nose to the north.

    It has one link from the start, the companion's, and any number of others. `lockstep`: the last frame of each tick
    to the first link is a TIMESYNC request with the tick's time, and a datagram from there that answers another tick is
    a late copy, which is ignored. `datagrams`: the bytes that come on the first link hold whole frames. `truth` records
    the true motion of every tick.
    """

    def __init__(
        self,
        airframe: Airframe,
        world: World,
        *,
        seed: int = 0,
        lockstep: bool = False,
        datagrams: bool = True,
        truth: TruthRecorder | None = None,
        identity: Identity = FIRST,
    ) -> None:
        self.airframe = airframe
        self._scene = Scene(world)
        self.world = self._scene.at(0)
        """As it is at present."""
        self._lockstep = lockstep
        self._truth = truth
        self._parameters = parameters(airframe)
        self._wind_ned: Array = self._parameters["wind_ned"][0]
        self._force_ned: Array = self._parameters["force_ned"][0]
        self._feedback = np.zeros(1, FEEDBACK)
        self._feedback["touching"] = 1.0
        self._work = work_array()
        self.state: Array = np.zeros(STATES)
        """(17,), see rigid_body."""
        self.state[2] = -airframe.rest_height_m
        self.state[6] = 1.0
        self.tick = 0
        self.answered_ns = -1
        """Time of the tick that was answered last, in lockstep."""
        self.motion = Motion.of(0, self.state, self._feedback)
        self.flight = FlightControl(airframe, self.motion)
        self.identity = identity
        self.parameters = Parameters(airframe, self.flight, identity.system)
        lidar_rng, wind_rng, *estimator_rngs = np.random.default_rng(seed).spawn(4)
        poses = deque([self.motion], maxlen=1 + round(airframe.lidar.latency_s * 1e9 / TICK_NS))
        self._scan_poses = poses
        scans = Scans(Lidar(airframe.lidar, lidar_rng), self._scene, lidar_rng)
        self.estimator = _estimator(airframe, self.motion, estimator_rngs, lambda: scans.down(poses[0]))
        self._now = Snapshot(self.motion, self.motion, self.motion)
        self._wind = Wind(world.wind, self._wind_ned, wind_rng)
        senses = Senses(scans, self.estimator)
        health = self.flight.watch.health
        health.charge, health.full_speed = airframe.battery.charge, self._parameters["rotor_max_speed"].item()
        health.commanded_speeds = self._work[COMMANDS][:4]
        running = self._parameters["rotor_running"][0]
        failures = Failures(
            _faults(senses), running, health, enabled=lambda: bool(self.flight.settings.failures_allowed)
        )
        actions = Actions(self._release, failures.inject)
        self._services = Services(identity, airframe, self.flight, self.parameters, senses, world.origin, actions)
        self.channel = self.open_channel(datagrams=datagrams)
        """The first link."""
        self._released_at_ned: Vector | None = None
        self._clearance = ClearanceMonitor(airframe.hull.radius_m)

    @property
    def time_ns(self) -> int:
        """Since boot."""
        return self.tick * TICK_NS

    # --- links ---

    @property
    def telemetry(self) -> Telemetry:
        """The streams of the first link."""
        return self.channel.telemetry

    def open_channel(self, profile: Profile = Profile.FIRST, *, datagrams: bool = True) -> Channel:
        """One link more."""
        return self._services.open_channel(profile, self.tick, self._now, datagrams=datagrams)

    def close_channel(self, channel: Channel) -> None:
        """Its peer has gone."""
        self._services.close_channel(channel)

    # --- bytes in ---

    def receive(self, data: bytes, channel: Channel | None = None) -> None:
        """Handle the bytes that came on a link, by default the first; what is damaged or unknown is ignored."""
        channel = channel or self.channel
        frames = channel.frames(data)
        if self._lockstep and channel is self.channel:
            frames = self._take_answer(frames)
        for frame in frames:
            self._services.handle(frame, channel)

    def _take_answer(self, frames: list[Frame]) -> list[Frame]:
        """The frames that are left to handle: none of an answer to another tick, else all but the TIMESYNC answer."""
        others = []
        for frame in frames:
            if frame.message_id == dialect.MAVLINK_MSG_ID_TIMESYNC:
                message = decode(frame)
                if message is not None and message.tc1 != 0:
                    if message.ts1 != self.time_ns:
                        return []
                    self.answered_ns = message.ts1
                    continue
            others.append(frame)
        return others

    # --- one tick, bytes out ---

    def advance(self) -> list[bytes]:
        """Fly one tick; returns the datagrams to send at its end on the first link."""
        self.step()
        return self.collect(self.channel)

    def step(self) -> None:
        """Fly one tick."""
        self.tick += 1
        self._wind.advance(self.state)
        command, feedback, error = self.flight.command, self._feedback, self.estimator.error
        advance(self.state, command, self._parameters, feedback, self._work, error)
        before, truth = self.motion, Motion.of(self.time_ns, self.state, self._feedback)
        if not _is_bounded(truth):
            raise MotionError(
                f"at {self.time_ns * 1e-9:.3f} s the motion is beyond all bounds: a value of the vehicle's or its "
                "world's file is too large or too small"
            )
        self.motion = truth
        if self.flight.armed and is_empty(self.airframe, truth):
            self.flight.lose_power()
        if self.tick % _BATTERY_TICKS == 0:
            self._look_at_battery(truth)
        self._scan_poses.append(truth)
        present, told = self.estimator.update(truth)
        self.flight.watch.health.position_lost = self.estimator.position_lost
        self.flight.step(present)
        if self.world.force_ned != _NO_FORCE:
            self._force_ned[:] = _NO_FORCE if self.flight.landed else self.world.force_ned
        if self._scene.world.dynamic:
            self._move_world()
        self._detect_collision(before, truth)
        if self._truth is not None:
            self._truth.record(self.time_ns, self.state, self._wind_ned)
        self._now = Snapshot(told, truth, self._scan_poses[0], tuple(self._wind_ned.tolist()))
        self._services.tell(self._now)

    def collect(self, channel: Channel) -> list[bytes]:
        """The datagrams to send on a link at the end of a tick."""
        frames = channel.take()
        frames.extend(channel.telemetry.report(self.tick, self._now))
        if self._lockstep and channel is self.channel:
            frames.append(channel.encoder.encode_fields(dialect.MAVLink_timesync_message, 0, self.time_ns))
        return _datagrams(frames)

    def _look_at_battery(self, truth: Motion) -> None:
        state, battery = battery_state(self.airframe, truth), self.airframe.battery
        self.flight.watch.health.charge = state.remaining
        if battery.drives_speed:
            self._parameters["voltage_share"] = state.volts / battery.full_v

    def _move_world(self) -> None:
        self._scene.update(self.time_ns, self.motion.position_ned)
        self.world = self._scene.at(self.time_ns)
        self._clearance.invalidate()

    def _detect_collision(self, before: Motion, now: Motion) -> None:
        if self.flight.crash is not None:
            return
        self._clearance.move(before, now)
        obstacle = None if self.flight.landed else self._clearance.collision(self.world, self.state[0:3])
        if obstacle is not None:
            self.flight.collide(obstacle)

    def _release(self) -> bool:
        """Drop the parcel; False if there is none."""
        if self._released_at_ned is not None or self.airframe.body.parcel_mass_kg == 0.0:
            return False
        self._released_at_ned = self.motion.position_ned
        self._parameters["mass_kg"] = self.flight.mass_kg = self.airframe.body.mass_kg
        return True

    # --- the result ---

    @property
    def ended(self) -> bool:
        """The vehicle was asked to shut down."""
        return self._services.ended

    @property
    def finished(self) -> bool:
        """The vehicle has flown and is disarmed on the ground again, or it has crashed."""
        flight = self.flight
        return flight.crash is not None or (flight.flown and flight.landed and not flight.armed)

    def summary(self) -> Summary:
        flight = self.flight
        outcome = "stopped"
        if flight.crash is not None:
            outcome = "crashed"
        elif self.finished:
            outcome = "landed"
        return Summary(
            outcome=outcome,
            contacts=int(flight.crash is not None),
            contact_with=flight.crash,
            least_clearance_m=self._clearance.least_m if math.isfinite(self._clearance.least_m) else None,
            flight_time_s=flight.airborne_ns * 1e-9,
            released=self._released_at_ned is not None,
            released_at_ned=self._released_at_ned,
            simulated_s=self.time_ns * 1e-9,
            final_position_ned=self.motion.position_ned,
        )


def _estimator(
    airframe: Airframe, start: Motion, rngs: list[np.random.Generator], look_down: Callable[[], tuple[int, float]]
) -> DelayedTruth | Estimator:
    """What the vehicle flies on and tells; two generators are for its sensors and its alignment."""
    delay_s, sensors = airframe.telemetry.delay_s, airframe.sensors()
    if sensors is None:
        return DelayedTruth(delay_s, start)
    sensing, alignment = rngs
    imbalance_m = airframe.unmodelled.imbalance_kg_m / airframe.takeoff_mass_kg
    lidar, finder = airframe.lidar, None
    if airframe.estimator.range_finder:
        finder = RangeFinder(look_down, lidar.rate_hz, lidar.noise_m, lidar.min_range_m)
    return Estimator(SensorSuite(sensors, start, sensing, imbalance_m), delay_s, start, alignment, finder)


def _faults(senses: Senses) -> dict[int, tuple[Fault, ...]]:
    """The failures that the vehicle's sensors can have, by the sensor."""
    scans, estimator = senses
    found: dict[int, tuple[Fault, ...]] = {Unit.LIDAR: scans.faults}
    if isinstance(estimator, Estimator):
        suite = estimator.suite
        found |= {
            Unit.MAGNETOMETER: (suite.magnetometer,),
            Unit.BAROMETER: (suite.barometer,),
            Unit.GNSS if suite.settings.vio is None else Unit.VIO: (suite.positioning,),
        }
    return found


def _is_bounded(motion: Motion) -> bool:
    """All of it is a number, and it is not too far away."""
    (north, east, down), (w, *_), (p, q, r) = motion.position_ned, motion.attitude_ned_frd, motion.rates_frd
    turning = w + p + q + r
    return north * north + east * east + down * down < _FURTHEST_M * _FURTHEST_M and turning == turning


def _datagrams(frames: list[bytes]) -> list[bytes]:
    """The frames, whole and in order, in as few datagrams as possible."""
    whole = b"".join(frames)
    if len(whole) <= DATAGRAM_BYTES:
        return [whole] if whole else []
    out: list[bytes] = []
    current = b""
    for frame in frames:
        if current and len(current) + len(frame) > DATAGRAM_BYTES:
            out.append(current)
            current = b""
        current += frame
    return [*out, current]


def warm_up(airframe: Airframe, world: World) -> None:
    """Compile all code or load it from the cache, by a vehicle that uses every level of control and every message."""
    vehicle = Vehicle(airframe, world)
    for level in Level:
        command = np.zeros(1, COMMAND)
        command["level"] = level
        command["attitude_ned_frd"] = (1.0, 0.0, 0.0, 0.0)
        advance(vehicle.state, command, vehicle._parameters, vehicle._feedback, vehicle._work, EXACT)
    world.clearance(vehicle.state[0:3])
    for message_id in vehicle.telemetry.message_ids:
        vehicle.telemetry.request(message_id)
    companion = Encoder(vehicle.identity.system, dialect.MAV_COMP_ID_ONBOARD_COMPUTER)
    for message in (
        dialect.MAVLink_timesync_message(0, 1),
        dialect.MAVLink_ping_message(0, 0, 0, 0),
        dialect.MAVLink_set_attitude_target_message(0, 0, 0, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_set_attitude_target_message(0, 0, 0, 128, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_set_actuator_control_target_message(0, 0, 0, 0, [0.0] * 8),
        dialect.MAVLink_set_position_target_local_ned_message(0, 0, 0, dialect.MAV_FRAME_BODY_NED, 0, *(0.0,) * 11),
        dialect.MAVLink_manual_control_message(0, 0, 0, 500, 0, 0),
        dialect.MAVLink_mission_request_list_message(vehicle.identity.system, 0),
        dialect.MAVLink_param_request_read_message(0, 0, b"", 0),
        dialect.MAVLink_param_request_read_message(0, 0, b"", -1),
        dialect.MAVLink_command_long_message(0, 0, dialect.MAV_CMD_NAV_LAND, 0, *(0.0,) * 7),
        dialect.MAVLink_command_int_message(0, 0, 0, dialect.MAV_CMD_NAV_LAND, 0, 0, *(0.0,) * 4, 0, 0, 0.0),
    ):
        vehicle.receive(companion.encode(message))
    vehicle.flight.sticks.update(Mode.STABILIZED, vehicle.motion, landed=True)
    vehicle.flight.announce(Severity.INFO, "warm")
    for _ in range(_SENSED_TICKS if airframe.sensors() is not None else 1):
        vehicle.advance()
