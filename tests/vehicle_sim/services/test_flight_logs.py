"""The vehicle's own logs, as PX4's reader and MAVLink's log protocol see them."""

import io
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pyulog import ULog

from tests.vehicle_sim.foreign_pilot import LAND, UNSET, ForeignPilot
from vehicle_sim.services import flight_logs

EVERY = 0, 0xFFFF
WHOLE = 0, 0xFFFFFFFF
PIECE = 90


def hop(pilot: ForeignPilot) -> None:
    """Arm, climb, come down, disarm."""
    pilot.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 7)
    assert pilot.arm() == mavlink.MAV_RESULT_ACCEPTED
    assert pilot.fly(10.0, until=lambda: pilot.height > 1.0)
    pilot.set_mode(LAND)
    assert pilot.fly(20.0, until=lambda: not pilot.vehicle.flight.armed)


@pytest.fixture(scope="module")
def flown() -> ForeignPilot:
    """Two short flights."""
    pilot = ForeignPilot()
    pilot.fly(1.2)
    hop(pilot)
    hop(pilot)
    return pilot


def entries(pilot: ForeignPilot, first: int, last: int) -> list[Any]:
    before = pilot.time_s
    pilot.send(mavlink.MAVLink_log_request_list_message(1, 1, first, last))
    pilot.fly(0.02)
    return pilot.all("LOG_ENTRY", before)


def pieces(pilot: ForeignPilot, number: int, start: int, count: int) -> list[Any]:
    before = pilot.time_s
    pilot.send(mavlink.MAVLink_log_request_data_message(1, 1, number, start, count))
    pilot.fly(0.1, until=lambda: pilot.all("LOG_DATA", before) != [])
    said = -1
    while said != (said := len(pilot.all("LOG_DATA", before))):
        pilot.fly(0.004)
    return pilot.all("LOG_DATA", before)


def content(told: list[Any]) -> bytes:
    return b"".join(bytes(each.data[: each.count]) for each in told)


def test_before_a_flight_there_is_none_and_it_says_so() -> None:
    pilot = ForeignPilot()
    (entry,) = entries(pilot, *EVERY)
    assert (entry.num_logs, entry.last_log_num, entry.size) == (0, 0, 0)
    (data,) = pieces(pilot, 3, 90, 90)
    assert (data.id, data.ofs, data.count) == (3, 90, 0)


def test_each_flight_is_a_log_that_px4s_reader_reads(flown: ForeignPilot) -> None:
    first, second = entries(flown, *EVERY)
    assert [(each.id, each.num_logs, each.last_log_num) for each in (first, second)] == [(0, 2, 1), (1, 2, 1)]
    assert 0 < first.time_utc < second.time_utc < flown.time_s
    told = pieces(flown, 1, *WHOLE)
    assert [each.ofs for each in told] == [PIECE * number for number in range(len(told))]
    raw = content(told)
    assert len(raw) == second.size and raw == flown.vehicle._services._logs.files["log/1.ulg"]()
    log = ULog(io.BytesIO(raw))
    assert log.msg_info_dict["ver_sw_release_str"] == "1.16"
    assert log.initial_parameters["MIS_TAKEOFF_ALT"] == pytest.approx(2.5)
    words = [each.message for each in log.logged_messages]
    assert words[:2] == ["Armed", "Mode Takeoff"] and words[-1] == "Mode Hold" and "Disarmed by landing" in words
    place, truth = (log.get_dataset(f"vehicle_local_position{end}").data for end in ("", "_groundtruth"))
    assert set(np.diff(place["timestamp"])) == {48_000}
    assert -place["z"].min() > 1.0 and np.abs(place["z"] - truth["z"]).max() < 0.01
    assert np.median(np.abs(np.gradient(truth["z"], 0.048) - truth["vz"])) < 0.01
    attitude = log.get_dataset("vehicle_attitude").data
    assert np.allclose(sum(attitude[f"q[{axis}]"] ** 2 for axis in range(4)), 1.0)


def test_a_part_is_sent_and_a_part_of_the_list(flown: ForeignPilot) -> None:
    assert [each.id for each in entries(flown, 1, 1)] == [1]
    whole = content(pieces(flown, 0, *WHOLE))
    assert content(pieces(flown, 0, 100, 200)) == whole[100:300]
    last = pieces(flown, 0, len(whole) - PIECE, 2 * PIECE)
    assert [each.count for each in last] == [PIECE, 0]


def test_sending_ends_when_it_is_told_to(flown: ForeignPilot) -> None:
    flown.send(mavlink.MAVLink_log_request_data_message(1, 1, 0, *WHOLE))
    flown.fly(0.02)
    flown.send(mavlink.MAVLink_log_request_end_message(1, 1))
    flown.fly(0.02)
    before = flown.time_s
    flown.fly(0.1)
    assert not flown.all("LOG_DATA", before)


def test_the_oldest_gives_way_and_all_are_erased(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_logs, "MOST_BYTES", 7_000)
    pilot = ForeignPilot()
    pilot.fly(1.2)
    hop(pilot)
    logs = pilot.vehicle._services._logs
    begun = [each.begun_s for each in logs.whole]
    assert len(begun) == flight_logs.MOST_LOGS and begun == sorted(begun) and begun[0] > 1
    assert all(ULog(io.BytesIO(bytes(each.content))).data_list for each in logs.whole)
    pilot.send(mavlink.MAVLink_log_erase_message(1, 1))
    assert [each.size for each in entries(pilot, *EVERY)] == [0] and not logs.files
