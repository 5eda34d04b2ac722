"""Telemetry: which messages the vehicle streams, and at which intervals by default."""

from collections import deque
from collections.abc import Callable, Iterator

from protocol.messages import AvailableModes, CurrentMode, Encoder, dialect
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import LandedState, Mode
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.lidar import Lidar
from vehicle_sim.services.mode_messages import ModeMessages
from vehicle_sim.services.sensor_messages import SensorMessages
from vehicle_sim.services.snapshot import Snapshot
from vehicle_sim.services.state_messages import StateMessages
from vehicle_sim.services.status_messages import StatusMessages
from vehicle_sim.services.streams import Schedule
from vehicle_sim.timing import TICK_NS
from vehicle_sim.world import Scene

Build = Callable[[Snapshot], bytes]
"""Encodes one message."""


class Telemetry:
    """All streamed messages, as frames."""

    def __init__(
        self, encoder: Encoder, airframe: Airframe, scene: Scene, lidar: Lidar, flight: FlightControl, start: Motion
    ) -> None:
        self._flight = flight
        self._scan_poses = deque([start], maxlen=1 + round(lidar.settings.latency_s * 1e9 / TICK_NS))
        self._now = Snapshot(start, start, start)
        self._reported: tuple[Mode, bool, bool, bool] | None = None
        self._reported_landed: LandedState | None = None
        state = StateMessages(encoder, flight, scene.world.origin)
        self._status = status = StatusMessages(encoder, airframe, flight)
        self._modes = modes = ModeMessages(encoder, flight, scene.world.origin)
        sensors = SensorMessages(encoder, lidar, scene)
        scan_us = round(1e6 / lidar.settings.rate_hz)
        table: tuple[tuple[int, Build, int, int], ...] = (  # id, builder, default and least interval (us)
            (dialect.MAVLINK_MSG_ID_HEARTBEAT, status.heartbeat, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, state.attitude_quaternion, 20_000, 0),
            (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, state.local_position_ned, 20_000, 0),
            (dialect.MAVLINK_MSG_ID_ODOMETRY, state.odometry, 33_333, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE, state.attitude, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, state.global_position_int, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_GPS_RAW_INT, state.gps_raw_int, 200_000, 0),
            (dialect.MAVLINK_MSG_ID_SYS_STATUS, status.sys_status, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, status.extended_sys_state, 200_000, 0),
            (dialect.MAVLINK_MSG_ID_BATTERY_STATUS, status.battery_status, 2_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET, status.attitude_target, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, status.servo_output_raw, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_HOME_POSITION, state.home_position, 2_000_000, 0),
            (dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, state.hil_state_quaternion, 50_000, 0),
            (dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, sensors.obstacle_distance, scan_us, scan_us),
            (dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR, sensors.distance_sensor, scan_us, scan_us),
            (dialect.MAVLINK_MSG_ID_MISSION_CURRENT, modes.mission_current, 1_000_000, 0),
            (CurrentMode.id, modes.current_mode, 2_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS, modes.orbit_execution_status, 200_000, 0),
            (dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION, status.autopilot_version, 0, 0),
        )
        self._builders = {message_id: build for message_id, build, _, _ in table}
        self._schedule = Schedule({message_id: (default, least) for message_id, _, default, least in table})

    def set_interval(self, message_id: int, interval_us: int) -> bool:
        """See Schedule.set_interval."""
        return self._schedule.set_interval(message_id, interval_us)

    def interval_us(self, message_id: int) -> int:
        """See Schedule.interval_us."""
        return self._schedule.interval_us(message_id)

    @property
    def message_ids(self) -> tuple[int, ...]:
        """All messages that can be streamed or requested."""
        return tuple(self._builders)

    def request(self, message_id: int, number: int = 0) -> bytes | None:
        """One message now; None if there is no such message. `number` is that of a mode, 0 for all of them."""
        if message_id == AvailableModes.id:
            return self._modes.available_modes(number)
        build = self._builders.get(message_id)
        return None if build is None else build(self._now)

    def report(self, tick: int, estimate: Motion, truth: Motion) -> Iterator[bytes]:
        """All frames due at a tick. A change of mode, arming or landed state is reported at once, before the others."""
        self._scan_poses.append(truth)
        self._now = now = Snapshot(estimate, truth, self._scan_poses[0])
        flight = self._flight
        status = (flight.mode, flight.armed, flight.failsafe, flight.crash is not None)
        if status != self._reported:
            self._reported = status
            yield self._status.heartbeat(now)
            if self._schedule.interval_us(CurrentMode.id) > 0:
                yield self._modes.current_mode(now)
        landed = flight.landed_state
        if landed is not self._reported_landed:
            self._reported_landed = landed
            yield self._status.extended_sys_state(now)
        for message_id in self._schedule.due(tick):
            yield self._builders[message_id](now)
