"""A vehicle that sends what a flight needs, and a link that has found it."""

import math
from typing import Any

from companion.link.vehicle_link import VehicleLink
from companion.reports import Report
from companion.runtime.files import load_settings
from companion.state import Announcement, Output
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect

SETTINGS = load_settings(None, [])
MS, SECOND = 1_000_000, 1_000_000_000
NOW = 7 * SECOND
LONGEST_NS = round(SETTINGS.control.prediction.longest * 1e9)
OWN_COMPONENT = SETTINGS.identity.component
PX4, ARDUPILOT = dialect.MAV_AUTOPILOT_PX4, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
OFFBOARD = 6 << 16
"""PX4's custom mode."""


class Sender:
    """A vehicle's encoder, with the messages that a flight needs."""

    def __init__(self, system: int = 1, component: int = 1) -> None:
        self.encoder = Encoder(system, component)

    def __call__(self, message: type[Any], *fields: object) -> bytes:
        return self.encoder.encode_fields(message, *fields)

    def heartbeat(
        self, autopilot: int = PX4, mode: int = OFFBOARD, base: int = 81, state: int = 4, kind: int = 2
    ) -> bytes:
        return self(dialect.MAVLink_heartbeat_message, kind, autopilot, base, mode, state, 3)

    def quaternion(self, boot_ms: int, w: float = 1.0) -> bytes:
        return self(dialect.MAVLink_attitude_quaternion_message, boot_ms, w, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3)

    def euler(self, boot_ms: int, yaw: float = 0.0) -> bytes:
        return self(dialect.MAVLink_attitude_message, boot_ms, 0.0, 0.0, yaw, 0.1, 0.2, 0.3)

    def position(self, boot_ms: int, north: float = 1.0) -> bytes:
        return self(dialect.MAVLink_local_position_ned_message, boot_ms, north, 2.0, -3.0, 0.4, 0.5, 0.6)

    def odometry(self, boot_ms: int, variance: float = 0.01, counter: int = 0) -> bytes:
        unknown = [math.nan] * 5
        covariance = [variance, *unknown, variance, *unknown[1:], variance, *unknown, *unknown[1:]]
        fields = boot_ms * 1000, 1, 1, 1.0, 2.0, -3.0, [1.0, 0.0, 0.0, 0.0], 0.4, 0.5, 0.6, 0.1, 0.2, 0.3
        kind = dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT
        return self(dialect.MAVLink_odometry_message, *fields, covariance, covariance, counter, kind, 0)

    def scan(self, boot_ms: int, cm: int = 500) -> bytes:
        return self(dialect.MAVLink_obstacle_distance_message, boot_ms * 1000, 0, [cm] * 72, 5, 20, 1500, 5.0, 0.0, 12)

    def sector(self, boot_ms: int, sector: int, cm: int = 500, quality: int = 0) -> bytes:
        fields = boot_ms, 20, 1500, cm, 0, 10 + sector, sector, 0, 0.0, 0.0, (0.0,) * 4, quality
        return self(dialect.MAVLink_distance_sensor_message, *fields)

    def text(self, severity: int, text: bytes, number: int = 0, piece: int = 0) -> bytes:
        return self(dialect.MAVLink_statustext_message, severity, text, number, piece)

    def ack(self, command: int, result: int, system: int = 0, component: int = 0) -> bytes:
        return self(dialect.MAVLink_command_ack_message, command, result, 0, 0, system, component)

    def version(self, major: int, minor: int) -> bytes:
        number = major << 24 | minor << 16 | 0xFF
        hashes = [0] * 8
        return self(
            dialect.MAVLink_autopilot_version_message, 0xFFFFFFFF, number, 0, 0, 0, hashes, hashes, hashes, 0, 0, 0
        )

    def timesync(self, tc1: int, ts1: int) -> bytes:
        return self(dialect.MAVLink_timesync_message, tc1, ts1)

    def parameter(self, name: str, value: float, kind: int = dialect.MAV_PARAM_TYPE_REAL32) -> bytes:
        """`value` as it stands in the message."""
        return self(dialect.MAVLink_param_value_message, name.encode(), value, kind, 1, 0)

    def parameter_error(self, name: str, system: int = 1, component: int = OWN_COMPONENT) -> bytes:
        error = dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST
        return self(dialect.MAVLink_param_error_message, system, component, name.encode(), -1, error)

    def extended_state(self, landed: int) -> bytes:
        return self(dialect.MAVLink_extended_sys_state_message, 0, landed)


def hear(link: VehicleLink, data: bytes, now: int = NOW) -> list[Report | Announcement]:
    """All reports of a datagram."""
    return list(link.receive(data, now, whole=True))


SOUND = {PX4: {"COM_OF_LOSS_T": 1.0, "COM_DISARM_LAND": 2.0}, ARDUPILOT: {"GUID_OPTIONS": 8.0, "GUID_TIMEOUT": 1.0}}
"""Parameters with which a vehicle is flown; those that are left out are 0."""


def found(
    output: Output | None = Output.RATES, overrides: tuple[str, ...] = (), autopilot: int = PX4
) -> tuple[VehicleLink, Sender]:
    """A link that has found its vehicle at `NOW` and knows its parameters, and that vehicle."""
    link, vehicle = VehicleLink(load_settings(None, list(overrides)), output), Sender()
    assert hear(link, vehicle.heartbeat(autopilot)) == []
    audit = link.readiness.audit
    assert audit is not None and link.firmware is not None
    for name, *_ in link.firmware.parameters:
        assert hear(link, vehicle.parameter(name, SOUND[autopilot].get(name, 0.0))) == []
    audit.go_on(NOW)
    assert audit.done
    return link, vehicle


def sent(link: VehicleLink) -> list[Any]:
    """The messages that the link sends now."""
    return [decode(frame) for frame in Framer().datagram(link.outbox.flush())]


def names(messages: list[Any]) -> list[str]:
    return [message.get_type() for message in messages]
