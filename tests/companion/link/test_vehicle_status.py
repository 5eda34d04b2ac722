"""A heartbeat counts if it is newer than the mode that was asked for, and than a gap of our own."""

import pytest

from companion.link.vehicle_link import VehicleLink
from companion.reports import StatusReport
from companion.state import FlightMode, VehicleRequest
from protocol.messages import dialect
from tests.companion.link.sender import MS, NOW, OFFBOARD, OWN_COMPONENT, SECOND, Sender, found, hear, sent

HOLD = 4 << 16 | 3 << 24
SET_MODE = dialect.MAV_CMD_DO_SET_MODE


def word(link: VehicleLink, now: int) -> StatusReport:
    return link.report(now, None, before_flight=False).word


def asked() -> tuple[VehicleLink, Sender]:
    """A link that asked for hold at NOW."""
    link, vehicle = found()
    assert word(link, NOW).current
    link.request(VehicleRequest.HOLD, NOW)
    return link, vehicle


def test_a_heartbeat_from_before_the_answer_says_nothing_of_what_was_asked_for() -> None:
    link, vehicle = asked()
    hear(link, vehicle.heartbeat(mode=3 << 16, state=5), NOW + 10 * MS)
    assert not word(link, NOW + 10 * MS).current
    hear(link, vehicle.ack(SET_MODE, 0, 1, OWN_COMPONENT), NOW + 20 * MS)
    hear(link, vehicle.heartbeat(mode=3 << 16, state=5), NOW + 30 * MS)
    assert not word(link, NOW + 30 * MS).current, "PX4 answers before the mode changes"
    hear(link, vehicle.heartbeat(mode=HOLD), NOW + 120 * MS)
    assert word(link, NOW + 120 * MS).current and link.said.status.mode is FlightMode.HOLD


def test_what_was_overtaken_says_nothing() -> None:
    """With jitter a heartbeat from before the arming comes after the one that tells of it, and the vehicle seemed to
    have disarmed in the take-off."""
    link, vehicle = found()
    before = vehicle.heartbeat(base=81) + vehicle.extended_state(1)
    armed = vehicle.heartbeat(base=81 | 128) + vehicle.extended_state(2)
    hear(link, armed, NOW + 10 * MS)
    hear(link, before, NOW + 30 * MS)
    assert link.said.status.armed and not link.said.on_ground
    hear(link, vehicle.heartbeat(base=81) + vehicle.extended_state(1), NOW + 50 * MS)
    assert not link.said.status.armed and link.said.on_ground, "a later one does"


def test_a_vehicle_that_does_not_count_its_messages_is_believed() -> None:
    link, _ = found()
    for base in (81 | 128, 81, 81 | 128):
        hear(link, Sender().heartbeat(base=base), NOW + 10 * MS)
        assert link.said.status.armed is (base > 128)


def test_a_command_without_an_answer_is_waited_for_a_second() -> None:
    link, vehicle = asked()
    hear(link, vehicle.ack(SET_MODE, 0, 255, 190), NOW + 20 * MS)
    for ms, current in ((500, False), (999, False), (1000, True)):
        link.request(VehicleRequest.HOLD, NOW + ms * MS)  # again, which does not begin the wait anew
        hear(link, vehicle.heartbeat(mode=HOLD), NOW + ms * MS)
        assert word(link, NOW + ms * MS).current == current, ms


def test_the_answer_to_another_command_is_none() -> None:
    link, vehicle = asked()
    hear(link, vehicle.ack(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, OWN_COMPONENT), NOW + 20 * MS)
    hear(link, vehicle.heartbeat(mode=HOLD), NOW + 500 * MS)
    assert not word(link, NOW + 500 * MS).current


def test_what_queued_up_in_a_gap_is_old_until_the_vehicles_clock_says_otherwise() -> None:
    link, vehicle = found()
    assert link.peer is not None
    link.peer.offset_ns = -NOW  # its time since boot began at NOW
    awake = NOW + 5 * SECOND
    assert not link.is_old(100, awake), "without a gap nothing is"
    link.said.stood_still(awake)
    hear(link, vehicle.heartbeat(mode=HOLD), awake + MS)
    assert link.is_old(2600, awake + MS) and not word(link, awake + MS).current
    assert link.is_old(4900, awake + 2 * MS)
    assert not link.is_old(4960, awake + 3 * MS) and not link.said.catching_up
    assert not word(link, awake + 3 * MS).current, "the heartbeat came before"
    hear(link, vehicle.heartbeat(mode=HOLD), awake + 4 * MS)
    assert word(link, awake + 4 * MS).current


def test_a_vehicle_whose_clock_is_not_known_is_believed_after_a_while() -> None:
    link, vehicle = found()
    link.said.stood_still(NOW)
    assert link.is_old(0, NOW + 299 * MS) and not link.is_old(0, NOW + 300 * MS)
    hear(link, vehicle.heartbeat(), NOW + 300 * MS)
    assert word(link, NOW + 300 * MS).current


def test_no_backlog_lasts_for_ever() -> None:
    """Nor does a vehicle without telemetry keep its heartbeats from counting."""
    link, vehicle = found()
    assert link.peer is not None
    link.peer.offset_ns = -NOW
    link.said.stood_still(NOW)
    hear(link, vehicle.heartbeat(), NOW + 1999 * MS)
    assert not word(link, NOW + 1999 * MS).current
    hear(link, vehicle.heartbeat(), NOW + 2000 * MS)
    assert word(link, NOW + 2000 * MS).current
    assert not link.is_old(0, NOW + 2000 * MS)


def test_no_heartbeat_is_asked_for_behind_what_queued_up() -> None:
    link, _ = found()
    link.said.stood_still(NOW)
    link.request(VehicleRequest.STATUS, NOW)
    assert sent(link) == []
    assert not link.is_old(0, NOW + SECOND)
    link.request(VehicleRequest.STATUS, NOW + SECOND)
    (ask,) = sent(link)
    assert (ask.command, ask.param1) == (dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_HEARTBEAT)


@pytest.mark.parametrize(
    ("state", "failsafe"),
    [(3, False), (4, False), (5, True), (6, True), (8, True)],
)
def test_a_critical_state_is_a_failsafe(state: int, failsafe: bool) -> None:
    link, vehicle = found()
    hear(link, vehicle.heartbeat(state=state))
    assert link.said.status.failsafe == failsafe


LAND, POSITION_MODE = 4 << 16 | 6 << 24, 3 << 16


@pytest.mark.parametrize(
    ("heartbeats", "failsafe"),
    [
        pytest.param([(LAND, 5), (LAND, 4)], True, id="over as soon as the companion is heard again: as ArduPilot's"),
        pytest.param([(LAND, 5), (LAND, 4), (POSITION_MODE, 4)], False, id="then a pilot takes over"),
        pytest.param([(LAND, 5), (POSITION_MODE, 5), (POSITION_MODE, 4)], False, id="a pilot takes over meanwhile"),
        pytest.param([(LAND, 5), (LAND, 4), (OFFBOARD, 4), (LAND, 4)], False, id="the same mode by a pilot, later"),
        pytest.param([(OFFBOARD, 5), (POSITION_MODE, 5), (POSITION_MODE, 4)], False, id="a pilot, in a critical state"),
        pytest.param([(POSITION_MODE, 4), (POSITION_MODE, 5), (POSITION_MODE, 4)], False, id="a pilot had it before"),
    ],
)
def test_a_mode_that_begins_with_a_failsafe_stays_its_own(heartbeats: list[tuple[int, int]], failsafe: bool) -> None:
    link, vehicle = found()
    hear(link, vehicle.heartbeat())
    for mode, state in heartbeats:
        hear(link, vehicle.heartbeat(mode=mode, state=state))
    assert link.said.status.failsafe == failsafe


def test_the_time_on_the_ground_counts_from_the_landing_on() -> None:
    link, vehicle = found()
    for ms, landed, on_ground_for, airborne in (
        (0, 1, 0.0, False),
        (3000, 1, 3.0, False),
        (4000, 2, 0.0, True),
        (5000, 4, 0.0, True),
        (6000, 1, 0.0, False),
        (8000, 1, 2.0, False),
        (9000, 0, 0.0, False),
    ):
        hear(link, vehicle.extended_state(landed), NOW + ms * MS)
        found_word = word(link, NOW + ms * MS)
        assert found_word.landed_for == pytest.approx(on_ground_for), ms
        assert found_word.airborne == airborne, ms


def test_home_is_where_the_vehicle_says_and_asked_for_only_if_it_is_needed() -> None:
    link, vehicle = found()
    hear(link, vehicle.version(1, 16))
    link.request(VehicleRequest.VERSION, NOW)
    assert sent(link) == [], "the version is known, and nobody needs home"
    fields = (0, 0, 0, 1.5, -2.0, 0.25, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    assert not link.report(NOW, None, before_flight=True).home_known
    hear(link, vehicle(dialect.MAVLink_home_position_message, *fields))
    assert link.report(NOW, None, before_flight=True).home_known
    assert link.said.home.tolist() == [1.5, -2.0, 0.25]


def test_that_it_stands_on_the_ground_wears_out_where_it_says_nothing_more() -> None:
    """It may have taken off since: in a landing from high up it would be taken to stand there, and disarmed."""
    link, vehicle = found()

    def stands(now: int) -> tuple[bool | None, float]:
        report = link.report(now, None, before_flight=False)
        return report.on_ground, report.word.landed_for

    for second in range(0, 12, 4):
        hear(link, vehicle.extended_state(dialect.MAV_LANDED_STATE_ON_GROUND), NOW + second * SECOND)
    assert stands(NOW + 12 * SECOND) == (True, 12.0), "a slow link"
    assert stands(NOW + 14 * SECOND) == (None, 0.0)
    hear(link, vehicle.extended_state(dialect.MAV_LANDED_STATE_ON_GROUND), NOW + 15 * SECOND)
    assert stands(NOW + 16 * SECOND) == (True, 1.0), "what was in between is not known"
    hear(link, vehicle.extended_state(dialect.MAV_LANDED_STATE_IN_AIR), NOW + 17 * SECOND)
    assert stands(NOW + 60 * SECOND) == (False, 0.0), "nobody flies with a vehicle that said so last"


AIR, GROUND = 2, 1


@pytest.mark.parametrize(("later_ms", "state", "fell"), [(200, AIR, False), (400, AIR, True), (400, GROUND, False)])
def test_a_vehicle_that_is_disarmed_and_goes_on_to_be_in_the_air_falls(later_ms: int, state: int, fell: bool) -> None:
    link, vehicle = found()
    hear(link, vehicle.heartbeat(base=81 | 128) + vehicle.extended_state(AIR), NOW)
    hear(link, vehicle.heartbeat(base=81), NOW + 10 * MS)
    assert word(link, NOW + 11 * MS).undecided and not word(link, NOW + 11 * MS).fell
    then = NOW + (10 + later_ms) * MS
    hear(link, vehicle.extended_state(state), then)
    assert word(link, then).fell is fell and word(link, then).undecided is (state == AIR)
    assert not word(link, NOW + 1100 * MS).undecided, "it may say nothing more"
    hear(link, vehicle.heartbeat(base=81 | 128), then + MS)
    assert not word(link, then + MS).fell


def test_a_vehicle_that_is_disarmed_on_the_ground_has_landed() -> None:
    link, vehicle = found()
    hear(link, vehicle.heartbeat(base=81 | 128) + vehicle.extended_state(GROUND), NOW)
    hear(link, vehicle.heartbeat(base=81), NOW + 10 * MS)
    assert not word(link, NOW + 11 * MS).undecided
