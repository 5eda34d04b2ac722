"""The messages of the vehicle's motion, position and home, and the ground truth."""

import math

import numpy as np

from protocol import frames
from protocol.messages import Encoder, dialect
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.physics.motion import Motion
from vehicle_sim.services.snapshot import Snapshot, int16

_NO_COVARIANCE = (0.0,) * 21
_UNIT = (1.0, 0.0, 0.0, 0.0)


class StateMessages:
    """Encoders, one a message. `origin` is latitude, longitude (rad) and altitude (m) of the local axes' origin."""

    def __init__(self, encoder: Encoder, flight: FlightControl, origin: tuple[float, float, float]) -> None:
        self._encode = encoder.encode_fields
        self._flight = flight
        self._origin = origin

    def _geodetic(self, motion: Motion) -> tuple[int, int, int]:
        """Latitude, longitude (1e-7 degrees), altitude above mean sea level (mm)."""
        latitude, longitude, altitude = frames.to_geodetic(np.array(motion.position_ned), self._origin)
        return round(math.degrees(latitude) * 1e7), round(math.degrees(longitude) * 1e7), round(altitude * 1e3)

    def attitude_quaternion(self, now: Snapshot) -> bytes:
        m = now.estimate
        return self._encode(
            dialect.MAVLink_attitude_quaternion_message, now.estimate_ms, *m.attitude_ned_frd, *m.rates_frd, (0.0,) * 4
        )

    def attitude(self, now: Snapshot) -> bytes:
        m = now.estimate
        q0, q1, q2, q3 = m.attitude_ned_frd
        roll = math.atan2(2.0 * (q0 * q1 + q2 * q3), 1.0 - 2.0 * (q1 * q1 + q2 * q2))
        pitch = math.asin(min(1.0, max(-1.0, 2.0 * (q0 * q2 - q3 * q1))))
        return self._encode(dialect.MAVLink_attitude_message, now.estimate_ms, roll, pitch, m.yaw, *m.rates_frd)

    def local_position_ned(self, now: Snapshot) -> bytes:
        m = now.estimate
        return self._encode(
            dialect.MAVLink_local_position_ned_message, now.estimate_ms, *m.position_ned, *m.velocity_ned
        )

    def odometry(self, now: Snapshot) -> bytes:
        m = now.estimate
        return self._encode(
            dialect.MAVLink_odometry_message,
            now.estimate_us,
            dialect.MAV_FRAME_LOCAL_NED,
            dialect.MAV_FRAME_BODY_FRD,
            *m.position_ned,
            m.attitude_ned_frd,
            *m.velocity_frd,
            *m.rates_frd,
            _NO_COVARIANCE,
            _NO_COVARIANCE,
            0,
            dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT,
            100,
        )

    def global_position_int(self, now: Snapshot) -> bytes:
        m = now.estimate
        vn, ve, vd = m.velocity_ned
        return self._encode(
            dialect.MAVLink_global_position_int_message,
            now.estimate_ms,
            *self._geodetic(m),
            round((self._flight.home_ned[2] - m.position_ned[2]) * 1e3),
            int16(vn * 100.0),
            int16(ve * 100.0),
            int16(vd * 100.0),
            round(math.degrees(m.yaw) * 100.0) % 36000,
        )

    def gps_raw_int(self, now: Snapshot) -> bytes:
        m = now.estimate
        latitude, longitude, altitude_mm = self._geodetic(m)
        vn, ve, _ = m.velocity_ned
        return self._encode(
            dialect.MAVLink_gps_raw_int_message,
            now.estimate_us,
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

    def home_position(self, now: Snapshot) -> bytes:
        home = self._flight.home_ned
        at = self._geodetic(now.estimate._replace(position_ned=home))
        return self._encode(dialect.MAVLink_home_position_message, *at, *home, _UNIT, 0.0, 0.0, 0.0, now.now_us)

    def hil_state_quaternion(self, now: Snapshot) -> bytes:
        """The ground truth, for logs and for judging a flight. A companion must not fly by it."""
        m = now.truth
        ax, ay, az = m.specific_force_frd
        to_mg = 1000.0 / GRAVITY
        return self._encode(
            dialect.MAVLink_hil_state_quaternion_message,
            m.time_ns // 1000,
            m.attitude_ned_frd,
            *m.rates_frd,
            *self._geodetic(m),
            *(int16(v * 100.0) for v in m.velocity_ned),
            0,
            min(round(m.speed * 100.0), 65535),
            int16(ax * to_mg),
            int16(ay * to_mg),
            int16(az * to_mg),
        )
