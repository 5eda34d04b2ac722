"""The link by itself: what is a vehicle, what is reported of it and what is counted."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.link.vehicle_link import Traffic, VehicleLink
from companion.reports import AttitudeReport, ClockSet, OdometryReport, PositionReport, Rebooted, RepeatedAttitude
from companion.runtime.files import load_settings
from companion.state import Announcement, FlightMode, Output, Scan, Severity
from protocol.framing import Framer
from protocol.messages import dialect
from tests.companion.link.sender import (
    ARDUPILOT,
    LONGEST_NS,
    MS,
    NOW,
    OWN_COMPONENT,
    PX4,
    SECOND,
    SETTINGS,
    Sender,
    found,
    hear,
    names,
    sent,
)

# -- the vehicle -------------------------------------------------------------------------------------------------------


def test_only_the_heartbeat_of_a_known_autopilot_is_a_vehicle() -> None:
    """Neither other messages of it, nor another component's heartbeat, nor one of an autopilot that is not known."""
    link = VehicleLink(SETTINGS, Output.RATES)
    strangers = (
        Sender().quaternion(1),
        Sender(1, 2).heartbeat(),
        Sender(1, 191).heartbeat(),
        Sender(255, 190).heartbeat(dialect.MAV_AUTOPILOT_INVALID),
        Sender().heartbeat(dialect.MAV_AUTOPILOT_INVALID),
        Sender().heartbeat(dialect.MAV_AUTOPILOT_GENERIC),
    )
    for data in strangers:
        assert hear(link, data) == []
        assert link.vehicle is None and not link.report(NOW, None, before_flight=True).found
    hear(link, Sender(7, 1).heartbeat())
    assert link.vehicle == (7, 1)
    assert link.report(NOW, None, before_flight=True).found


def test_what_came_before_the_vehicle_was_found_and_what_others_send_is_ignored() -> None:
    link, vehicle = VehicleLink(SETTINGS, Output.RATES), Sender()
    assert hear(link, vehicle.quaternion(1) + vehicle.position(1)) == []
    reports = hear(link, vehicle.position(2) + vehicle.heartbeat() + vehicle.position(3))
    assert [type(report) for report in reports] == [PositionReport]
    for other in (Sender(2, 1), Sender(1, 2), Sender(1, 100)):
        others = other.heartbeat(mode=0) + other.quaternion(4) + other.position(4) + other.timesync(0, 5)
        assert hear(link, others, NOW + SECOND) == [] and link.outbox.flush() == b""
    assert link.vehicle == (1, 1)
    report = link.report(NOW + SECOND, None, before_flight=True)
    assert report.status.mode is FlightMode.EXTERNAL
    assert report.silence == report.heartbeat_age == 1.0


def test_the_companion_takes_the_vehicles_system_unless_it_has_its_own() -> None:
    for overrides, system in (((), 42), (("identity.system=9",), 9)):
        link = VehicleLink(load_settings(None, list(overrides)), Output.RATES)
        hear(link, Sender(42, 1).heartbeat())
        link.outbox.say(Announcement(Severity.INFO, "here"))
        (frame,) = Framer().datagram(link.outbox.flush())
        assert (frame.system, frame.component) == (system, OWN_COMPONENT)


@pytest.mark.parametrize("tells", [True, False])
def test_ardupilot_turns_slowly_about_its_yaw_axis(tells: bool) -> None:
    """Whether it tells of its landing or not."""
    for autopilot in (PX4, ARDUPILOT):
        link, vehicle = found(autopilot=autopilot)
        if tells:
            hear(link, vehicle.extended_state(dialect.MAV_LANDED_STATE_ON_GROUND))
        assert link.motors.own_loops is (autopilot == ARDUPILOT)
        assert link.motors.spooling is (tells and autopilot == ARDUPILOT)


@pytest.mark.parametrize(("base", "state"), [(81, 4), (81 | 128, 4), (81 | 128, 5), (81, 6), (81, 3)])
def test_a_heartbeat_says_mode_arming_and_failsafe(base: int, state: int) -> None:
    link, vehicle = found()
    hear(link, vehicle.heartbeat(base=base, state=state))
    status = link.report(NOW, None, before_flight=True).status
    assert status.mode is FlightMode.EXTERNAL
    assert status.armed == (base >= 128) and status.failsafe == (state in (5, 6))


def test_what_the_vehicle_says_of_the_ground_and_of_its_arming_checks() -> None:
    link, vehicle = found()
    assert not link.said.on_ground and link.report(NOW, None, before_flight=True).prearm_ok
    for landed in (1, 2, 3, 4, 1):
        hear(link, vehicle.extended_state(landed))
        report = link.report(NOW, None, before_flight=True)
        assert link.said.on_ground == report.on_ground == (landed == dialect.MAV_LANDED_STATE_ON_GROUND)
    bit = dialect.MAV_SYS_STATUS_PREARM_CHECK
    for present, healthy, ok in ((bit, 0, False), (0, 0, False), (bit, bit, True), (0, 0, True)):
        hear(link, vehicle(dialect.MAVLink_sys_status_message, present, 0, healthy, *[0] * 10))
        assert link.report(NOW, None, before_flight=True).prearm_ok is ok, "what is not said is as before"


def test_ages_begin_at_what_was_heard() -> None:
    link = VehicleLink(SETTINGS, Output.RATES)
    before = link.report(NOW, None, before_flight=True)
    assert before.silence == 0.0 and before.heartbeat_age == math.inf
    vehicle = Sender()
    hear(link, vehicle.heartbeat())
    hear(link, vehicle.position(1), NOW + SECOND)
    report = link.report(NOW + 3 * SECOND, None, before_flight=True)
    assert report.silence == 2.0 and report.heartbeat_age == 3.0


# -- reports -----------------------------------------------------------------------------------------------------------


def test_reports_come_in_the_order_of_the_messages() -> None:
    link, vehicle = found()
    kinds: list[tuple[Callable[[], bytes], type]] = [
        (lambda: vehicle.position(1), PositionReport),
        (lambda: vehicle.quaternion(2), AttitudeReport),
        (lambda: vehicle.scan(3), Scan),
        (lambda: vehicle.text(6, b"hello"), Announcement),
        (lambda: vehicle.euler(3), RepeatedAttitude),
        (lambda: vehicle.position(4), PositionReport),
    ]
    order = np.random.default_rng(1).permutation([*range(len(kinds))] * 3).tolist()
    order = [1, *order]  # the quaternion first: without one Euler angles are no repetition
    data = b"".join(kinds[k][0]() for k in order)
    assert [type(report) for report in hear(link, data)] == [kinds[k][1] for k in order]


def test_what_a_datagram_leads_to_is_sent_in_the_order_of_its_messages() -> None:
    link, vehicle = found()
    data = vehicle.timesync(0, 98) + vehicle.quaternion(5, w=9.0) + vehicle.timesync(0, 99) + vehicle.position(2)
    remark, position = hear(link, data)
    assert isinstance(remark, Announcement) and isinstance(position, PositionReport)
    first, refusal, second = sent(link)
    assert (first.tc1, first.ts1) == (NOW, 98) and (second.tc1, second.ts1) == (NOW, 99)
    assert refusal.get_msgId() == dialect.MAVLINK_MSG_ID_STATUSTEXT and refusal.text == remark.text[:50]
    assert link.outbox.flush() == b""


def test_a_report_holds_what_the_message_says() -> None:
    link, vehicle = found()
    attitude, position, scan = hear(link, vehicle.quaternion(5) + vehicle.position(6) + vehicle.scan(7))
    assert isinstance(attitude, AttitudeReport) and isinstance(position, PositionReport) and isinstance(scan, Scan)
    assert attitude.boot_time_ms == 5 and attitude.attitude_ned_frd.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert attitude.rates_frd == pytest.approx([0.1, 0.2, 0.3])
    assert position.boot_time_ms == 6 and position.position_ned.tolist() == [1.0, 2.0, -3.0]
    assert position.velocity_ned == pytest.approx([0.4, 0.5, 0.6])
    assert scan.time_ns == NOW and scan.boot_time_us == 7000 and (scan.ranges_m == 5.0).all() and scan.hit.all()


def test_euler_angles_are_an_attitude_only_while_there_is_no_quaternion() -> None:
    link, vehicle = found()
    reports = hear(link, vehicle.euler(1) + vehicle.euler(2) + vehicle.quaternion(3) + vehicle.euler(4))
    assert [type(each) for each in reports] == [AttitudeReport, AttitudeReport, AttitudeReport, RepeatedAttitude]
    assert [type(each) for each in hear(link, vehicle.euler(5))] == [RepeatedAttitude]


def test_a_stream_is_cut_anywhere_and_gives_the_same_reports() -> None:
    for size in (1, 7, 30):
        link, vehicle = found()
        data = vehicle.quaternion(5) + vehicle.position(6) + vehicle.scan(7)
        kinds = []
        for at in range(0, len(data), size):
            kinds += [type(each) for each in link.receive(data[at : at + size], NOW, whole=False)]
        assert kinds == [AttitudeReport, PositionReport, Scan]


# -- refused telemetry -------------------------------------------------------------------------------------------------


def test_refused_telemetry_is_counted_and_said_once() -> None:
    link, vehicle = found()
    first = hear(link, vehicle.quaternion(1, w=2.0))
    assert len(first) == 1 and isinstance(first[0], Announcement) and first[0].severity is Severity.WARNING
    assert first[0].text.startswith("telemetry refused: ATTITUDE_QUATERNION")
    assert names(sent(link)) == ["STATUSTEXT"]
    assert hear(link, vehicle.position(1, math.nan) + vehicle.quaternion(2, w=0.5)) == []
    assert link.traffic.messages_refused == 3 and link.outbox.flush() == b""


def test_three_refusals_within_half_a_second_are_a_fault_until_that_time_is_over() -> None:
    link, vehicle = found()
    for number in range(3):
        assert link.report(NOW + 200 * MS, None, before_flight=False).refused is None
        hear(link, vehicle.position(1, math.inf), NOW + number * 100 * MS)
    report = link.report(NOW + 499 * MS, None, before_flight=False)
    assert report.refused is not None and "LOCAL_POSITION_NED" in report.refused
    assert link.report(NOW + 500 * MS, None, before_flight=False).refused is None
    hear(link, vehicle.quaternion(1, w=3.0), NOW + 550 * MS)  # 450 ms after the last but one
    report = link.report(NOW + 550 * MS, None, before_flight=False)
    assert report.refused is not None and "ATTITUDE_QUATERNION" in report.refused
    link, vehicle = found()
    for number in range(10):  # more of them, but too rarely
        now = NOW + number * 251 * MS
        hear(link, vehicle.position(1, math.inf), now)
        assert link.report(now, None, before_flight=False).refused is None


def test_odometry_says_how_certain_the_estimate_is_and_is_no_fault_where_it_can_not_be() -> None:
    link, vehicle = found()
    (report,) = hear(link, vehicle.odometry(1000, 0.04, counter=7))
    assert isinstance(report, OdometryReport) and report.reset_counter == 7
    assert report.velocity_variance == pytest.approx([0.04] * 3)
    for ms in range(0, 400, 33):
        hear(link, vehicle.odometry(1000 + ms, -1.0), NOW + ms * MS)
    assert link.traffic.messages_refused == 13
    assert link.report(NOW + 400 * MS, None, before_flight=False).refused is None


def test_odometry_that_is_not_wanted_is_not_listened_to() -> None:
    link, vehicle = found(overrides=("rates.odometry=0",))
    assert not hear(link, vehicle.odometry(1000))


def test_a_refused_message_was_heard_all_the_same() -> None:
    link, vehicle = found()
    hear(link, vehicle.quaternion(1, w=2.0), NOW + SECOND)
    assert link.report(NOW + SECOND, None, before_flight=False).silence == 0.0


# -- reboot and complaints ---------------------------------------------------------------------------------------------


def test_a_reboot_is_reported_before_the_attitude_that_shows_it() -> None:
    link, vehicle = found()
    hear(link, vehicle.quaternion(60_000))
    again = Sender()
    again.encoder.sequence = vehicle.encoder.sequence
    rebooted, said, attitude = hear(link, again.quaternion(100))
    assert isinstance(rebooted, Rebooted) and isinstance(attitude, AttitudeReport) and attitude.boot_time_ms == 100
    assert said == Announcement(Severity.ERROR, "the vehicle rebooted")
    assert link.traffic.reboots == 1
    (text,) = sent(link)
    assert text.text == "the vehicle rebooted" and text.severity == Severity.ERROR
    assert [type(each) for each in hear(link, again.quaternion(104))] == [AttitudeReport]


def test_a_reboot_is_seen_in_an_attitude_that_is_refused() -> None:
    link, vehicle = found()
    hear(link, vehicle.quaternion(60_000))
    kinds = [type(each) for each in hear(link, vehicle.quaternion(100, w=2.0))]
    assert kinds == [Rebooted, Announcement, Announcement]


@pytest.mark.parametrize("by_ms", [4000, -500, -59_000])
def test_a_clock_that_is_set_in_flight_is_gone_along_with(by_ms: int) -> None:
    link, vehicle = found()
    hear(link, vehicle.heartbeat(base=81 | dialect.MAV_MODE_FLAG_SAFETY_ARMED))
    reports = []
    for ms in range(0, 400, 4):
        stamp = 60_000 + ms + (by_ms if ms >= 200 else 0)
        reports += hear(link, vehicle.quaternion(stamp) + vehicle.position(stamp), NOW + ms * MS)
    assert [each for each in reports if isinstance(each, ClockSet)] == [ClockSet(by_ms)]
    assert link.traffic.reboots == 0 and 12 <= link.traffic.messages_refused <= 30
    assert isinstance(reports[-1], PositionReport) and reports[-1].boot_time_ms == 60_396 + by_ms
    assert link.report(NOW + 400 * MS, None, before_flight=False).refused is None


def test_a_single_stamp_ahead_of_the_clock_is_refused() -> None:
    link, vehicle = found()
    for ms in range(0, 100, 4):
        wrong = 4000 if ms == 60 else 0
        heard = hear(
            link, vehicle.quaternion(60_000 + ms + wrong) + vehicle.position(60_000 + ms + wrong), NOW + ms * MS
        )
        assert [type(each) for each in heard] == ([] if wrong else [AttitudeReport, PositionReport])
    assert link.traffic.messages_refused == 2


def test_an_overtaken_attitude_is_no_reboot() -> None:
    link, vehicle = found()
    hear(link, vehicle.quaternion(60_000))
    assert [type(each) for each in hear(link, vehicle.quaternion(59_500))] == [AttitudeReport]
    assert link.traffic.reboots == 0


def test_a_warning_of_the_vehicle_explains_what_follows_for_five_seconds() -> None:
    link, vehicle = found()
    (heard,) = hear(link, vehicle.text(6, b"fine weather"))
    assert heard == Announcement(Severity.INFO, "vehicle: fine weather")
    assert link.report(NOW, None, before_flight=False).complaint == ""
    (heard,) = hear(link, vehicle.text(4, b"Preflight Fail: \x07 mag"))
    assert isinstance(heard, Announcement) and heard.severity is Severity.WARNING
    assert link.report(NOW + 4999 * MS, None, before_flight=False).complaint == " (Preflight Fail: ? mag)"
    assert link.report(NOW + 5000 * MS, None, before_flight=False).complaint == ""
    assert link.outbox.flush() == b"", "what the vehicle said is not said back to it"


@pytest.mark.parametrize("severity", [7, 8, 255])
def test_severities_that_there_are_not_are_information(severity: int) -> None:
    link, vehicle = found()
    (heard,) = hear(link, vehicle.text(severity, b"debug"))
    assert isinstance(heard, Announcement) and heard.severity is Severity.INFO


# -- scans -------------------------------------------------------------------------------------------------------------


def test_sectors_are_a_scan_until_a_whole_one_came_that_knows_something() -> None:
    link, vehicle = found()

    def sectors(boot_ms: int) -> bytes:
        return b"".join(vehicle.sector(boot_ms, k, 100 + k) for k in range(8))

    (scan,) = hear(link, sectors(501))
    assert isinstance(scan, Scan) and scan.ranges_m == pytest.approx([1.0 + 0.01 * k for k in range(8)])
    assert scan.hit.all() and scan.known.all()
    assert scan.boot_time_us == 401_000, "ArduPilot's sectors may have been seen a turn of the LiDAR sooner"
    blind, scan = hear(link, vehicle.scan(502, 65535) + sectors(503))
    assert isinstance(blind, Scan) and not blind.known.any() and isinstance(scan, Scan) and scan.boot_time_us == 403_000
    (whole,) = hear(link, vehicle.scan(504) + sectors(505))
    assert isinstance(whole, Scan) and whole.boot_time_us == 504_000


def test_a_sector_that_was_not_measured_shows_nothing() -> None:
    link, vehicle = found()
    (scan,) = hear(link, b"".join(vehicle.sector(1, k, quality=1 if k == 3 else 0) for k in range(8)))
    assert isinstance(scan, Scan)
    assert scan.known.tolist() == scan.hit.tolist() == [k != 3 for k in range(8)]


def test_a_scan_of_sectors_counts_as_a_scan_for_its_rate() -> None:
    link, vehicle = found()
    for number in range(15):
        data = b"".join(vehicle.sector(number, k) for k in range(8))
        hear(link, data, NOW + number * 60 * MS)
    hear(link, vehicle.version(1, 13))
    hear(link, vehicle.heartbeat(), NOW + 900 * MS)
    link.beat(NOW + 900 * MS, asks_rates=True)
    asked = {message.param1 for message in sent(link) if message.get_type() == "COMMAND_LONG"}
    needed = dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    assert dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE not in asked and asked.issuperset(needed)


# -- time --------------------------------------------------------------------------------------------------------------


@settings(max_examples=100)
@given(
    ahead_ns=st.integers(-NOW, 10**18),
    age_ns=st.integers(-SECOND, 3 * SECOND),
)
def test_telemetry_is_measured_neither_later_than_now_nor_before_the_longest_age(ahead_ns: int, age_ns: int) -> None:
    """Wherever the vehicle's clock is, and however old the telemetry or wrong its time."""
    link, vehicle = found()
    link.beat(NOW, asks_rates=False)
    hear(link, vehicle.timesync(max(NOW + ahead_ns, 1), NOW))
    assert link.peer is not None and link.peer.offset_ns is not None
    boot_ms = max((NOW + link.peer.offset_ns - age_ns) // MS, 0)
    measured = link.delays.take(boot_ms, NOW, link.peer)
    assert NOW - LONGEST_NS <= measured <= NOW
    exact = boot_ms * MS - link.peer.offset_ns
    assert measured == (NOW if exact < NOW - LONGEST_NS else min(exact, NOW)), "of no age where that can't be"


def test_telemetry_is_measured_now_while_the_vehicles_clock_is_not_known() -> None:
    link = VehicleLink(SETTINGS, Output.RATES)
    assert link.delays.take(1, NOW, link.peer) == NOW
    hear(link, Sender().heartbeat())
    assert link.delays.take(1, NOW, link.peer) == NOW


# -- what is counted ---------------------------------------------------------------------------------------------------


def test_traffic_is_counted() -> None:
    assert VehicleLink(SETTINGS, Output.RATES).traffic == Traffic(0, 0, 0, 0, 0, 0, 0)
    link, vehicle = found()
    late = vehicle.position(1)
    vehicle.encoder.sequence += 3
    hear(link, vehicle.position(2))
    assert link.traffic == Traffic(4, 0, 0, 0, 0, 0, 0)
    hear(link, late)
    assert link.traffic == Traffic(3, 1, 0, 0, 0, 0, 0)
    hear(link, late)
    assert link.traffic == Traffic(3, 1, 0, 1, 0, 0, 0)
    broken = bytearray(vehicle.position(3))
    broken[-1] ^= 1
    hear(link, bytes(broken))
    assert link.traffic.frames_bad >= 1
    before = link.traffic
    vehicle.encoder.sequence = (vehicle.encoder.sequence + 150) & 0xFF
    hear(link, vehicle.quaternion(60_000, w=2.0))
    vehicle.encoder.sequence = (vehicle.encoder.sequence + 150) & 0xFF
    hear(link, vehicle.quaternion(100))
    after = link.traffic
    assert (after.messages_refused, after.sequence_restarts, after.reboots) == (1, 2, 1)
    lost, late_ones, duplicates = before.messages_lost, before.messages_late, before.duplicates
    assert (after.messages_lost, after.messages_late, after.duplicates) == (lost, late_ones, duplicates)
