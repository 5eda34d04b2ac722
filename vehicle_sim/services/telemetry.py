"""Telemetry: which messages the vehicle streams, and at which intervals by default."""

from collections.abc import Callable, Iterator
from enum import Enum
from typing import NamedTuple

from protocol.messages import AvailableModes, ComponentMetadata, CurrentMode, Encoder, dialect
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import LandedState, Mode
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.services.estimator_messages import EstimatorMessages
from vehicle_sim.services.mode_messages import ModeMessages
from vehicle_sim.services.sensor_messages import Senses, SensorMessages
from vehicle_sim.services.snapshot import Snapshot
from vehicle_sim.services.state_messages import StateMessages
from vehicle_sim.services.status_messages import StatusMessages
from vehicle_sim.services.streams import Schedule

Build = Callable[[Snapshot], bytes]
"""Encodes one message."""


Row = tuple[int, Build, int, int, int]
"""A message: id, builder, and intervals (us): default onboard and on the ground, least."""


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


class Profile(Enum):
    """The default streams of a link."""

    ONBOARD = "of a companion"
    GROUND = "of a ground station: the rates of PX4's mode `normal`"


class Telemetry:
    """All messages streamed to a link, as frames. `start` is what is reported before the first tick."""

    def __init__(self, encoder: Encoder, source: Source, start: Snapshot, profile: Profile = Profile.ONBOARD) -> None:
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
        scan_us = round(1e6 / source.airframe.lidar.rate_hz)
        table: tuple[Row, ...] = (
            (dialect.MAVLINK_MSG_ID_HEARTBEAT, status.heartbeat, 1_000_000, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, state.attitude_quaternion, 20_000, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, state.local_position_ned, 20_000, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ODOMETRY, state.odometry, 33_333, 0, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE, state.attitude, 100_000, 66_667, 0),
            (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, state.global_position_int, 100_000, 200_000, 0),
            (dialect.MAVLINK_MSG_ID_GPS_RAW_INT, state.gps_raw_int, 200_000, 200_000, 0),
            (dialect.MAVLINK_MSG_ID_ALTITUDE, state.altitude, 0, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_VFR_HUD, state.vfr_hud, 0, 250_000, 0),
            (dialect.MAVLINK_MSG_ID_SYSTEM_TIME, state.system_time, 0, 0, 0),
            (dialect.MAVLINK_MSG_ID_SYS_STATUS, status.sys_status, 1_000_000, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, status.extended_sys_state, 200_000, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_BATTERY_STATUS, status.battery_status, 2_000_000, 2_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET, status.attitude_target, 100_000, 500_000, 0),
            (dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, status.servo_output_raw, 100_000, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_HOME_POSITION, state.home_position, 2_000_000, 2_000_000, 0),
            (dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, state.hil_state_quaternion, 50_000, 0, 0),
            (dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, sensors.obstacle_distance, scan_us, 1_000_000, scan_us),
            (dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR, sensors.distance_sensor, scan_us, 2_000_000, scan_us),
            (dialect.MAVLINK_MSG_ID_MISSION_CURRENT, modes.mission_current, 1_000_000, 1_000_000, 0),
            (CurrentMode.id, modes.current_mode, 2_000_000, 2_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS, modes.orbit_execution_status, 200_000, 200_000, 0),
            (dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION, status.autopilot_version, 0, 0, 0),
            (ComponentMetadata.id, status.component_metadata, 0, 0, 0),
            *_sensed(encoder, source),
        )
        self._builders = {message_id: build for message_id, build, *_ in table}
        onboard = profile is Profile.ONBOARD
        self._schedule = Schedule({row[0]: (row[2] if onboard else row[3], row[4]) for row in table})

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
        (dialect.MAVLINK_MSG_ID_HIGHRES_IMU, made.highres_imu, 0, 0, 0),
        (dialect.MAVLINK_MSG_ID_SCALED_PRESSURE, made.scaled_pressure, 0, 0, 0),
        (dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS, made.estimator_status, 0, 2_000_000, 0),
        (dialect.MAVLINK_MSG_ID_VIBRATION, made.vibration, 0, 10_000_000, 0),
    )
