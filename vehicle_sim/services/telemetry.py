"""What the vehicle reports: every streamed message built from its motion, and when each is due."""

import heapq
import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from protocol import frames
from protocol.messages import Encoder, dialect
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.control_laws import Level
from vehicle_sim.autopilot.flight_control import FlightControl, LandedState, Mode
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.lidar import Lidar
from vehicle_sim.timing import TICK_NS
from vehicle_sim.world import Scene

_TICK_US = TICK_NS // 1000

_HEALTHY = (
    dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | dialect.MAV_SYS_STATUS_SENSOR_3D_MAG
    | dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | dialect.MAV_SYS_STATUS_SENSOR_GPS
    | dialect.MAV_SYS_STATUS_SENSOR_LASER_POSITION
    | dialect.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
    | dialect.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | dialect.MAV_SYS_STATUS_SENSOR_YAW_POSITION
    | dialect.MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
    | dialect.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
    | dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | dialect.MAV_SYS_STATUS_GEOFENCE
    | dialect.MAV_SYS_STATUS_AHRS
    | dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    | dialect.MAV_SYS_STATUS_SENSOR_PROXIMITY
)
_ARMABLE = dialect.MAV_SYS_STATUS_PREARM_CHECK

_CAPABILITIES = (
    dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | dialect.MAV_PROTOCOL_CAPABILITY_RESERVED3  # SET_ACTUATOR_TARGET, as it was called
    | dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
_VERSION = 0x010D00FF
"""1.13.0, release, as PX4 writes it: the last that takes SET_ACTUATOR_CONTROL_TARGET."""

_NOTHING_8 = bytes(8)
_FORWARD_DOWN = (  # DISTANCE_SENSOR: id, orientation, direction in the body
    (0, dialect.MAV_SENSOR_ROTATION_NONE, np.array([1.0, 0.0, 0.0])),
    (1, dialect.MAV_SENSOR_ROTATION_PITCH_270, np.array([0.0, 0.0, 1.0])),
)
_CERTAIN = (0.0,) * 21
_UNIT = (1.0, 0.0, 0.0, 0.0)
_NO_CELLS = (65535,) * 9


def _int16(value: float) -> int:
    return round(min(max(value, -32768.0), 32767.0))


@dataclass(slots=True)
class Stream:
    """One message that is sent at a rate."""

    message_id: int
    build: Callable[[], bytes]
    default_ticks: int
    least_ticks: int
    """Its source has nothing newer before that."""
    ticks: int
    """Between two; 0: off."""


class Telemetry:
    """Messages as bytes. `motion` is what is reported; of `truth`, the present, HIL_STATE_QUATERNION alone tells the
    motion, the others time, battery and rotors."""

    def __init__(
        self, encoder: Encoder, airframe: Airframe, scene: Scene, lidar: Lidar, flight: FlightControl, start: Motion
    ) -> None:
        self._encode = encoder.encode_fields
        self._airframe = airframe
        self._scene = scene
        self._lidar = lidar
        self._flight = flight
        self.motion = self.truth = start
        self._tick = 0
        self._poses = deque([start], maxlen=1 + round(lidar.settings.latency_s * 1e9 / TICK_NS))
        self._said: tuple[Mode, bool, bool, bool] | None = None
        self._said_landed: LandedState | None = None
        scan_us = round(1e6 / lidar.settings.rate_hz)
        table: list[tuple[int, Callable[[], bytes], int, int]] = [  # id, builder, default interval, least interval (us)
            (dialect.MAVLINK_MSG_ID_HEARTBEAT, self.heartbeat, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, self.attitude_quaternion, 20_000, 0),
            (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, self.local_position_ned, 20_000, 0),
            (dialect.MAVLINK_MSG_ID_ODOMETRY, self.odometry, 33_333, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE, self.attitude, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, self.global_position_int, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_GPS_RAW_INT, self.gps_raw_int, 200_000, 0),
            (dialect.MAVLINK_MSG_ID_SYS_STATUS, self.sys_status, 1_000_000, 0),
            (dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, self.extended_sys_state, 200_000, 0),
            (dialect.MAVLINK_MSG_ID_BATTERY_STATUS, self.battery_status, 2_000_000, 0),
            (dialect.MAVLINK_MSG_ID_ATTITUDE_TARGET, self.attitude_target, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, self.servo_output_raw, 100_000, 0),
            (dialect.MAVLINK_MSG_ID_HOME_POSITION, self.home_position, 2_000_000, 0),
            (dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, self.hil_state_quaternion, 50_000, 0),
            (dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, self.obstacle_distance, scan_us, scan_us),
            (dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR, self.distance_sensor, scan_us, scan_us),
            (dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION, self.autopilot_version, 0, 0),
        ]
        self._streams = {
            message_id: Stream(message_id, build, default // _TICK_US, max(1, least // _TICK_US), default // _TICK_US)
            for message_id, build, default, least in table
        }
        self._due: list[tuple[int, int]] = []  # heap of (tick, message id)
        self._reschedule()

    # --- when ---

    def set_interval(self, message_id: int, interval_us: int) -> bool:
        """-1: off, 0: the default, else rounded down to whole ticks, but not faster than its source.

        False: no such message.
        """
        stream = self._streams.get(message_id)
        if stream is None or interval_us < -1:
            return False
        if interval_us == -1:
            stream.ticks = 0
        elif interval_us == 0:
            stream.ticks = stream.default_ticks
        else:
            stream.ticks = max(stream.least_ticks, interval_us // _TICK_US)
        self._reschedule()
        return True

    def interval_us(self, message_id: int) -> int:
        """As MESSAGE_INTERVAL reports it: -1 off, 0 no such message."""
        stream = self._streams.get(message_id)
        if stream is None:
            return 0
        return stream.ticks * _TICK_US or -1

    def _reschedule(self) -> None:
        """All on common multiples, so that attitude and position of one instant travel together."""
        tick = self._tick
        self._due = [((tick // s.ticks + 1) * s.ticks, s.message_id) for s in self._streams.values() if s.ticks]
        heapq.heapify(self._due)

    def report(self, tick: int, motion: Motion, truth: Motion) -> Iterator[bytes]:
        """All frames due at a tick, after those that say a change of mode, arming or landed state at once."""
        self._tick, self.motion, self.truth = tick, motion, truth
        self._poses.append(truth)
        flight = self._flight
        said = (flight.mode, flight.armed, flight.failsafe, flight.crash is not None)
        if said != self._said:
            self._said = said
            yield self.heartbeat()
        landed = flight.landed_state
        if landed is not self._said_landed:
            self._said_landed = landed
            yield self.extended_sys_state()
        due = self._due
        while due and due[0][0] <= tick:
            message_id = due[0][1]
            stream = self._streams[message_id]
            heapq.heapreplace(due, (tick + stream.ticks, message_id))
            yield stream.build()

    @property
    def message_ids(self) -> tuple[int, ...]:
        """All that it can send."""
        return tuple(self._streams)

    def request(self, message_id: int) -> bytes | None:
        """One such message now."""
        stream = self._streams.get(message_id)
        return None if stream is None else stream.build()

    # --- what ---

    @property
    def _motion_ms(self) -> int:
        """Since boot, of the reported motion."""
        return self.motion.time_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def _motion_us(self) -> int:
        return self.motion.time_ns // 1000

    @property
    def _now_ms(self) -> int:
        return self.truth.time_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def _now_us(self) -> int:
        return self.truth.time_ns // 1000

    def heartbeat(self) -> bytes:
        flight = self._flight
        if flight.crash is not None:
            status = dialect.MAV_STATE_EMERGENCY
        elif flight.failsafe:
            status = dialect.MAV_STATE_CRITICAL
        else:
            status = dialect.MAV_STATE_ACTIVE if flight.armed else dialect.MAV_STATE_STANDBY
        base = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (dialect.MAV_MODE_FLAG_SAFETY_ARMED if flight.armed else 0)
        return self._encode(
            dialect.MAVLink_heartbeat_message,
            dialect.MAV_TYPE_QUADROTOR,
            dialect.MAV_AUTOPILOT_PX4,
            base,
            flight.mode.custom_mode,
            status,
            3,
        )

    def attitude_quaternion(self) -> bytes:
        m = self.motion
        return self._encode(
            dialect.MAVLink_attitude_quaternion_message, self._motion_ms, *m.attitude_ned_frd, *m.rates_frd, (0.0,) * 4
        )

    def attitude(self) -> bytes:
        m = self.motion
        q0, q1, q2, q3 = m.attitude_ned_frd
        roll = math.atan2(2.0 * (q0 * q1 + q2 * q3), 1.0 - 2.0 * (q1 * q1 + q2 * q2))
        pitch = math.asin(min(1.0, max(-1.0, 2.0 * (q0 * q2 - q3 * q1))))
        return self._encode(dialect.MAVLink_attitude_message, self._motion_ms, roll, pitch, m.yaw, *m.rates_frd)

    def local_position_ned(self) -> bytes:
        m = self.motion
        return self._encode(
            dialect.MAVLink_local_position_ned_message, self._motion_ms, *m.position_ned, *m.velocity_ned
        )

    def odometry(self) -> bytes:
        m = self.motion
        return self._encode(
            dialect.MAVLink_odometry_message,
            self._motion_us,
            dialect.MAV_FRAME_LOCAL_NED,
            dialect.MAV_FRAME_BODY_FRD,
            *m.position_ned,
            m.attitude_ned_frd,
            *m.velocity_frd,
            *m.rates_frd,
            _CERTAIN,
            _CERTAIN,
            0,
            dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT,
            100,
        )

    def _geodetic(self, motion: Motion) -> tuple[int, int, int]:
        """Latitude, longitude (1e-7 degrees), altitude above mean sea level (mm)."""
        latitude, longitude, altitude = frames.to_geodetic(np.array(motion.position_ned), self._scene.world.origin)
        return round(math.degrees(latitude) * 1e7), round(math.degrees(longitude) * 1e7), round(altitude * 1e3)

    def global_position_int(self) -> bytes:
        m = self.motion
        vn, ve, vd = m.velocity_ned
        return self._encode(
            dialect.MAVLink_global_position_int_message,
            self._motion_ms,
            *self._geodetic(m),
            round((self._flight.home_ned[2] - m.position_ned[2]) * 1e3),
            _int16(vn * 100.0),
            _int16(ve * 100.0),
            _int16(vd * 100.0),
            round(math.degrees(m.yaw) * 100.0) % 36000,
        )

    def gps_raw_int(self) -> bytes:
        m = self.motion
        latitude, longitude, altitude_mm = self._geodetic(m)
        vn, ve, _ = m.velocity_ned
        return self._encode(
            dialect.MAVLink_gps_raw_int_message,
            self._motion_us,
            dialect.GPS_FIX_TYPE_3D_FIX,
            latitude,
            longitude,
            altitude_mm,
            70,
            110,
            min(round(math.hypot(vn, ve) * 100.0), 65534),
            round(math.degrees(math.atan2(ve, vn)) * 100.0) % 36000,
            12,
            altitude_mm,
            0,
            0,
            0,
            0,
            0,
        )

    def _battery(self) -> tuple[float, float, float, float]:
        """Volts, amperes, watt-hours used, share left."""
        m, b = self.truth, self._airframe.battery
        used_wh = (m.shaft_energy_j / b.efficiency + b.idle_w * m.time_ns * 1e-9) / 3600.0
        left = max(0.0, 1.0 - used_wh / b.capacity_wh)
        volts = b.empty_v + (b.full_v - b.empty_v) * left
        shaft_w = (
            self._airframe.body.torque_per_thrust_m
            * self._airframe.rotors.thrust_constant_ns2
            * sum(speed**3 for speed in m.rotor_speeds)
        )
        return volts, (shaft_w / b.efficiency + b.idle_w) / volts, used_wh, left

    def sys_status(self) -> bytes:
        volts, amperes, _, left = self._battery()
        ready = self._flight.armed or self._flight.arming_problem() is None
        health = _HEALTHY | (_ARMABLE if ready else 0)
        everything = _HEALTHY | _ARMABLE
        return self._encode(
            dialect.MAVLink_sys_status_message,
            everything,
            everything,
            health,
            100,
            round(volts * 1e3),
            _int16(amperes * 100.0),
            round(left * 100.0),
            *(0,) * 6,
            *(0,) * 3,
        )

    def battery_status(self) -> bytes:
        volts, amperes, used_wh, left = self._battery()
        return self._encode(
            dialect.MAVLink_battery_status_message,
            0,
            dialect.MAV_BATTERY_FUNCTION_ALL,
            dialect.MAV_BATTERY_TYPE_LIPO,
            32767,
            (round(volts * 1e3), *_NO_CELLS),
            _int16(amperes * 100.0),
            round(used_wh / volts * 1e3),
            round(used_wh * 36.0),
            round(left * 100.0),
            0,
            dialect.MAV_BATTERY_CHARGE_STATE_OK,
            (0,) * 4,
            0,
            0,
        )

    def extended_sys_state(self) -> bytes:
        return self._encode(dialect.MAVLink_extended_sys_state_message, 0, int(self._flight.landed_state))

    def attitude_target(self) -> bytes:
        """What the control laws follow now, computed levels included."""
        ((level, _, _, _, attitude, rates, _, thrust_n),) = self._flight.command.tolist()
        mask = (
            dialect.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
            if level < Level.ATTITUDE
            else dialect.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
            | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
            | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
        )
        return self._encode(
            dialect.MAVLink_attitude_target_message,
            self._now_ms,
            mask,
            attitude,
            *rates,
            min(1.0, thrust_n / self._airframe.body.max_thrust_n),
        )

    def servo_output_raw(self) -> bytes:
        """1000-2000 us over a rotor's range of speed."""
        rotors = self._airframe.rotors
        full = math.sqrt(self._airframe.body.rotor_max_thrust_n / rotors.thrust_constant_ns2)
        pulses = [round(1000.0 + 1000.0 * speed / full) for speed in self.truth.rotor_speeds]
        return self._encode(dialect.MAVLink_servo_output_raw_message, self._now_us & 0xFFFFFFFF, 0, *pulses, *(0,) * 12)

    def home_position(self) -> bytes:
        home = self._flight.home_ned
        at = self._geodetic(self.motion._replace(position_ned=home))
        return self._encode(dialect.MAVLink_home_position_message, *at, *home, _UNIT, 0.0, 0.0, 0.0, self._now_us)

    def hil_state_quaternion(self) -> bytes:
        """The ground truth: for logs and judges, never for flying."""
        m = self.truth
        ax, ay, az = m.specific_force_frd
        to_mg = 1000.0 / GRAVITY
        return self._encode(
            dialect.MAVLink_hil_state_quaternion_message,
            m.time_ns // 1000,
            m.attitude_ned_frd,
            *m.rates_frd,
            *self._geodetic(m),
            *(_int16(v * 100.0) for v in m.velocity_ned),
            0,
            min(round(m.speed * 100.0), 65535),
            _int16(ax * to_mg),
            _int16(ay * to_mg),
            _int16(az * to_mg),
        )

    def obstacle_distance(self) -> bytes:
        """The newest scan whose age has reached the LiDAR's latency; its time is its own."""
        pose, settings = self._poses[0], self._lidar.settings
        world = self._scene.at(pose.time_ns)
        ring = self._lidar.scan(world, np.array(pose.position_ned), np.array(pose.attitude_ned_frd))
        return self._encode(
            dialect.MAVLink_obstacle_distance_message,
            pose.time_ns // 1000,
            dialect.MAV_DISTANCE_SENSOR_LASER,
            ring.tolist(),
            5,
            settings.min_range_cm,
            settings.max_range_cm,
            5.0,
            0.0,
            dialect.MAV_FRAME_BODY_FRD,
        )

    def distance_sensor(self) -> bytes:
        """Forward, then downward: two frames. Nothing within range is the maximum plus one."""
        pose, settings = self._poses[0], self._lidar.settings
        position, attitude = np.array(pose.position_ned), np.array(pose.attitude_ned_frd)
        world = self._scene.at(pose.time_ns)
        both = b""
        for number, orientation, direction in _FORWARD_DOWN:
            distance = self._lidar.beam(world, position, direction, attitude)
            near, far = settings.min_range_cm, settings.max_range_cm
            both += self._encode(
                dialect.MAVLink_distance_sensor_message,
                pose.time_ns // 1_000_000 & 0xFFFFFFFF,
                near,
                far,
                min(max(round(distance * 100.0), near), far) if math.isfinite(distance) else far + 1,
                dialect.MAV_DISTANCE_SENSOR_LASER,
                number,
                orientation,
                255,
                0.0,
                0.0,
                (0.0,) * 4,
                0,
            )
        return both

    def autopilot_version(self) -> bytes:
        return self._encode(
            dialect.MAVLink_autopilot_version_message,
            _CAPABILITIES,
            _VERSION,
            0,
            0,
            0,
            _NOTHING_8,
            _NOTHING_8,
            _NOTHING_8,
            0,
            0,
            1,
            bytes(18),
        )
