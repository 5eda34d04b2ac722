"""Reports become the state of the vehicle and scans with the pose of their own time; both grow stale."""

import math

import msgspec
import numpy as np
import pytest

from companion.reports import AttitudeReport, ClockSet, PositionReport, Rebooted, RepeatedAttitude
from companion.sensing import Sensing
from companion.state import Scan
from protocol.frames import from_euler, yaw_of

MS, SECOND = 1_000_000, 1_000_000_000


def attitude(boot_ms: int, yaw: float = 0.0) -> AttitudeReport:
    return AttitudeReport(boot_ms, from_euler(0.0, 0.0, yaw), np.zeros(3))


def position(boot_ms: int, north: float = 0.0, speed: float = 0.0) -> PositionReport:
    return PositionReport(boot_ms, np.array([north, 0.0, -3.0]), np.array([speed, 0.0, 0.0]))


def scan(boot_ms: int, time_ns: int = 0, known: bool = True) -> Scan:
    flags = np.full(4, known)
    return Scan(
        time_ns, boot_ms * 1000, np.linspace(0.0, 1.5 * math.pi, 4), np.full(4, 5.0 + 1e-3 * boot_ms), flags, flags
    )


def flown(until_ms: int = 1000, step_ms: int = 4) -> Sensing:
    """A second of telemetry at 2 m/s north with a turn of 1 rad/s, and no scan yet."""
    sensing = Sensing(needs_scan=True)
    for ms in range(0, until_ms + 1, step_ms):
        sensing.take(position(ms, 2e-3 * ms, 2.0), ms * MS)
        assert sensing.take(attitude(ms, 1e-3 * ms), ms * MS)
        sensing.update()
    return sensing


# -- the state ---------------------------------------------------------------------------------------------------------


def test_an_attitude_calls_for_a_control_step_and_nothing_else_does() -> None:
    sensing = Sensing(needs_scan=True)
    assert sensing.take(attitude(0), 0)
    assert sensing.take(RepeatedAttitude(), 0)
    for report in (position(0), scan(0), Rebooted()):
        assert not sensing.take(report, 0)


def test_the_state_is_that_of_the_latest_update() -> None:
    sensing = Sensing(needs_scan=True)
    assert sensing.state is None and sensing.update() is None
    assert not sensing.report(0, 0.0).has_state
    sensing.take(position(0, 1.0), 0)
    sensing.take(attitude(0), 0)
    assert sensing.state is None, "reports alone are no state yet"
    state = sensing.update()
    assert state is not None and sensing.state is state and sensing.report(0, 0.0).has_state
    sensing.take(position(4, 2.0), 4 * MS)
    assert sensing.state is state
    assert sensing.estimator.boot_time_ms == 0
    sensing.take(attitude(8), 8 * MS)
    assert sensing.estimator.boot_time_ms == 8


def test_telemetry_is_as_old_as_its_older_part() -> None:
    sensing = Sensing(needs_scan=True)
    assert sensing.report(SECOND, 0.0).telemetry_age == math.inf
    sensing.take(position(0), 1 * SECOND)
    assert sensing.report(SECOND, 0.0).telemetry_age == math.inf
    sensing.take(attitude(0), 2 * SECOND)
    assert sensing.report(3 * SECOND, 0.0).telemetry_age == 2.0
    sensing.take(position(1), 3 * SECOND)
    assert sensing.report(3 * SECOND, 0.0).telemetry_age == 1.0


# -- scans -------------------------------------------------------------------------------------------------------------


def test_a_scan_comes_once_with_the_pose_of_its_own_time() -> None:
    sensing = flown()
    sent = scan(600, SECOND)
    sensing.take(sent, SECOND)
    seen = sensing.look()
    assert seen is not None
    found, (place, turned) = seen
    assert found is sent
    assert place == pytest.approx([1.2, 0.0, -3.0]) and yaw_of(turned) == pytest.approx(0.6)
    assert sensing.look() is None


def test_of_two_scans_between_two_looks_the_later_one_counts() -> None:
    sensing = flown()
    sensing.take(scan(500), SECOND)
    later = scan(566)
    sensing.take(later, SECOND)
    seen = sensing.look()
    assert seen is not None and seen[0] is later and sensing.look() is None


def test_the_same_scan_again_or_a_blind_one_is_none() -> None:
    sensing = flown()
    assert sensing.scan_age(SECOND) == math.inf
    sensing.take(scan(600, known=False), SECOND)
    assert sensing.look() is None and sensing.scan_age(SECOND) == math.inf
    sensing.take(scan(600), SECOND)
    assert sensing.look() is not None
    for again in (scan(600), scan(700, known=False), scan(600)):
        sensing.take(again, 2 * SECOND)
        assert sensing.look() is None and sensing.scan_age(2 * SECOND) == 1.0
    sensing.take(scan(666), 2 * SECOND)
    assert sensing.look() is not None and sensing.scan_age(2 * SECOND) == 0.0


def test_a_scan_of_which_one_beam_is_known_is_a_scan() -> None:
    sensing = flown()
    partly = scan(600)
    known = np.array([False, False, True, False])
    sensing.take(Scan(0, partly.boot_time_us, partly.bearings_frd, partly.ranges_m, known, known), SECOND)
    assert sensing.look() is not None


def test_a_scan_before_the_first_state_is_lost_and_not_kept() -> None:
    sensing = Sensing(needs_scan=True)
    sensing.take(scan(0), 0)
    assert sensing.look() is None
    sensing.take(position(0), 0)
    sensing.take(attitude(0), 0)
    sensing.update()
    assert sensing.look() is None


def test_the_surroundings_are_as_old_as_the_older_of_scan_and_map() -> None:
    sensing = flown()
    assert sensing.report(SECOND, 0.0).scan_age == math.inf
    sensing.take(scan(600), SECOND)
    assert sensing.report(3 * SECOND, 0.5).scan_age == 2.0
    assert sensing.report(3 * SECOND, 2.5).scan_age == 2.5
    assert sensing.report(3 * SECOND, math.inf).scan_age == math.inf
    assert [sensing.report(3 * SECOND, map_age).unseen for map_age in (0.5, 2.1, 4.5)] == [
        "no ring for",
        "no ring for",
        "no map for",
    ]


def test_rings_that_come_and_do_not_count_are_called_what_they_are() -> None:
    sensing = flown()
    sensing.take(scan(600), SECOND)
    assert sensing.report(2 * SECOND, 1.1).unseen == "no ring for"
    sensing.take(scan(900, known=False), 2 * SECOND)
    assert sensing.report(2 * SECOND, 1.1).unseen == "only blind rings for"
    sensing.take(scan(600), 2 * SECOND)
    assert sensing.report(2 * SECOND + 60 * MS, 1.1).unseen == "only repeated rings for"
    assert sensing.report(20 * SECOND, 19.1).unseen == "no ring for", "they have ended, too"


def test_a_map_of_another_package_that_is_not_made_names_it() -> None:
    sensing = Sensing(needs_scan=True, planner='planner "mine" of some 1.0')
    assert sensing.report(SECOND, math.inf).unseen == "no ring for"
    sensing.plausibility.watches = False
    sensing.take(scan(600), SECOND)
    assert sensing.report(SECOND, 1.0).unseen == 'no map by planner "mine" of some 1.0 for'


def test_no_scan_is_needed_without_avoidance() -> None:
    sensing = Sensing(needs_scan=False)
    assert sensing.report(SECOND, math.inf).scan_age == 0.0


# -- reboots -----------------------------------------------------------------------------------------------------------


def test_after_a_reboot_the_telemetry_is_as_old_as_if_none_had_come() -> None:
    sensing = flown()
    before = sensing.state
    assert not sensing.take(Rebooted(), 2 * SECOND)
    assert sensing.report(2 * SECOND, 0.0).telemetry_age == math.inf
    assert sensing.state is before, "the latest one that was known, until there is another"
    assert not sensing.take(position(4, 9.0), 2 * SECOND)
    assert sensing.take(attitude(4), 2 * SECOND)
    assert sensing.report(2 * SECOND, 0.0).telemetry_age == 0.0
    state = sensing.update()
    assert state is not None and state.position_ned[0] == 9.0


def test_after_a_reboot_no_pose_of_the_time_before_is_taken_for_a_scan() -> None:
    sensing = flown()
    sensing.take(Rebooted(), 2 * SECOND)
    sensing.take(scan(600), 2 * SECOND)
    assert sensing.look() is None


def test_there_is_a_present_state_after_a_reboot_though_no_update_was_made_since() -> None:
    """The position may have come after the attitude, when the telemetry is fresh and no state was made yet."""
    sensing = flown()
    assert sensing.present is sensing.state
    sensing.take(Rebooted(), 2 * SECOND)
    sensing.take(attitude(4, 0.5), 2 * SECOND)
    assert sensing.update() is None
    sensing.take(position(5, 9.0), 2 * SECOND)
    assert sensing.report(2 * SECOND, 0.0).telemetry_age == 0.0
    assert sensing.present.position_ned[0] == 9.0 and yaw_of(sensing.present.attitude_ned_frd) == pytest.approx(0.5)


@pytest.mark.parametrize("by_ms", [4000, -500])
def test_a_clock_that_was_set_changes_nothing_else(by_ms: int) -> None:
    sensing, plain = flown(), flown()
    stamp = sensing.boot_time_ms
    sensing.take(ClockSet(by_ms), SECOND)
    assert sensing.boot_time_ms == stamp + by_ms
    for each, by in ((sensing, by_ms), (plain, 0)):
        each.take(attitude(stamp + 20 + by, 0.2), SECOND)
    one, other = sensing.update(), plain.update()
    assert one is not None and other is not None
    assert one.position_ned.tolist() == other.position_ned.tolist() and one.position_age_ns == other.position_age_ns
    at_ms = stamp - 4
    pose, same = (each.estimator.pose_at(1000 * (at_ms + by)) for each, by in ((sensing, by_ms), (plain, 0)))
    assert pose is not None and same is not None and pose[0].tolist() == same[0].tolist()


def test_what_is_not_believed_is_counted() -> None:
    sensing = flown()
    assert set(sensing.implausible.values()) == {0}
    sensing.begin(0.0, stands=True)
    stamp = sensing.boot_time_ms
    for ms, speed in ((0, 2.0), (4, 2.0), (8, 90.0), (12, 90.0)):
        sensing.take(attitude(stamp + ms), SECOND + ms)
        report = position(stamp + ms, 0.0)
        sensing.take(msgspec.structs.replace(report, velocity_ned=np.array([speed, 0.0, 0.0])), SECOND + ms)
    assert sensing.implausible == {"motion_implausible": 2, "rings_implausible": 0}
