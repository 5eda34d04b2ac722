"""The link raises nothing, whatever bytes come."""

import itertools
import math
import struct
from collections.abc import Callable

import numpy as np
import pytest
from fastcrc.crc16 import mcrf4xx
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.link.vehicle_link import VehicleLink
from companion.reports import AttitudeReport, PositionReport, Report
from companion.state import Announcement, Output, Scan, VehicleRequest
from protocol.framing import Framer
from protocol.messages import dialect, layout
from tests.companion.link.sender import (
    ARDUPILOT,
    LONGEST_NS,
    MS,
    NOW,
    OFFBOARD,
    OWN_COMPONENT,
    PX4,
    SETTINGS,
    Sender,
    hear,
)


def framed(body: bytes, message_id: int) -> bytes:
    """A MAVLink 2 frame around header and payload, with the right checksum."""
    checksum = mcrf4xx(body + bytes((layout(message_id).crc_extra,)))
    return b"\xfd" + body + checksum.to_bytes(2, "little")


def heartbeat_of(system: int, component: int, autopilot: int) -> bytes:
    """A frame with ids that no `Encoder` takes, too."""
    header = struct.pack("<BBBBBB3s", 9, 0, 0, 0, system, component, bytes(3))
    return framed(header + struct.pack("<IBBBBB", OFFBOARD, 2, autopilot, 81, 4, 3), dialect.MAVLINK_MSG_ID_HEARTBEAT)


def test_a_heartbeat_of_system_0_is_no_vehicle() -> None:
    """Id 0 addresses all systems and is nobody's own; the companion would have to take it for itself."""
    link = VehicleLink(SETTINGS, Output.RATES)
    assert hear(link, heartbeat_of(0, 1, PX4)) == [] and link.vehicle is None
    hear(link, heartbeat_of(1, 1, PX4))
    assert link.vehicle == (1, 1)


HANDLED = (0, 1, 30, 31, 32, 77, 111, 132, 148, 245, 253, 330)


@st.composite
def random_frames(draw: st.DrawFn) -> bytes:
    """A valid frame of a message that the link reads, of any sender, with any payload."""
    message_id = draw(st.sampled_from(HANDLED))
    payload = draw(st.binary(min_size=1, max_size=layout(message_id).size))
    system, component = draw(st.sampled_from((1, 1, 1, 0, 255))), draw(st.sampled_from((1, 1, 1, 0, 191)))
    sequence = draw(st.integers(0, 255))
    header = struct.pack("<BBBBBB3s", len(payload), 0, 0, sequence, system, component, message_id.to_bytes(3, "little"))
    return framed(header + payload, message_id)


@st.composite
def extreme_telemetry(draw: st.DrawFn) -> bytes:
    """Telemetry of the vehicle with values that are not finite, far away or contradictory."""
    number = st.sampled_from((0.0, 1.0, -1.0, 1e30, -1e-30, math.nan, math.inf, -math.inf))
    values = [draw(number) for _ in range(7)]
    boot_ms = draw(st.sampled_from((0, 1, 2**31, 2**32 - 1)))
    vehicle = Sender()
    kinds: tuple[Callable[[], bytes], ...] = (
        lambda: vehicle(dialect.MAVLink_attitude_quaternion_message, boot_ms, *values),
        lambda: vehicle(dialect.MAVLink_attitude_message, boot_ms, *values[:6]),
        lambda: vehicle(dialect.MAVLink_local_position_ned_message, boot_ms, *values[:6]),
        lambda: vehicle(
            dialect.MAVLink_obstacle_distance_message,
            2**64 - 1,
            0,
            [draw(st.integers(0, 65535))] * 72,
            draw(st.integers(0, 255)),
            draw(st.integers(0, 65535)),
            draw(st.integers(0, 65535)),
            *values[:2],
            12,
        ),
        lambda: vehicle.timesync(draw(st.integers(-(2**63), 2**63 - 1)), draw(st.integers(-(2**63), 2**63 - 1))),
        vehicle.heartbeat,
    )
    return draw(st.sampled_from(kinds))()


IDS = st.sampled_from((1, 0, 255))
HEARTBEATS = st.builds(heartbeat_of, IDS, IDS, st.sampled_from((PX4, ARDUPILOT, 8)))
PIECES = st.one_of(st.binary(max_size=40), HEARTBEATS, random_frames(), extreme_telemetry())


@settings(max_examples=200)
@given(
    pieces=st.lists(PIECES, max_size=8),
    cuts=st.lists(st.integers(0, 400), max_size=4),
    known=st.booleans(),
    whole=st.booleans(),
)
def test_no_bytes_raise_anything(pieces: list[bytes], cuts: list[int], known: bool, whole: bool) -> None:
    """Frames of anybody with any payload, in pieces and with pieces missing; what is reported is finite."""
    link = VehicleLink(SETTINGS, Output.RATES)
    if known:
        hear(link, Sender().heartbeat())
    data = b"".join(pieces)
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    now = NOW
    for start, stop in itertools.pairwise(edges):
        now += 4 * MS
        for report in link.receive(data[start:stop], now, whole=whole):
            assert_finite(report)
    known_now = link.vehicle is not None
    link.request(VehicleRequest.ARM if known_now else None, now)
    last = link.report(now, VehicleRequest.ARM, before_flight=True)
    assert last.found is known_now and last.silence >= 0.0 and last.heartbeat_age >= 0.0
    assert NOW - LONGEST_NS <= link.delays.take(0, now, link.peer) <= now
    frames = Framer(carry_unknown=False).datagram(link.outbox.flush())
    assert all(frame.component == OWN_COMPONENT for frame in frames)


def assert_finite(report: Report | Announcement) -> None:
    match report:
        case AttitudeReport():
            assert np.isfinite(report.rates_frd).all()
            assert np.linalg.norm(report.attitude_ned_frd) == pytest.approx(1.0)
        case PositionReport():
            assert np.isfinite(report.position_ned).all() and np.isfinite(report.velocity_ned).all()
        case Scan():
            assert np.isfinite(report.bearings_frd).all() and np.isfinite(report.ranges_m).all()
            assert not (report.hit & ~report.known).any()
        case Announcement():
            assert report.text.isprintable()
