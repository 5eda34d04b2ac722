"""The mission protocol: uploads, downloads, and all that can go wrong with them."""

import math
from typing import Any

import pytest
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import ForeignPilot
from tests.vehicle_sim.mission_uploader import ON_THE_SPOT, RELATIVE, Row, at, do, download, message, upload
from vehicle_sim.services.missions import RETRY_NS, ROOM, TIMEOUT_NS

ACCEPTED, ERROR = mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_ERROR
MISSION, FENCE, RALLY = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY
WAYPOINT, POINT = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_RALLY_POINT
CORNER, CIRCLE = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
ROWS = {
    MISSION: [at(WAYPOINT, 10.0 * n, -5.0, 8.0, 1.5, 2.0) for n in range(4)],
    FENCE: [at(CORNER, n, e, 0.0, 3.0) for n, e in ((50, 0), (-50, 50), (-50, -50))] + [at(CIRCLE, 9.0, 9.0, 0.0, 4.0)],
    RALLY: [at(POINT, 20.0, 0.0, 12.0), at(POINT, -20.0, 0.0, 12.0)],
}


@pytest.fixture
def pilot() -> ForeignPilot:
    return ForeignPilot()


@pytest.mark.parametrize("kind", ROWS)
def test_what_was_uploaded_is_downloaded_again_until_it_is_cleared(pilot: ForeignPilot, kind: int) -> None:
    assert download(pilot, kind) == []
    assert upload(pilot, ROWS[kind], kind) == ACCEPTED
    for sent, row in zip(download(pilot, kind), ROWS[kind], strict=True):
        command, frame, params, x, y, z = row
        assert (sent.command, sent.frame, sent.x, sent.y, sent.z, sent.mission_type) == (command, frame, x, y, z, kind)
        assert (sent.param1, sent.param2, sent.param3, sent.param4) == pytest.approx(params, nan_ok=True)
    pilot.send(mavlink.MAVLink_mission_clear_all_message(1, 1, mavlink.MAV_MISSION_TYPE_ALL))
    pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ACCEPTED
    assert download(pilot, kind) == []
    assert upload(pilot, [], kind) == ACCEPTED


def test_the_loader_of_pymavlink_gets_its_items_in_real_numbers(pilot: ForeignPilot) -> None:
    loader = mavwp.MAVWPLoader(1, 1)
    for number in range(3):
        loader.add_latlonalt(47.0 + 1e-4 * number, 8.0, 5.0)
    pilot.send(mavlink.MAVLink_mission_count_message(1, 1, loader.count()))
    for number in range(loader.count()):
        pilot.fly(0.004)
        assert pilot.last("MISSION_REQUEST_INT").seq == number
        pilot.send(loader.wp(number))
    pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ACCEPTED
    pilot.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    for number in range(loader.count()):
        pilot.send(mavlink.MAVLink_mission_request_message(1, 1, number))
        pilot.fly(0.004)
        item = pilot.last("MISSION_ITEM")
        assert (item.x, item.y, item.z) == pytest.approx((loader.wp(number).x, 8.0, 5.0), abs=1e-5)


@pytest.mark.parametrize("unused", [math.nan, math.inf, -1e30])
@pytest.mark.parametrize("command", [mavlink.MAV_CMD_DO_CHANGE_SPEED, mavlink.MAV_CMD_DO_SET_ROI_NONE])
def test_what_no_whole_number_can_say_is_unset_in_one(pilot: ForeignPilot, command: int, unused: float) -> None:
    frame = RELATIVE if command == mavlink.MAV_CMD_DO_SET_ROI_NONE else ON_THE_SPOT
    params = (0.0, 3.0, 0.0, 0.0)
    pilot.send(mavlink.MAVLink_mission_count_message(1, 1, 1))
    pilot.send(mavlink.MAVLink_mission_item_message(1, 1, 0, frame, command, 0, 1, *params, unused, 12.0, 0.0))
    pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ACCEPTED
    (item,) = download(pilot)
    assert (item.x, item.y) == (2**31 - 1, 120_000_000 if frame == RELATIVE else 12)


def test_a_place_that_is_not_given_is_no_number_of_degrees(pilot: ForeignPilot) -> None:
    unset = 2**31 - 1
    here = (mavlink.MAV_CMD_NAV_TAKEOFF, RELATIVE, (0.0,) * 4, unset, unset, 5.0)
    assert upload(pilot, [here]) == ACCEPTED
    pilot.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    pilot.send(mavlink.MAVLink_mission_request_message(1, 1, 0))
    pilot.fly(0.004)
    item = pilot.last("MISSION_ITEM")
    assert math.isnan(item.x) and math.isnan(item.y) and item.z == 5.0


@pytest.mark.parametrize(
    ("row", "kind", "result"),
    [
        (do(mavlink.MAV_CMD_DO_PARACHUTE), MISSION, mavlink.MAV_MISSION_UNSUPPORTED),
        (do(WAYPOINT), MISSION, mavlink.MAV_MISSION_UNSUPPORTED),
        (at(mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 0, 0, 1, 3), MISSION, mavlink.MAV_MISSION_UNSUPPORTED),
        (at(POINT, 0.0, 0.0, 1.0), MISSION, mavlink.MAV_MISSION_UNSUPPORTED),
        (at(WAYPOINT, 0.0, 0.0, 1.0), FENCE, mavlink.MAV_MISSION_UNSUPPORTED),
        (at(WAYPOINT, 0.0, 0.0, 1.0), RALLY, mavlink.MAV_MISSION_UNSUPPORTED),
        (
            (WAYPOINT, mavlink.MAV_FRAME_LOCAL_NED, (0.0,) * 4, 0, 0, 0.0),
            MISSION,
            mavlink.MAV_MISSION_UNSUPPORTED_FRAME,
        ),
        ((WAYPOINT, RELATIVE, (0.0,) * 4, 950_000_000, 1, 5.0), MISSION, mavlink.MAV_MISSION_INVALID_PARAM5_X),
        ((WAYPOINT, RELATIVE, (0.0,) * 4, 0, 0, 5.0), MISSION, mavlink.MAV_MISSION_INVALID_PARAM5_X),
        (at(WAYPOINT, 0.0, 0.0, math.nan), MISSION, mavlink.MAV_MISSION_INVALID_PARAM7),
        (do(mavlink.MAV_CMD_NAV_DELAY, math.nan), MISSION, mavlink.MAV_MISSION_INVALID_PARAM1),
        (do(mavlink.MAV_CMD_DO_SET_ROI, 2.0), MISSION, mavlink.MAV_MISSION_INVALID_PARAM1),
        (at(CIRCLE, 0.0, 0.0, 0.0, -1.0), FENCE, mavlink.MAV_MISSION_INVALID_PARAM1),
        (at(CORNER, 0.0, 0.0, 0.0, 2.0), FENCE, ERROR),
        (at(CORNER, 0.0, 0.0, 0.0, math.nan), FENCE, ERROR),
        (at(CORNER, 0.0, 0.0, 0.0, math.inf), FENCE, ERROR),
        (at(CORNER, 0.0, 0.0, 0.0, 3.0), FENCE, ERROR),
    ],
)
def test_an_item_that_can_not_be_taken_ends_the_upload(pilot: ForeignPilot, row: Row, kind: int, result: int) -> None:
    assert upload(pilot, ROWS[kind], kind) == ACCEPTED
    assert upload(pilot, [row], kind) == result
    assert len(download(pilot, kind)) == len(ROWS[kind]), "what was there before stays"
    assert upload(pilot, ROWS[kind], kind) == ACCEPTED, "and the next upload is not kept up"


def test_a_circle_without_a_radius_is_kept_and_means_nothing(pilot: ForeignPilot) -> None:
    """MAVSDK's example of a fence has one at 0 N 0 E."""
    inclusion = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
    nowhere = (inclusion, RELATIVE, (0.0,) * 4, 0, 0, 0.0)
    assert upload(pilot, [*ROWS[FENCE], nowhere], FENCE) == ACCEPTED
    assert len(download(pilot, FENCE)) == len(ROWS[FENCE]) + 1
    assert len(pilot.vehicle.flight.limits.zones) == 2


def test_a_lost_item_is_requested_four_times_a_second_until_nobody_answers(pilot: ForeignPilot) -> None:
    pilot.send(mavlink.MAVLink_mission_count_message(1, 1, 2, MISSION))
    pilot.fly(1.1)
    asked = pilot.times("MISSION_REQUEST_INT")
    assert len(asked) == 5 and asked[1] - asked[0] == pytest.approx(RETRY_NS * 1e-9, abs=0.005)
    pilot.send(message(ROWS[MISSION][0], 0))
    pilot.fly(TIMEOUT_NS * 1e-9 - 0.1)
    assert pilot.last("MISSION_REQUEST_INT").seq == 1 and "Operation timeout" not in pilot.texts
    pilot.fly(0.2)
    assert "Operation timeout" in pilot.texts
    quiet = len(pilot.all("MISSION_REQUEST_INT"))
    pilot.fly(0.6)
    assert len(pilot.all("MISSION_REQUEST_INT")) == quiet
    assert download(pilot) == [], "half an upload counts for nothing"


def test_items_out_of_turn_from_others_and_of_other_types(pilot: ForeignPilot) -> None:
    pilot.send(mavlink.MAVLink_mission_count_message(1, 1, 2, MISSION))
    pilot.fly(0.004)
    pilot.send(message(ROWS[MISSION][1], 1))  # not asked for: ignored
    pilot.fly(0.004)
    assert not pilot.all("MISSION_ACK") and pilot.last("MISSION_REQUEST_INT").seq == 0
    pilot.send(message(ROWS[MISSION][0], 0, FENCE))
    stranger = mavlink.MAVLink(None, 255, 190)
    pilot.vehicle.receive(message(ROWS[MISSION][0], 0).pack(stranger))
    pilot.vehicle.receive(mavlink.MAVLink_mission_count_message(1, 1, 1, MISSION).pack(stranger))
    pilot.fly(0.004)
    assert [(ack.type, ack.target_system) for ack in pilot.all("MISSION_ACK")] == [
        (ERROR, 1),
        (ERROR, 255),
        (ERROR, 255),
    ]
    for number in range(2):
        pilot.send(message(ROWS[MISSION][number], number))
        pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ACCEPTED
    pilot.send(message(ROWS[MISSION][1], 1))  # the last one again: its answer may have been lost
    pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ACCEPTED
    pilot.send(message(ROWS[MISSION][0], 0))
    pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ERROR


def test_a_last_item_that_comes_again_has_the_answer_that_was_given(pilot: ForeignPilot) -> None:
    lone = at(CORNER, 0.0, 0.0, 0.0, 3.0)
    assert upload(pilot, [lone], FENCE) == ERROR, "a polygon of three corners"
    for kind, result in ((FENCE, ERROR), (RALLY, ERROR)):
        pilot.send(message(lone, 0, kind))
        pilot.fly(0.004)
        assert (pilot.last("MISSION_ACK").type, pilot.last("MISSION_ACK").mission_type) == (result, kind)
    assert upload(pilot, ROWS[RALLY], RALLY) == ACCEPTED
    for kind, result in ((RALLY, ACCEPTED), (MISSION, ERROR)):
        pilot.send(message(ROWS[RALLY][1], 1, kind))
        pilot.fly(0.004)
        assert (pilot.last("MISSION_ACK").type, pilot.last("MISSION_ACK").mission_type) == (result, kind)


def test_too_many_unknown_and_cancelled(pilot: ForeignPilot) -> None:
    for count, kind, result in (
        (ROOM[RALLY] + 1, RALLY, mavlink.MAV_MISSION_NO_SPACE),
        (1, 7, mavlink.MAV_MISSION_INVALID),
    ):
        pilot.send(mavlink.MAVLink_mission_count_message(1, 1, count, kind))
        pilot.fly(0.004)
        assert pilot.last("MISSION_ACK").type == result
    pilot.send(mavlink.MAVLink_mission_count_message(1, 1, 2, MISSION))
    pilot.send(mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, MISSION))
    pilot.fly(1.0)
    assert len(pilot.all("MISSION_REQUEST_INT")) == 1
    assert upload(pilot, ROWS[MISSION]) == ACCEPTED


def test_a_download_in_a_wrong_order_is_given_up(pilot: ForeignPilot) -> None:
    upload(pilot, ROWS[MISSION])
    pilot.send(mavlink.MAVLink_mission_request_list_message(1, 1, MISSION))
    for number in (0, 0, 1):
        pilot.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, MISSION))
    pilot.fly(0.004)
    assert [item.seq for item in pilot.all("MISSION_ITEM_INT")] == [0, 0, 1]
    pilot.send(mavlink.MAVLink_mission_request_int_message(1, 1, 3, MISSION))
    pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ERROR


def test_who_never_confirms_a_download_is_served_on(pilot: ForeignPilot) -> None:
    """MAVProxy: the next transfer follows at once."""
    assert upload(pilot, [at(WAYPOINT, 1.0, 2.0, 3.0)]) == ACCEPTED
    for ask, answer in (
        (mavlink.MAVLink_mission_request_list_message(1, 1, FENCE), "MISSION_COUNT"),
        (mavlink.MAVLink_mission_clear_all_message(1, 1, RALLY), "MISSION_ACK"),
        (mavlink.MAVLink_mission_count_message(1, 1, 1, FENCE), "MISSION_REQUEST_INT"),
    ):
        pilot.send(mavlink.MAVLink_mission_request_list_message(1, 1, MISSION))
        pilot.send(mavlink.MAVLink_mission_request_int_message(1, 1, 0, MISSION))
        before = pilot.time_s
        pilot.send(ask)
        pilot.fly(0.004)
        assert len(pilot.all(answer, before)) >= 1 and not pilot.texts, answer
        assert not [ack for ack in pilot.all("MISSION_ACK", before) if ack.type != ACCEPTED]


@pytest.mark.parametrize(
    "empties",
    [mavlink.MAVLink_mission_clear_all_message(1, 1, MISSION), mavlink.MAVLink_mission_count_message(1, 1, 0, MISSION)],
)
def test_the_last_item_requested_again_when_the_mission_has_gone(pilot: ForeignPilot, empties: Any) -> None:
    assert upload(pilot, ROWS[MISSION]) == ACCEPTED
    pilot.send(mavlink.MAVLink_mission_request_list_message(1, 1, MISSION))
    for number in range(len(ROWS[MISSION])):
        pilot.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, MISSION))
    pilot.send(empties)
    pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ACCEPTED
    pilot.send(mavlink.MAVLink_mission_request_int_message(1, 1, len(ROWS[MISSION]) - 1, MISSION))
    pilot.fly(0.004)
    assert pilot.last("MISSION_ACK").type == ERROR


def test_the_current_item_is_set_and_said(pilot: ForeignPilot) -> None:
    upload(pilot, ROWS[MISSION])
    pilot.fly(0.004)
    assert (pilot.last("MISSION_CURRENT").seq, pilot.last("MISSION_CURRENT").total) == (0, 4)
    pilot.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    pilot.fly(0.004)
    assert pilot.last("MISSION_CURRENT").seq == 2
    assert pilot.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 3) == mavlink.MAV_RESULT_ACCEPTED
    assert pilot.last("MISSION_CURRENT").seq == 3
    assert pilot.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 4) == mavlink.MAV_RESULT_DENIED
    assert pilot.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 4, 1) == mavlink.MAV_RESULT_DENIED
    pilot.fly(0.004)
    assert pilot.last("MISSION_CURRENT").seq == 3, "what is refused resets nothing"
    pilot.send(mavlink.MAVLink_mission_set_current_message(1, 1, 9))
    pilot.fly(0.004)
    assert pilot.last("MISSION_CURRENT").seq == 3 and "Mission item 9 is not in the list" in pilot.texts
    for params, current in (((-1,), 3), ((2, 1), 2), ((-1, 1), 0)):
        assert pilot.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, *params) == mavlink.MAV_RESULT_ACCEPTED
        assert pilot.last("MISSION_CURRENT").seq == current
