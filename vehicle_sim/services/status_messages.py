"""The messages of the vehicle's status: modes, health, battery, outputs, version."""

import math

from protocol.messages import ComponentMetadata, Encoder, ProtocolVersion, dialect
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.control_laws import Level
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Flies
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.physics.battery import BatteryState, battery_state
from vehicle_sim.services.component_metadata import GENERAL_URI
from vehicle_sim.services.sensor_messages import Senses
from vehicle_sim.services.snapshot import Snapshot, int16, int32

_GNSS, _VIO = dialect.MAV_SYS_STATUS_SENSOR_GPS, dialect.MAV_SYS_STATUS_SENSOR_VISION_POSITION
"""A vehicle has one of the two."""
_HEALTHY = (
    dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | dialect.MAV_SYS_STATUS_SENSOR_3D_MAG
    | dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | _GNSS
    | _VIO
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
_PARTS = (
    dialect.MAV_SYS_STATUS_SENSOR_3D_MAG,
    dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    _GNSS | _VIO,
    dialect.MAV_SYS_STATUS_SENSOR_PROXIMITY | dialect.MAV_SYS_STATUS_SENSOR_LASER_POSITION,
    dialect.MAV_SYS_STATUS_SENSOR_BATTERY,
    dialect.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
)
"""What can fail: magnetometer, barometer, receiver or odometry, LiDAR, battery, and what needs the position."""
_ARMABLE = dialect.MAV_SYS_STATUS_PREARM_CHECK

_CHARGE_STATES = (
    dialect.MAV_BATTERY_CHARGE_STATE_OK,
    dialect.MAV_BATTERY_CHARGE_STATE_LOW,
    dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    dialect.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
)
"""By the stage of the battery."""

_STABILIZED = dialect.MAV_MODE_FLAG_STABILIZE_ENABLED
_AUTO_FLAGS = dialect.MAV_MODE_FLAG_AUTO_ENABLED | dialect.MAV_MODE_FLAG_GUIDED_ENABLED | _STABILIZED
_BASE_MODES = {
    Flies.STICKS: dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | _STABILIZED,
    Flies.SETPOINTS: _STABILIZED,
    Flies.NOTHING: 0,
}
"""Flags of base_mode, by what is flown; those of the automatic modes otherwise."""

_NOTHING_8 = bytes(8)
_UNUSED = 65535
"""A voltage (mV) that is not told."""
_CELLS = 10
"""BATTERY_STATUS has so many of them."""


class StatusMessages:
    """Encoders, one a message."""

    def __init__(
        self,
        encoder: Encoder,
        airframe: Airframe,
        flight: FlightControl,
        senses: Senses,
        version: int,
        capabilities: int,
        metadata_crc: int,
    ) -> None:
        self._metadata_crc = metadata_crc
        self._encode = encoder.encode_fields
        self._version = version
        self._capabilities = capabilities
        self._system = encoder.system
        self._airframe = airframe
        self._flight = flight
        self._senses = senses

    def heartbeat(self, now: Snapshot) -> bytes:
        flight = self._flight
        if flight.crash is not None:
            status = dialect.MAV_STATE_EMERGENCY
        elif flight.failsafe:
            status = dialect.MAV_STATE_CRITICAL
        else:
            status = dialect.MAV_STATE_ACTIVE if flight.armed else dialect.MAV_STATE_STANDBY
        base = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | _BASE_MODES.get(flight.mode.flies, _AUTO_FLAGS)
        base |= dialect.MAV_MODE_FLAG_SAFETY_ARMED if flight.armed else 0
        return self._encode(
            dialect.MAVLink_heartbeat_message,
            dialect.MAV_TYPE_QUADROTOR,
            dialect.MAV_AUTOPILOT_PX4,
            base,
            flight.mode.custom_mode,
            status,
            3,
        )

    def sys_status(self, now: Snapshot) -> bytes:
        volts, amperes, _, remaining = self._battery(now)
        ready = self._flight.armed or self._flight.arming_problem() is None
        absent = _GNSS if self._has_odometry else _VIO
        health = (_HEALTHY | (_ARMABLE if ready else 0)) & ~self._failed & ~absent
        everything = (_HEALTHY | _ARMABLE) & ~absent
        return self._encode(
            dialect.MAVLink_sys_status_message,
            everything,
            everything,
            health,
            100,
            min(round(volts * 1e3), _UNUSED),
            int16(amperes * 100.0),
            round(remaining * 100.0),
            *(0,) * 6,
            *(0,) * 3,
        )

    @property
    def _has_odometry(self) -> bool:
        estimator = self._senses.estimator
        return isinstance(estimator, Estimator) and estimator.suite.settings.vio is not None

    @property
    def _failed(self) -> int:
        """The bits of what does not work."""
        scans, estimator = self._senses
        silent = (False,) * 3 + (scans.silent, self._flight.watch.health.drained, estimator.position_lost)
        if isinstance(estimator, Estimator):
            silent = estimator.failed + silent[3:]
        return sum(bits for bits, failed in zip(_PARTS, silent, strict=True) if failed)

    def _battery(self, now: Snapshot) -> BatteryState:
        state = battery_state(self._airframe, now.truth)
        return state._replace(remaining=0.0) if self._flight.watch.health.drained else state

    def battery_status(self, now: Snapshot) -> bytes:
        volts, amperes, used_wh, remaining = self._battery(now)
        return self._encode(
            dialect.MAVLink_battery_status_message,
            0,
            dialect.MAV_BATTERY_FUNCTION_ALL,
            dialect.MAV_BATTERY_TYPE_LIPO,
            32767,
            _as_cells(round(volts * 1e3)),
            int16(amperes * 100.0),
            int32(used_wh / volts * 1e3),
            int32(used_wh * 36.0),
            round(remaining * 100.0),
            0,
            _CHARGE_STATES[self._flight.watch.stage],
            (0,) * 4,
            0,
            0,
        )

    def extended_sys_state(self, now: Snapshot) -> bytes:
        return self._encode(dialect.MAVLink_extended_sys_state_message, 0, int(self._flight.landed_state))

    def autopilot_version(self, now: Snapshot) -> bytes:
        return self._encode(
            dialect.MAVLink_autopilot_version_message,
            self._capabilities,
            self._version,
            0,
            0,
            0,
            _NOTHING_8,
            _NOTHING_8,
            _NOTHING_8,
            0,
            0,
            self._system,
            bytes(18),
        )

    def protocol_version(self, now: Snapshot) -> bytes:
        """MAVLink 2, as PX4 says it; of which definitions is not told."""
        return self._encode(ProtocolVersion, 200, 100, 203, bytes(8), bytes(8))

    def component_metadata(self, now: Snapshot) -> bytes:
        return self._encode(ComponentMetadata, now.now_ms, self._metadata_crc, GENERAL_URI.encode())

    def attitude_target(self, now: Snapshot) -> bytes:
        """The setpoints of all levels at present, those that the control laws compute included."""
        ((level, *_, attitude, rates, _, thrust_n),) = self._flight.command.tolist()
        mask = (
            dialect.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
            if level < Level.ATTITUDE
            else dialect.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
            | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
            | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
        )
        return self._encode(
            dialect.MAVLink_attitude_target_message,
            now.now_ms,
            mask,
            attitude,
            *rates,
            min(1.0, thrust_n / self._airframe.body.max_thrust_n),
        )

    def servo_output_raw(self, now: Snapshot) -> bytes:
        """1000-2000 us for a rotor speed from 0 to that of full thrust."""
        rotors = self._airframe.rotors
        full = math.sqrt(self._airframe.body.rotor_max_thrust_n / rotors.thrust_constant_ns2)
        pulses = [round(1000.0 + 1000.0 * speed / full) for speed in now.truth.rotor_speeds]
        return self._encode(dialect.MAVLink_servo_output_raw_message, now.now_us & 0xFFFFFFFF, 0, *pulses, *(0,) * 12)


def _as_cells(millivolts: int) -> list[int]:
    """The voltage of a whole battery where those of its cells belong: what one has no room for, the next ones have."""
    cells: list[int] = []
    while len(cells) < _CELLS:
        cells.append(min(millivolts, _UNUSED - 1) if millivolts else _UNUSED)
        millivolts -= min(millivolts, _UNUSED - 1)
    return cells
