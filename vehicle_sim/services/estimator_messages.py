"""The messages of the sensors that the vehicle estimates its motion with, and of its filter."""

from protocol.messages import Encoder, dialect
from vehicle_sim.estimation.estimator import GATE, Estimator
from vehicle_sim.services.snapshot import NOTHING, Snapshot, int16
from vehicle_sim.timing import TICK_S

_SEA_LEVEL_HPA, _LAPSE, _EXPONENT = 1013.25, 2.25577e-5, 5.25588
"""The pressure at a height h (m) is p0 (1 - lapse h)^exponent: ISO 2533."""
_SEA_LEVEL_C, _LAPSE_K_M = 15.0, 0.0065
_INERTIAL, _FIELD, _PRESSURE = 0b111111, 0b111 << 6, 1 << 9 | 1 << 11 | 1 << 12
"""Bits of HIGHRES_IMU_UPDATED_FLAGS."""


class EstimatorMessages:
    """Encoders, one a message. `altitude_m`: of the local axes' origin above mean sea level."""

    def __init__(self, encoder: Encoder, estimator: Estimator, altitude_m: float) -> None:
        self._encode = encoder.encode_fields
        self._estimator = estimator
        self._altitude_m = altitude_m

    def _air(self) -> tuple[float, float, float]:
        """Altitude (m), pressure (hPa) and temperature (degrees) at the barometer."""
        altitude = self._altitude_m + self._estimator.read.height_m
        pressure = _SEA_LEVEL_HPA * max(0.0, 1.0 - _LAPSE * altitude) ** _EXPONENT
        return altitude, pressure, _SEA_LEVEL_C - _LAPSE_K_M * altitude

    def highres_imu(self, now: Snapshot) -> bytes:
        """The means over the last tick of gyroscope and accelerometer; field and pressure as they were read last."""
        read = self._estimator.read
        p, q, r, ax, ay, az = (self._estimator.suite.gained / TICK_S).tolist()
        altitude, pressure, temperature = self._air()
        updated = _INERTIAL | _FIELD * (read.field_ns == now.now_ns) | _PRESSURE * (read.height_ns == now.now_ns)
        return self._encode(
            dialect.MAVLink_highres_imu_message,
            now.now_us,
            ax,
            ay,
            az,
            p,
            q,
            r,
            *read.field_frd.tolist(),
            pressure,
            0.0,
            altitude,
            temperature,
            updated,
            0,
        )

    def scaled_pressure(self, now: Snapshot) -> bytes:
        """Nothing before the barometer has read anything."""
        if not self._estimator.read.height_ns:
            return NOTHING
        _, pressure, temperature = self._air()
        at_ms = self._estimator.read.height_ns // 1_000_000 & 0xFFFFFFFF
        return self._encode(
            dialect.MAVLink_scaled_pressure_message, at_ms, pressure, 0.0, int16(temperature * 100.0), 0
        )

    def vibration(self, now: Snapshot) -> bytes:
        """As PX4: the gyroscope's vibration is y, the accelerometer's z."""
        gyroscope, accelerometer = self._estimator.suite.vibration
        clipped = self._estimator.suite.clipped
        return self._encode(dialect.MAVLink_vibration_message, now.now_us, 0.0, gyroscope, accelerometer, *clipped)

    def estimator_status(self, now: Snapshot) -> bytes:
        """The ratios are those of innovations and gates: above 1 is refused."""
        e = self._estimator
        fix, height, field = (ratios / GATE**2 for ratios in (e.fix_ratios, e.height_ratios, e.field_ratios))
        flags = dialect.ESTIMATOR_ATTITUDE | dialect.ESTIMATOR_VELOCITY_VERT | dialect.ESTIMATOR_POS_VERT_ABS
        on_earth = e.suite.settings.gnss is not None
        if not e.position_lost:
            flags |= dialect.ESTIMATOR_VELOCITY_HORIZ
            flags |= dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_PRED_POS_HORIZ_REL
            if on_earth:
                flags |= dialect.ESTIMATOR_POS_HORIZ_ABS | dialect.ESTIMATOR_PRED_POS_HORIZ_ABS
        if on_earth and (fix > 1.0).any():
            flags |= dialect.ESTIMATOR_GPS_GLITCH
        if e.ground_m is not None:
            flags |= dialect.ESTIMATOR_POS_VERT_AGL
        return self._encode(
            dialect.MAVLink_estimator_status_message,
            now.now_us,
            flags,
            *(float(ratios.max()) ** 0.5 for ratios in (fix[3:], fix[:2], height, field)),
            0.0 if e.ground is None else e.ground.ratio**0.5 / GATE,
            0.0,
            *e.deviations,
        )
