"""What the vehicle says of its being ready, and the words for it."""

import pytest

from companion.link.firmware.ardupilot import FIRMWARE
from companion.link.vehicle_link import VehicleLink
from companion.runtime.files import load_settings
from companion.state import Announcement, Output
from protocol.messages import dialect
from tests.companion.link.sender import ARDUPILOT, MS, NOW, OWN_COMPONENT, PX4, SECOND, Sender, found, hear, sent
from tests.companion.link.test_real_telemetry import frames

ATTITUDE, VELOCITY, POSITION, HEIGHT = (
    dialect.EKF_ATTITUDE,
    dialect.EKF_VELOCITY_HORIZ,
    dialect.EKF_POS_HORIZ_ABS,
    dialect.EKF_POS_VERT_ABS,
)
PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK
WARNING, CRITICAL, INFO = dialect.MAV_SEVERITY_WARNING, dialect.MAV_SEVERITY_CRITICAL, dialect.MAV_SEVERITY_INFO


def estimator(vehicle: Sender, flags: int) -> bytes:
    return vehicle(dialect.MAVLink_ekf_status_report_message, flags, 0.1, 0.1, 0.1, 0.1, 0.1)


def sys_status(vehicle: Sender, *, ready: bool) -> bytes:
    return vehicle(dialect.MAVLink_sys_status_message, PREARM, PREARM, PREARM * ready, *[0] * 10)


def telemetry(vehicle: Sender, start_ns: int = NOW) -> list[tuple[int, bytes]]:
    """A second of all that a flight without a scan needs."""
    ticks = range(0, 1000, 4)
    return [
        (start_ns + ms * MS, vehicle.quaternion(ms) + vehicle.position(ms) + vehicle.extended_state(1)) for ms in ticks
    ]


@pytest.mark.parametrize(
    ("flags", "lacking"),
    [
        (0, "attitude, velocity, height, position"),
        (ATTITUDE, "velocity, height, position"),
        (ATTITUDE | VELOCITY | HEIGHT, "position"),
        (ATTITUDE | VELOCITY | HEIGHT | POSITION, None),
        (POSITION, None),
    ],
)
def test_ardupilot_is_ready_once_its_estimator_has_a_position(flags: int, lacking: str | None) -> None:
    """Whatever its PREARM bit says, and before its telemetry is looked at: that lacks for the same reason."""
    link, vehicle = found(autopilot=ARDUPILOT, overrides=("avoidance.method=none",))
    hear(link, vehicle.version(4, 7) + sys_status(vehicle, ready=True) + estimator(vehicle, flags))
    shortcoming = link.report(NOW, None, before_flight=True).shortcoming or ""
    assert shortcoming.startswith("telemetry" if lacking is None else f"the vehicle's estimator has no {lacking} yet")
    for now, data in telemetry(vehicle):
        hear(link, data, now)
    assert (link.report(NOW + SECOND, None, before_flight=True).shortcoming is None) is (lacking is None)
    assert link.report(NOW + SECOND, None, before_flight=False).shortcoming is None


def test_a_real_ardupilot_waits_for_its_estimator_and_then_flies() -> None:
    """Recorded from before its estimator had a position: the reason changes once, and before it takes off."""
    link = VehicleLink(load_settings(None, []), None)
    waited: list[bool] = []
    for time_ns, frame in frames("ardupilot_guided.tlog"):
        if frame[6] == OWN_COMPONENT:  # what the companion of then said
            continue
        hear(link, frame, time_ns)
        hear(link, b"".join(Sender().parameter(name, 8.0) for name, *_ in FIRMWARE.parameters), time_ns)
        if link.vehicle is not None and not link.said.status.armed:
            link.beat(time_ns, asks_rates=False)
            waits = "estimator has no position" in (link.report(time_ns, None, before_flight=True).shortcoming or "")
            if not waited or waits is not waited[-1]:
                waited.append(waits)
        if link.said.status.armed:
            break
    assert waited == [False, True, False], "no report yet, none of a position, one"


def test_px4_may_know_its_place_by_a_camera_alone() -> None:
    """A position relative to where it began is enough for it to be in OFFBOARD."""
    link, vehicle = found(overrides=("avoidance.method=none",))
    hear(link, vehicle.version(1, 16))
    for flags, waits in ((ATTITUDE, True), (ATTITUDE | dialect.ESTIMATOR_POS_HORIZ_REL, False), (POSITION, False)):
        hear(link, vehicle(dialect.MAVLink_estimator_status_message, 0, flags, *[0.1] * 8))
        shortcoming = link.report(NOW, None, before_flight=True).shortcoming or ""
        assert ("the vehicle's estimator has no" in shortcoming) is waits


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_vehicle_that_does_not_report_its_estimator_is_flown(autopilot: int) -> None:
    link, vehicle = found(Output.ATTITUDE, autopilot=autopilot, overrides=("avoidance.method=none",))
    hear(link, vehicle.version(1, 14))
    for now, data in telemetry(vehicle):
        hear(link, data, now)
    report = link.report(NOW + SECOND, None, before_flight=True)
    assert report.shortcoming is None and report.refusal is None and report.prearm_ok


def test_after_a_reboot_nothing_is_known_of_the_estimator_and_all_is_asked_for_again() -> None:
    link, vehicle = found(autopilot=ARDUPILOT)

    def asked(now: int) -> set[float]:
        link.beat(now, asks_rates=True)
        messages = [each for each in sent(link) if each.get_type() == "COMMAND_LONG"]
        return {each.param1 for each in messages if each.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL}

    welcome = {dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT, dialect.MAVLINK_MSG_ID_BATTERY_STATUS}
    assert welcome <= asked(NOW)
    battery = vehicle(dialect.MAVLink_battery_status_message, 0, 0, 0, 0, [12000] + [65535] * 9, 0, 0, 0, 90)
    hear(link, vehicle.version(4, 7) + vehicle.quaternion(60_000) + estimator(vehicle, POSITION) + battery)
    assert not welcome & asked(NOW + SECOND)
    hear(link, vehicle.quaternion(500), NOW + 2 * SECOND)
    assert welcome <= asked(NOW + 2 * SECOND) and not link.report(NOW, None, before_flight=True).position_lost
    hear(link, estimator(vehicle, ATTITUDE), NOW + 3 * SECOND)
    assert not link.report(NOW + 3 * SECOND, None, before_flight=True).position_lost, "it had none since then"


def test_the_reason_is_the_vehicle_s_own_words() -> None:
    """ArduPilot repeats the failed check each 30 s; other warnings in between don't hide it."""
    link, vehicle = found(autopilot=ARDUPILOT)
    hear(link, vehicle.version(4, 7) + sys_status(vehicle, ready=False) + estimator(vehicle, ATTITUDE))
    hear(link, vehicle.text(CRITICAL, b"PreArm: GPS 1: Bad fix"))
    hear(link, vehicle.text(WARNING, b"SmartRTL deactivated"), NOW + SECOND)
    later = link.report(NOW + 30 * SECOND, None, before_flight=True)
    assert later.shortcoming is not None and later.shortcoming.endswith("yet (PreArm: GPS 1: Bad fix)")
    assert later.failed_check == " (PreArm: GPS 1: Bad fix)" and not later.prearm_ok
    assert link.report(NOW + 50 * SECOND, None, before_flight=True).failed_check == "", "it is not said any more"


def test_a_check_that_failed_once_explains_nothing_where_the_checks_pass() -> None:
    link, vehicle = found(autopilot=ARDUPILOT)
    hear(link, sys_status(vehicle, ready=False) + vehicle.text(CRITICAL, b"PreArm: Compass not calibrated"))
    hear(link, sys_status(vehicle, ready=True), NOW + SECOND)
    assert link.report(NOW + 10 * SECOND, None, before_flight=True).failed_check == ""
    hear(link, vehicle.text(WARNING, b"Motors: safety switch"), NOW + 10 * SECOND)
    assert "safety switch" in link.report(NOW + 11 * SECOND, None, before_flight=True).failed_check
    hear(link, vehicle.text(INFO, b"all is well"), NOW + 20 * SECOND)
    assert link.report(NOW + 21 * SECOND, None, before_flight=True).failed_check == ""


def test_without_a_vehicle_its_heartbeat_is_what_lacks() -> None:
    report = VehicleLink(load_settings(None), Output.RATES).report(NOW, None, before_flight=True)
    assert report.shortcoming == "no heartbeat of a vehicle has come"


def test_without_its_version_that_is_what_lacks() -> None:
    link, _ = found()
    report = link.report(NOW, None, before_flight=True)
    assert report.shortcoming == "the vehicle does not say its version (AUTOPILOT_VERSION)"


def companion_beat(state: int) -> bytes:
    return Sender(1, OWN_COMPONENT)(
        dialect.MAVLink_heartbeat_message, 18, dialect.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
    )


def test_it_stands_back_for_another_companion_that_flies_the_vehicle() -> None:
    link, _ = found()
    shortcoming = link.report(NOW, None, before_flight=True).shortcoming
    (said,) = hear(link, companion_beat(dialect.MAV_STATE_STANDBY))
    assert isinstance(said, Announcement) and "speaks as system 1, component 191" in said.text
    assert link.report(NOW, None, before_flight=True).shortcoming == shortcoming, "it does not fly yet"
    assert hear(link, companion_beat(dialect.MAV_STATE_ACTIVE)) == [], "said once"
    assert link.report(NOW + 3 * SECOND, None, before_flight=True).shortcoming == said.text
    assert link.report(NOW + 4 * SECOND, None, before_flight=True).shortcoming == shortcoming


def shown(link: VehicleLink, stamps_ms: list[int], now: int) -> list[str]:
    """What is said of attitudes with these stamps, 4 ms apart from another."""
    vehicle, said = Sender(), list[str]()
    for k, stamp_ms in enumerate(stamps_ms):
        heard = hear(link, vehicle.quaternion(stamp_ms), now + 4 * k * MS)
        said += [each.text for each in heard if isinstance(each, Announcement)]
    return [text for text in said if "two clocks speak as system 1, component 1" in text]


@pytest.mark.parametrize("ahead_ms", [60_000, -60_000])
def test_two_vehicles_with_the_same_id_are_not_flown(ahead_ms: int) -> None:
    """The stamps of one are refused, or lead back and forth; both would obey a command."""
    link, _ = found()
    shortcoming = link.report(NOW, None, before_flight=True).shortcoming
    (said,) = shown(link, [100_000 + 4 * k + ahead_ms * (k % 2) for k in range(300)], NOW)
    assert link.report(NOW + 2 * SECOND, None, before_flight=True).shortcoming == said
    alone = [100_000 + 4 * k for k in range(300, 800)]
    assert shown(link, alone, NOW + 1200 * MS) == []
    assert link.report(NOW + 4 * SECOND, None, before_flight=True).shortcoming == shortcoming


@pytest.mark.parametrize("by_ms", [60_000, -60_000])
def test_a_clock_that_is_set_is_no_second_one(by_ms: int) -> None:
    link, _ = found()
    assert shown(link, [100_000 + 4 * k + by_ms * (k > 100) for k in range(300)], NOW) == []


def test_own_heartbeats_say_whether_it_flies() -> None:
    link, _ = found()
    states: list[list[int]] = []
    for ms, active in ((1000, False), (1020, False), (1040, True), (1060, True), (2040, True)):
        link.outbox.flush()
        link.beat(NOW + ms * MS, asks_rates=False, active=active)
        beats = [each for each in sent(link) if each.get_type() == "HEARTBEAT"]
        states.append([each.system_status for each in beats])
    standby, flying = dialect.MAV_STATE_STANDBY, dialect.MAV_STATE_ACTIVE
    assert states == [[standby], [], [flying], [], [flying]], "once a second, and at once when it changes"


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_position_that_the_estimator_had_and_has_no_more_is_lost(autopilot: int) -> None:
    """What never was can't be lost; what comes back is no fault any more."""
    link, vehicle = found(autopilot=autopilot)
    good, bad = dialect.ESTIMATOR_ATTITUDE | dialect.ESTIMATOR_POS_HORIZ_ABS, dialect.ESTIMATOR_ATTITUDE
    for flags, lost in ((bad, False), (good, False), (bad, True), (good, False)):
        hear(link, vehicle(dialect.MAVLink_estimator_status_message, 0, flags, *[0.1] * 8))
        assert link.report(NOW, None, before_flight=False).position_lost is lost
