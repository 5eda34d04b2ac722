"""The messages of the vehicle's motion, position and home, and the ground truth."""

import math
from collections.abc import Sequence

import numpy as np

from protocol.messages import Encoder, dialect
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.autopilot.flight_control import BOOT_NS, FlightControl
from vehicle_sim.estimation.delayed_truth import DelayedTruth
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.sensors.settings import Satellites
from vehicle_sim.services.places import Geodetic, on_earth
from vehicle_sim.services.snapshot import NOTHING, Snapshot, int16

_NO_COVARIANCE = (0.0,) * 21
_UPPER = np.triu_indices(6)
_UNIT = (1.0, 0.0, 0.0, 0.0)


class StateMessages:
    """Encoders, one a message. `origin` is latitude, longitude (rad) and altitude (m) of the local axes' origin."""

    def __init__(
        self,
        encoder: Encoder,
        flight: FlightControl,
        estimator: DelayedTruth | Estimator,
        origin: Geodetic,
    ) -> None:
        self._encode = encoder.encode_fields
        self._flight = flight
        self._estimator = estimator
        self._origin = origin

    def _geodetic(self, position_ned: Sequence[float]) -> tuple[int, int, int]:
        """Latitude, longitude (1e-7 degrees), altitude above mean sea level (mm)."""
        latitude, longitude, altitude = on_earth(position_ned, self._origin)
        return latitude, longitude, round(altitude * 1e3)

    def attitude_quaternion(self, now: Snapshot) -> bytes:
        m = now.estimate
        return self._encode(
            dialect.MAVLink_attitude_quaternion_message, now.estimate_ms, *m.attitude_ned_frd, *m.rates_frd, (0.0,) * 4
        )

    def attitude(self, now: Snapshot) -> bytes:
        m = now.estimate
        return self._encode(dialect.MAVLink_attitude_message, now.estimate_ms, *m.roll_pitch, m.yaw, *m.rates_frd)

    def local_position_ned(self, now: Snapshot) -> bytes:
        """While the position is lost, too, as PX4: ESTIMATOR_STATUS tells."""
        m = now.estimate
        return self._encode(
            dialect.MAVLink_local_position_ned_message, now.estimate_ms, *m.position_ned, *m.velocity_ned
        )

    def odometry(self, now: Snapshot) -> bytes:
        """The covariances are the filter's at present; zero for a vehicle that knows the truth."""
        m, estimator = now.estimate, self._estimator
        pose, speed = _NO_COVARIANCE, _NO_COVARIANCE
        if isinstance(estimator, Estimator):
            pose, speed = estimator.covariances[:, *_UPPER].tolist()
        return self._encode(
            dialect.MAVLink_odometry_message,
            now.estimate_us,
            dialect.MAV_FRAME_LOCAL_NED,
            dialect.MAV_FRAME_BODY_FRD,
            *m.position_ned,
            m.attitude_ned_frd,
            *m.velocity_frd,
            *m.rates_frd,
            pose,
            speed,
            estimator.reset_counter & 0xFF,
            dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT,
            0 if estimator.position_lost else 100,
        )

    def global_position_int(self, now: Snapshot) -> bytes:
        """Nothing while the position is lost, as PX4."""
        if self._estimator.position_lost:
            return NOTHING
        m = now.estimate
        vn, ve, vd = m.velocity_ned
        return self._encode(
            dialect.MAVLink_global_position_int_message,
            now.estimate_ms,
            *self._geodetic(m.position_ned),
            round((self._flight.home_ned[2] - m.position_ned[2]) * 1e3),
            int16(vn * 100.0),
            int16(ve * 100.0),
            int16(vd * 100.0),
            round(math.degrees(m.yaw) * 100.0) % 36000,
        )

    def gps_raw_int(self, now: Snapshot) -> bytes:
        """What the receiver says; of a vehicle that knows the truth, from the estimate."""
        if isinstance(self._estimator, Estimator):
            receiver = self._estimator.suite.settings.gnss
            return NOTHING if receiver is None else self._receiver(self._estimator, receiver)
        m = now.estimate
        return self._gps_raw_int(now.estimate_us, dialect.GPS_FIX_TYPE_3D_FIX, m.position_ned, m.velocity_ned, ())

    def _receiver(self, estimator: Estimator, s: Satellites) -> bytes:
        fix = estimator.read.fix
        _, _, silent = estimator.failed
        if fix is None or fix.velocity_ned is None:
            return NOTHING
        level, up = (
            math.hypot(wander.deviation, noise) * 1e3
            for wander, noise in zip((s.horizontal_error, s.vertical_error), s.position_noise, strict=True)
        )
        accuracy = round(level), round(up), round(s.velocity_noise[0] * 1e3)
        kind = dialect.GPS_FIX_TYPE_NO_FIX if silent else s.fix_type
        return self._gps_raw_int(
            fix.time_ns // 1000, kind, fix.position_ned.tolist(), fix.velocity_ned.tolist(), accuracy
        )

    def _gps_raw_int(
        self,
        time_us: int,
        fix_type: int,
        position_ned: Sequence[float],
        velocity_ned: Sequence[float],
        accuracy: tuple[int, ...],
    ) -> bytes:
        """`accuracy`: horizontal, vertical (mm) and of the speed (mm/s); none is unknown."""
        latitude, longitude, altitude_mm = self._geodetic(position_ned)
        vn, ve, _ = velocity_ned
        return self._encode(
            dialect.MAVLink_gps_raw_int_message,
            time_us,
            fix_type,
            latitude,
            longitude,
            altitude_mm,
            70,
            110,
            min(round(math.hypot(vn, ve) * 100.0), 65534),
            round(math.degrees(math.atan2(ve, vn)) * 100.0) % 36000,
            0 if fix_type == dialect.GPS_FIX_TYPE_NO_FIX else 12,
            altitude_mm,
            *(accuracy or (0, 0, 0)),
            0,
            0,
        )

    def altitude(self, now: Snapshot) -> bytes:
        """The monotonic one is the barometer's, which nothing corrects; without one it is the estimate's. The ground is
        what the filter knows of it."""
        m, above_sea = now.estimate, self._origin[2]
        local = -m.position_ned[2]
        pressure, clearance = local, None
        if isinstance(self._estimator, Estimator):
            pressure, clearance = self._estimator.read.height_m, self._estimator.ground_m
        below = math.nan if clearance is None else clearance
        return self._encode(
            dialect.MAVLink_altitude_message,
            now.estimate_us,
            above_sea + pressure,
            above_sea + local,
            local,
            local + self._flight.home_ned[2],
            above_sea + local - below,
            below,
        )

    def vfr_hud(self, now: Snapshot) -> bytes:
        """Without an airspeed sensor the airspeed is not a number, as PX4 sends it."""
        m, command = now.estimate, self._flight.command
        vn, ve, vd = m.velocity_ned
        return self._encode(
            dialect.MAVLink_vfr_hud_message,
            math.nan,
            math.hypot(vn, ve),
            round(math.degrees(m.yaw)) % 360,
            round(100.0 * min(1.0, float(command["thrust_n"][0]) / self._flight.airframe.body.max_thrust_n)),
            self._origin[2] - m.position_ned[2],
            -vd,
        )

    def system_time(self, now: Snapshot) -> bytes:
        """The time since boot; what time of what day it is nobody tells the vehicle."""
        return self._encode(dialect.MAVLink_system_time_message, 0, now.now_ms)

    def gps_global_origin(self, now: Snapshot) -> bytes:
        return self._encode(dialect.MAVLink_gps_global_origin_message, *self._geodetic((0.0, 0.0, 0.0)), now.now_us)

    def home_position(self, now: Snapshot) -> bytes:
        """Nothing until the vehicle can be armed there, as PX4, which sets it with its first position."""
        if now.now_ns < BOOT_NS:
            return NOTHING
        home = self._flight.home_ned
        at = self._geodetic(home)
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
            *self._geodetic(m.position_ned),
            *(int16(v * 100.0) for v in m.velocity_ned),
            0,
            min(round(math.dist(m.velocity_ned, now.wind_ned) * 100.0), 65535),
            int16(ax * to_mg),
            int16(ay * to_mg),
            int16(az * to_mg),
        )
