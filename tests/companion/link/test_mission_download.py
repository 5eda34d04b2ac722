"""The download of a vehicle's mission: what is lost is asked for again, and each end has its words."""

from typing import Any

import pytest

from companion.link.mission_download import INTERVAL_NS, TRIES, MissionDownload
from protocol.messages import dialect

VEHICLE = (1, 1)
LIST, REQUEST, ACK = (
    dialect.MAVLink_mission_request_list_message,
    dialect.MAVLink_mission_request_int_message,
    dialect.MAVLink_mission_ack_message,
)


def count(number: int, kind: int = 0) -> Any:
    return dialect.MAVLink_mission_count_message(1, 191, number, kind)


def item(number: int, kind: int = 0) -> Any:
    return dialect.MAVLink_mission_item_int_message(1, 191, number, 6, 16, 0, 1, 0, 0, 0, 0, 470000000, 0, 5.0, kind)


def ended(result: int) -> Any:
    return dialect.MAVLink_mission_ack_message(1, 191, result, 0)


def test_items_come_in_order_though_some_are_lost_or_come_twice() -> None:
    download, now = MissionDownload(), 0
    assert download.ask(now, VEHICLE) == (LIST, (*VEHICLE, 0))
    assert download.ask(now + INTERVAL_NS - 1, VEHICLE) is None
    now += INTERVAL_NS
    assert download.ask(now, VEHICLE) == (LIST, (*VEHICLE, 0)), "again"
    download.take(item(0))
    download.take(count(7, kind=1))
    assert download.count is None and not download.items, "of a fence, or before the count"
    for message in (count(2), count(2)):
        download.take(message)
    assert download.ask(now, VEHICLE) == (REQUEST, (*VEHICLE, 0, 0))
    for message in (item(1), item(0, kind=2), item(0), item(0), ended(dialect.MAV_MISSION_INVALID_SEQUENCE)):
        download.take(message)
    assert [each.seq for each in download.items] == [0]
    assert download.ask(now, VEHICLE) == (REQUEST, (*VEHICLE, 1, 0))
    download.take(item(1))
    assert not download.over
    assert download.ask(now, VEHICLE) == (ACK, (*VEHICLE, dialect.MAV_MISSION_ACCEPTED, 0))
    assert download.over and not download.fault and download.ask(now + INTERVAL_NS, VEHICLE) is None
    download.take(item(2))
    assert [each.seq for each in download.items] == [0, 1]


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        ([], f"asked {TRIES} times for its mission"),
        ([count(3), item(0)], f"asked {TRIES} times for item 1 of its 3"),
        ([count(0)], "no mission stored"),
        ([ended(dialect.MAV_MISSION_DENIED)], "MAV_MISSION_DENIED"),
        ([ended(42)], "does not give its mission: 42"),
        ([count(3), item(0), ended(dialect.MAV_MISSION_ERROR)], "MAV_MISSION_ERROR"),
    ],
)
def test_what_ends_without_a_mission(messages: list[Any], words: str) -> None:
    download, sent = MissionDownload(), []
    for tick in range(3 * TRIES):
        sent.append(download.ask(tick * INTERVAL_NS, VEHICLE))
        if messages:
            download.take(messages.pop(0))
        if download.over:
            break
    assert words in download.fault
    assert sent[-1] == (ACK, (*VEHICLE, dialect.MAV_MISSION_OPERATION_CANCELLED, 0))
