"""The link by itself: what is asked of the vehicle, how often, and which telemetry it lacks for a flight."""

from collections.abc import Callable
from typing import Any

import pytest

from companion.link.telemetry import Telemetry
from companion.link.vehicle_link import VehicleLink
from companion.state import Announcement, Output, Setpoint, Severity, VehicleRequest
from protocol.messages import dialect
from tests.companion.link.sender import (
    ARDUPILOT,
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

ARM = dialect.MAV_CMD_COMPONENT_ARM_DISARM
WELCOME = {
    dialect.MAVLINK_MSG_ID_SYS_STATUS,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS,
    dialect.MAVLINK_MSG_ID_VIBRATION,
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    dialect.MAVLINK_MSG_ID_ODOMETRY,
}
"""What is good to have of a PX4."""
PERIOD_MS = 20
"""Period of the supervision, which asks for requests and reports."""


# -- requests ----------------------------------------------------------------------------------------------------------


def ask(link: VehicleLink, wanted: VehicleRequest, start_ms: int, stop_ms: int) -> list[tuple[int, Any]]:
    """(ms after NOW, COMMAND_LONG) of what is sent when the request is repeated every 20 ms."""
    asked = []
    for ms in range(start_ms, stop_ms, PERIOD_MS):
        link.request(wanted, NOW + ms * MS)
        asked += [(ms, message) for message in sent(link)]
    return asked


def test_a_request_is_repeated_with_a_rising_confirmation_until_it_is_exhausted() -> None:
    link, _ = found()
    interval_ms = round(SETTINGS.supervision.command_interval * 1e3)
    tries = SETTINGS.supervision.command_tries
    last_ms = (tries - 1) * interval_ms
    asked = ask(link, VehicleRequest.ARM, 0, last_ms + PERIOD_MS)
    assert [ms for ms, _ in asked] == [k * interval_ms for k in range(tries)]
    assert [message.confirmation for _, message in asked] == [*range(tries)]
    for _, message in asked:
        assert (message.target_system, message.target_component) == (1, 1)
        assert (message.command, message.param1) == (ARM, 1.0)
        assert {getattr(message, f"param{number}") for number in range(2, 8)} == {0.0}
    just_before = NOW + (last_ms + interval_ms) * MS - 1
    assert link.report(just_before, VehicleRequest.ARM, before_flight=True).exhausted is None
    report = link.report(just_before + 1, VehicleRequest.ARM, before_flight=True)
    assert report.exhausted == "arming: no answer"
    assert link.report(just_before + 1, VehicleRequest.EXTERNAL_CONTROL, before_flight=True).exhausted is None
    assert link.report(just_before + 1, None, before_flight=True).exhausted is None


@pytest.mark.parametrize(("autopilot", "where"), [(PX4, "PX4 tells why where it hears"), (ARDUPILOT, "")])
def test_a_refusal_without_a_word_says_where_the_vehicle_tells_why(autopilot: int, where: str) -> None:
    """PX4 sends no text on a link on which it hears no ground station."""
    link, vehicle = found(autopilot=autopilot)
    ask(link, VehicleRequest.ARM, 0, 20_000)
    end = NOW + 20 * SECOND
    assert where in link.report(end, VehicleRequest.ARM, before_flight=True).complaint
    assert link.report(end, None, before_flight=True).complaint == ""
    hear(link, vehicle.text(dialect.MAV_SEVERITY_CRITICAL, b"Arming denied"), end)
    assert link.report(end, VehicleRequest.ARM, before_flight=True).complaint == " (Arming denied)"


@pytest.mark.parametrize("wanted", [VehicleRequest.HOLD, VehicleRequest.LAND, VehicleRequest.VERSION])
def test_what_keeps_the_vehicle_safe_is_asked_for_without_end(wanted: VehicleRequest) -> None:
    link, _ = found()
    assert len(ask(link, wanted, 0, 10_000)) == 20
    assert link.report(NOW + 11 * SECOND, wanted, before_flight=False).exhausted is None


def test_another_mode_is_asked_for_at_once_and_from_the_beginning() -> None:
    link, _ = found()
    hold = ask(link, VehicleRequest.HOLD, 0, 600)
    land = ask(link, VehicleRequest.LAND, 600, 1200)
    assert [message.confirmation for _, message in hold + land] == [0, 1, 0, 1]
    assert land[0][0] == 600
    assert [(m.command, m.param2, m.param3) for _, m in (hold[0], land[0])] == [(176, 4.0, 3.0), (176, 4.0, 6.0)]


def test_a_mode_that_was_forgotten_is_asked_for_from_the_beginning() -> None:
    link, _ = found()
    ask(link, VehicleRequest.HOLD, 0, 100)
    link.requests.forget_mode()
    ((ms, message),) = ask(link, VehicleRequest.HOLD, 100, 200)
    assert (ms, message.confirmation) == (100, 0)


def test_nothing_is_asked_for_that_is_there_or_not_wanted() -> None:
    link, vehicle = found()
    link.request(None, NOW)
    assert link.outbox.flush() == b""
    assert len(ask(link, VehicleRequest.VERSION, 0, 40)) == 1
    hear(link, vehicle.version(1, 13))
    assert ask(link, VehicleRequest.VERSION, 1000, 3000) == []


def test_an_answer_to_somebody_else_counts_for_nothing() -> None:
    link, vehicle = found()
    ask(link, VehicleRequest.RELEASE, 0, 20)
    command = dialect.MAV_CMD_DO_GRIPPER
    for system, component in ((255, OWN_COMPONENT), (1, 190), (255, 190), (2, 0), (0, 1)):
        hear(link, vehicle.ack(command, dialect.MAV_RESULT_ACCEPTED, system, component))
        answer = link.requests.answer(VehicleRequest.RELEASE)
        assert (answer.accepted, answer.tries, answer.answer) == (False, 1, "no answer")
    hear(link, vehicle.ack(ARM, dialect.MAV_RESULT_ACCEPTED, 1, OWN_COMPONENT))
    assert not link.requests.answer(VehicleRequest.RELEASE).accepted, "it answers another command"
    hear(link, vehicle.ack(command, dialect.MAV_RESULT_DENIED, 1, OWN_COMPONENT))
    assert link.requests.answer(VehicleRequest.RELEASE).answer == "denied"


@pytest.mark.parametrize("target", [(0, 0), (1, 0), (0, OWN_COMPONENT), (1, OWN_COMPONENT)])
def test_an_answer_to_the_companion_or_to_everybody_counts(target: tuple[int, int]) -> None:
    link, vehicle = found()
    ask(link, VehicleRequest.RELEASE, 0, 20)
    hear(link, vehicle.ack(dialect.MAV_CMD_DO_GRIPPER, dialect.MAV_RESULT_ACCEPTED, *target))
    answer = link.requests.answer(VehicleRequest.RELEASE)
    assert answer.accepted and answer.answer == "accepted"


# -- rates and the beat ------------------------------------------------------------------------------------------------


def finish_audit(link: VehicleLink, now: int) -> None:
    """The vehicle does not have a single parameter."""
    audit = link.readiness.audit
    assert audit is not None and link.firmware is not None
    for name, *_ in link.firmware.parameters:
        hear(link, Sender().parameter_error(name), now)
    audit.go_on(now)
    assert audit.done


def stream(link: VehicleLink, vehicle: Sender, hz: dict[str, int]) -> int:
    """One second of telemetry after NOW, with so many messages of each kind; the time at its end."""
    makers: dict[str, Callable[[int], bytes]] = {
        "position": vehicle.position,
        "attitude": vehicle.quaternion,
        "scan": vehicle.scan,
        "landed": lambda ms: vehicle.extended_state(1),
    }
    times = sorted((k * SECOND // count, name) for name, count in hz.items() for k in range(count))
    for after_ns, name in times:
        hear(link, makers[name](after_ns // MS), NOW + after_ns + 1)
    return NOW + SECOND


ENOUGH = {"position": 250, "attitude": 250, "scan": 15, "landed": 5}


def test_the_first_thing_that_a_flight_lacks_is_named() -> None:
    link, vehicle = found()
    now = stream(link, vehicle, ENOUGH)
    shortcoming = link.report(now, None, before_flight=True).shortcoming
    assert shortcoming == "the vehicle does not say its version (AUTOPILOT_VERSION)"
    hear(link, vehicle.version(1, 14), now)
    assert link.report(now, None, before_flight=True).shortcoming is None


@pytest.mark.parametrize(
    ("name", "count", "text"),
    [
        ("position", 74, "LOCAL_POSITION_NED arrives at 74 of 250 Hz"),
        ("attitude", 50, "ATTITUDE_QUATERNION arrives at 50 of 250 Hz"),
        ("scan", 4, "OBSTACLE_DISTANCE arrives at 4 of 15 Hz"),
        ("scan", 0, "OBSTACLE_DISTANCE arrives at 0 of 15 Hz (does the vehicle have that sensor?)"),
    ],
)
def test_a_message_that_comes_too_slowly_is_named_with_its_rate(name: str, count: int, text: str) -> None:
    link, vehicle = found()
    hear(link, vehicle.version(1, 13))
    now = stream(link, vehicle, ENOUGH | {name: count})
    shortcoming = link.report(now, None, before_flight=True).shortcoming
    assert shortcoming is not None and shortcoming.startswith(f"telemetry too slow: {text}")
    assert link.report(now, None, before_flight=False).shortcoming is None, "in flight it is not looked for"


def test_a_landed_state_is_asked_for_and_done_without() -> None:
    link, vehicle = found()
    hear(link, vehicle.version(1, 13))
    now = stream(link, vehicle, ENOUGH | {"landed": 0})
    report = link.report(now, None, before_flight=True)
    assert report.shortcoming is None and report.on_ground is None
    assert dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE in link.telemetry.rates.wanted


def test_the_least_share_of_a_rate_is_enough() -> None:
    link, vehicle = found()
    hear(link, vehicle.version(1, 13))
    now = stream(link, vehicle, {"position": 75, "attitude": 75, "scan": 5, "landed": 2})
    assert link.report(now, None, before_flight=True).shortcoming is None


def test_what_wavers_about_the_least_share_stays_enough() -> None:
    telemetry = Telemetry(SETTINGS)
    for second, (hz, enough) in enumerate(((74, False), (75, True), (38, True), (37, False), (74, False), (75, True))):
        start = second * 2 * SECOND
        for message_id in telemetry.rates.wanted:
            for k in range(hz):
                telemetry.rates.count(message_id, start + k * SECOND // hz + 1)
        assert (telemetry.shortcoming(start + SECOND) is None) is enough, hz


def test_no_scan_is_needed_without_avoidance() -> None:
    link, vehicle = found(overrides=("avoidance.method=none",))
    hear(link, vehicle.version(1, 13))
    now = stream(link, vehicle, ENOUGH | {"scan": 0})
    assert link.report(now, None, before_flight=True).shortcoming is None


@pytest.mark.parametrize(
    ("output", "autopilot", "minor", "refused"),
    [
        (Output.ACTUATORS, PX4, 14, True),
        (Output.ACTUATORS, PX4, 13, False),
        (Output.RATES, PX4, 14, False),
        (None, PX4, 14, False),
        (Output.RATES, ARDUPILOT, 14, False),
        (Output.ATTITUDE, ARDUPILOT, 14, False),
        (None, ARDUPILOT, 14, False),
        (Output.ACTUATORS, ARDUPILOT, 13, True),
    ],
)
def test_an_output_that_the_firmware_does_not_take_is_refused_at_once(
    output: Output | None, autopilot: int, minor: int, refused: bool
) -> None:
    """As soon as the version is known, without any telemetry."""
    link, vehicle = found(output, autopilot=autopilot)
    assert link.report(NOW, None, before_flight=True).refusal is None
    hear(link, vehicle.version(1, minor))
    refusal = link.report(NOW, None, before_flight=True).refusal
    assert (refusal is not None) is refused
    assert not refused or "SET_ACTUATOR_CONTROL_TARGET" in str(refusal)
    assert link.report(NOW, None, before_flight=False).refusal is None


@pytest.mark.parametrize(
    ("autopilot", "kind", "name"),
    [
        (PX4, dialect.MAV_TYPE_GENERIC, None),
        (PX4, dialect.MAV_TYPE_HEXAROTOR, None),
        (PX4, dialect.MAV_TYPE_VTOL_QUADROTOR, None),
        (PX4, dialect.MAV_TYPE_FIXED_WING, "fixed wing"),
        (PX4, 250, "type 250"),
        (ARDUPILOT, dialect.MAV_TYPE_QUADROTOR, None),
        (ARDUPILOT, dialect.MAV_TYPE_VTOL_QUADROTOR, "vtol quadrotor"),
        (ARDUPILOT, dialect.MAV_TYPE_FIXED_WING, "fixed wing"),
        (ARDUPILOT, dialect.MAV_TYPE_GROUND_ROVER, "ground rover"),
    ],
)
def test_what_is_no_copter_is_refused_at_once(autopilot: int, kind: int, name: str | None) -> None:
    """ArduPilot's mode 4 is GUIDED of a copter, ACRO of a plane and HOLD of a rover."""
    link, vehicle = VehicleLink(SETTINGS, Output.RATES), Sender()
    hear(link, vehicle.heartbeat(autopilot, kind=kind))
    refusal = link.report(NOW, None, before_flight=True).refusal
    assert refusal == (None if name is None else f"it is no copter, but {name}")


def test_the_beat_is_once_a_second_and_asks_for_rates_only_when_told() -> None:
    link = VehicleLink(SETTINGS, Output.RATES)
    link.beat(0, asks_rates=True)
    assert names(sent(link)) == ["HEARTBEAT"], "nobody is there to be asked"
    hear(link, Sender().heartbeat(), 1)
    finish_audit(link, 1)
    seen = []
    for ms in range(PERIOD_MS, 4000, PERIOD_MS):
        if ms % 200 == 0:
            hear(link, Sender().heartbeat(), ms * MS)
        link.beat(ms * MS, asks_rates=ms >= 2500)
        messages = sent(link)
        if messages:
            seen.append((ms, names(messages)))
    questions = [ms for ms, each in seen if "TIMESYNC" in each]
    assert questions == list(range(PERIOD_MS, 4000, 100))
    asks = ["COMMAND_LONG"] * 10  # four messages, the sectors of a scan, and five that are good to have
    assert [(ms, [name for name in each if name != "TIMESYNC"]) for ms, each in seen if each != ["TIMESYNC"]] == [
        (1000, ["HEARTBEAT"]),
        (2000, ["HEARTBEAT"]),
        (3000, ["HEARTBEAT", *asks]),
    ]


def test_only_what_comes_too_slowly_is_asked_for_again() -> None:
    link, vehicle = found()
    now = stream(link, vehicle, ENOUGH | {"position": 20})
    hear(link, vehicle.heartbeat(), now)
    link.beat(now, asks_rates=True)
    asks = [message for message in sent(link) if message.get_type() == "COMMAND_LONG"]
    (ask,) = [message for message in asks if message.param1 not in WELCOME]
    assert (ask.command, ask.param1, ask.param2) == (dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 32.0, 4000.0)
    assert {getattr(ask, f"param{number}") for number in range(3, 8)} == {0.0}


def test_what_is_good_to_have_is_asked_for_a_few_times_and_never_lacking() -> None:
    link, vehicle = found()
    hear(link, vehicle.version(1, 13))
    asked: list[int] = []
    for second in range(6):
        now = NOW + second * SECOND
        if second == 1:
            hear(link, vehicle(dialect.MAVLink_vibration_message, 0, 0.0, 0.0, 0.0, 0, 0, 0), now)
        link.beat(now, asks_rates=True)
        asked += [int(each.param1) for each in sent(link) if each.get_type() == "COMMAND_LONG"]
    counts = {each: asked.count(each) for each in WELCOME}
    assert counts.pop(dialect.MAVLINK_MSG_ID_VIBRATION) == 1, "it came"
    assert set(counts.values()) == {3}
    now = stream(link, vehicle, ENOUGH)
    assert link.report(now, None, before_flight=True).shortcoming is None


def test_odometry_that_is_not_wanted_is_not_asked_for() -> None:
    link, vehicle = found(overrides=("rates.odometry=0",))
    hear(link, vehicle.version(1, 13))
    link.beat(NOW, asks_rates=True)
    asked = {int(each.param1) for each in sent(link) if each.get_type() == "COMMAND_LONG"}
    assert asked >= WELCOME - {dialect.MAVLINK_MSG_ID_ODOMETRY}
    assert dialect.MAVLINK_MSG_ID_ODOMETRY not in asked


def test_a_heartbeat_that_is_late_is_asked_for_by_itself() -> None:
    """PX4 refuses another interval than a second for it."""
    link, _ = found()
    asked = []
    for ms in range(0, 1000, PERIOD_MS):
        link.beat(NOW + ms * MS, asks_rates=True)
        messages = [message for message in sent(link) if message.get_type() == "COMMAND_LONG"]
        wanted = [message.param1 for message in messages if message.command == dialect.MAV_CMD_REQUEST_MESSAGE]
        asked += [ms for message_id in wanted if message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT]
    assert asked == [300, 500, 700, 900]
    quiet = found()[0]
    quiet.beat(NOW + 900 * MS, asks_rates=False)
    assert "COMMAND_LONG" not in names(sent(quiet))


def test_all_rates_are_asked_for_on_request() -> None:
    link, _ = found()
    link.request_rates()
    asked = {message.param1: message.param2 for message in sent(link)}
    wanted = {0.0: 2e5, 32.0: 4000.0, 31.0: 4000.0, 330.0: pytest.approx(1e6 / 15), 245.0: 2e5}
    assert asked == wanted


# -- setpoints and text ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("output", "name"),
    [
        (Output.ATTITUDE, "SET_ATTITUDE_TARGET"),
        (Output.RATES, "SET_ATTITUDE_TARGET"),
        (Output.ACTUATORS, "SET_ACTUATOR_CONTROL_TARGET"),
    ],
)
def test_a_setpoint_goes_to_the_vehicle_that_was_found(output: Output, name: str) -> None:
    link = VehicleLink(SETTINGS, output)
    hear(link, Sender(33, 1).heartbeat())
    link.outbox.setpoint(Setpoint([1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, 0.5), 1234)
    (message,) = sent(link)
    assert message.get_type() == name and (message.target_system, message.target_component) == (33, 1)


def test_all_that_is_to_be_sent_is_one_datagram_in_its_order() -> None:
    link, vehicle = found()
    link.outbox.say(Announcement(Severity.INFO, "one"))
    hear(link, vehicle.timesync(0, 5))
    link.request(VehicleRequest.ARM, NOW)
    assert names(sent(link)) == ["STATUSTEXT", "TIMESYNC", "COMMAND_LONG"]
    assert link.outbox.flush() == b""


def test_nothing_is_said_to_nobody() -> None:
    link = VehicleLink(SETTINGS, Output.RATES)
    link.outbox.say(Announcement(Severity.INFO, "anybody?"))
    assert link.outbox.flush() == b""
