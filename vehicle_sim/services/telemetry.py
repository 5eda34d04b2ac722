"""Telemetry: which messages the vehicle streams, and at which intervals by default."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from protocol.messages import AvailableModes, ComponentMetadata, CurrentMode, Encoder, ProtocolVersion, dialect
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import LandedState, Mode
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.services.estimator_messages import EstimatorMessages
from vehicle_sim.services.link_messages import LinkMessages
from vehicle_sim.services.mode_messages import ModeMessages
from vehicle_sim.services.profiles import Profile, interval_us
from vehicle_sim.services.sensor_messages import Senses, SensorMessages
from vehicle_sim.services.snapshot import Snapshot
from vehicle_sim.services.state_messages import StateMessages
from vehicle_sim.services.status_messages import StatusMessages
from vehicle_sim.services.streams import Schedule
from vehicle_sim.services.target_messages import TargetMessages

Build = Callable[[Snapshot], bytes]
"""Encodes one message."""


Row = tuple[int, Build]
"""A message: id and builder."""


SCANS = (dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR)
"""They come no faster than the LiDAR scans."""


class Source(NamedTuple):
    """What telemetry reports on, for all links."""

    airframe: Airframe
    senses: Senses
    flight: FlightControl
    origin: tuple[float, float, float]
    version: int
    capabilities: int
    metadata_crc: int
    """Checksum of the general file of the component metadata."""


class Telemetry:
    """All messages streamed to a link, as frames. `start` is what is reported before the first tick."""

    def __init__(self, encoder: Encoder, source: Source, start: Snapshot, profile: Profile = Profile.FIRST) -> None:
        self._flight = flight = source.flight
        self._now = start
        self._reported: tuple[Mode, bool, bool, bool] | None = None
        self._reported_landed: LandedState | None = None
        state = StateMessages(encoder, flight, source.senses.estimator, source.origin)
        self._status = status = StatusMessages(
            encoder,
            source.airframe,
            flight,
            source.senses,
            source.version,
            source.capabilities,
            source.metadata_crc,
        )
        self._modes = modes = ModeMessages(encoder, flight, source.origin)
        sensors = SensorMessages(encoder, source.senses.scans)
        targets, link = TargetMessages(encoder, flight, source.origin), LinkMessages(encoder)
        table: tuple[Row, ...] = (
            (dialect.MAVLINK_MSG_ID_HEARTBEAT, status.heartbeat),
            (dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, state.attitude_quaternion),
            (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, state.local_position_ned),
            (dialect.MAVLINK_MSG_ID_ODOMETRY, state.odometry),
            (dialect.MAVLINK_MSG_ID_ATTITUDE, state.attitude),
            (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, state.global_position_int),
            (dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, state.gps_global_origin),
            (dialect.MAVLINK_MSG_ID_GPS_RAW_INT, state.gps_raw_int),
            (dialect.MAVLINK_MSG_ID_ALTITUDE, state.altitude),
            (dialect.MAVLINK_MSG_ID_VFR_HUD, state.vfr_hud),
            (dialect.MAVLINK_MSG_ID_SYSTEM_TIME, state.system_time),
            (dialect.MAVLINK_MSG_ID_SYS_STATUS, status.sys_status),
            (dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, status.extended_sys_state),
            (dialect.MAVLINK_MSG_ID_BATTERY_STATUS, status.battery_status),
            (dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET, status.attitude_target),
            (dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, status.servo_output_raw),
            (dialect.MAVLINK_MSG_ID_HOME_POSITION, state.home_position),
            (dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, state.hil_state_quaternion),
            (dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, sensors.obstacle_distance),
            (dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR, sensors.distance_sensor),
            (dialect.MAVLINK_MSG_ID_MISSION_CURRENT, modes.mission_current),
            (CurrentMode.id, modes.current_mode),
            (dialect.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS, modes.orbit_execution_status),
            (dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, targets.position_target_local_ned),
            (dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, targets.position_target_global_int),
            (dialect.MAVLINK_MSG_ID_TIMESYNC, link.timesync),
            (dialect.MAVLINK_MSG_ID_PING, link.ping),
            (dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION, status.autopilot_version),
            (ComponentMetadata.id, status.component_metadata),
            (ProtocolVersion.id, status.protocol_version),
            *_sensed(encoder, source),
        )
        self._builders = dict(table)
        least_us = dict.fromkeys(self._builders, 0) | dict.fromkeys(SCANS, round(1e6 / source.airframe.lidar.rate_hz))
        self._schedule = Schedule(
            {number: (interval_us(number, profile, least), least) for number, least in least_us.items()}
        )

    def begin(self, tick: int) -> None:
        """See Schedule.begin."""
        self._schedule.begin(tick)

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

    def report(self, tick: int, now: Snapshot) -> Iterator[bytes]:
        """All frames due at a tick. A change of mode, arming or landed state is reported at once, before the others."""
        self._now = now
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


def _sensed(encoder: Encoder, source: Source) -> tuple[Row, ...]:
    """What a vehicle that knows the truth does not have."""
    estimator = source.senses.estimator
    if not isinstance(estimator, Estimator):
        return ()
    made = EstimatorMessages(encoder, estimator, source.origin[2])
    return (
        (dialect.MAVLINK_MSG_ID_HIGHRES_IMU, made.highres_imu),
        (dialect.MAVLINK_MSG_ID_SCALED_PRESSURE, made.scaled_pressure),
        (dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS, made.estimator_status),
        (dialect.MAVLINK_MSG_ID_VIBRATION, made.vibration),
    )
