"""Whose is what is shown of a log or a link with several vehicles, and with scanners that are not the autopilot's."""

from pathlib import Path

import numpy as np
import pytest

from companion.logs.writer import Writer
from companion.records import TRACE
from companion.view.accumulators.scans import ring_sender
from companion.view.finding import Level
from companion.view.findings import findings
from companion.view.gather import GatheredFlight
from companion.view.report_charts import best_line, charts
from companion.view.sources import FinishedLog
from protocol.flightlog import Direction, LogReader
from protocol.messages import Encoder, dialect
from tests.companion.view.made_logs import packed, trace_values
from tests.companion.view.test_live import filled

CM = 300
"""The range of the nearest return."""
COMPANION = Encoder(2, 191)


def said(system: int, number: int) -> bytes:
    """By a vehicle at 50 Hz; one stands 10 m beside the other."""
    vehicle, boot_ms = Encoder(system, 1), 20 * number
    place = (boot_ms, 0.0, 10.0 * system, -3.0, 0.0, 0.0, 0.0)
    data = vehicle.encode_fields(dialect.MAVLink_local_position_ned_message, *place)
    data += vehicle.encode_fields(dialect.MAVLink_attitude_quaternion_message, boot_ms, 1.0, 0, 0, 0, 0, 0, 0)
    if number % 50 == 0:
        data += vehicle.encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 209, 6 << 16, 4, 3)
    return data


def ring(system: int, component: int, number: int, cm: int) -> bytes:
    distances = [501] * 72
    distances[9] = cm
    fields = (20_000 * number, 0, distances, 5, 20, 500, 5.0, 0.0, dialect.MAV_FRAME_BODY_FRD)
    return Encoder(system, component).encode_fields(dialect.MAVLink_obstacle_distance_message, *fields)


@pytest.mark.parametrize("scanner", [(1, 196), (42, 7)])
def test_a_scanner_s_own_rings_are_around_the_vehicle(tmp_path: Path, scanner: tuple[int, int]) -> None:
    """Another component of its system, or one with ids of its own; not those of another vehicle's scanner."""
    with Writer(tmp_path / "flight.mcap", 0, {}) as writer:
        for number in range(200):
            data = said(1, number) + said(2, number)[: 0 if number % 2 else None]
            data += ring(*scanner, number, CM) + ring(2, 196, number, 100)
            writer.datagram(20_000_000 * number, number, Direction.IN, "", data)
    history = filled(FinishedLog(LogReader(tmp_path / "flight.mcap")))
    moment = history.at(3.0)
    assert history.vehicles[0] == "1/1" and moment.nearest == pytest.approx(0.01 * CM)
    assert np.allclose(moment.returns_frd, [[2.1213, 2.1213, 0.0]], atol=1e-3)
    assert len(list(history.scans(0.0, 3.0))) > 100 and history.clearance(1.0, 3.0)[1].min() == pytest.approx(3.0)
    flight = GatheredFlight(tmp_path / "flight.mcap")
    assert flight.vehicle == "1/1" and "ring" in [chart.kind for chart in charts(flight)]
    line = best_line(flight, "clearance")
    assert line is not None and line.points()[1].max() == pytest.approx(0.01 * CM)


def test_who_scans_is_chosen_as_the_companion_does() -> None:
    vehicles = ("1/1", "2/1")
    assert ring_sender("1/1", (), vehicles) == ""
    assert ring_sender("1/1", ("1/1", "2/1", "2/196"), vehicles) == "1/1"
    assert ring_sender("1/1", ("1/196", "1/1", "2/196"), vehicles) == "1/196"
    assert ring_sender("1/1", ("7/9", "1/1", "1/196"), vehicles) == "7/9"
    assert ring_sender("2/1", ("1/196", "1/1"), vehicles) == ""


def test_a_scanner_that_is_heard_is_no_link_to_the_vehicle(tmp_path: Path) -> None:
    with Writer(tmp_path / "flight.mcap", 0, {}) as writer:
        for number in range(200):
            data = ring(1, 196, number, CM) + (said(1, number) if number < 100 else b"")
            writer.datagram(20_000_000 * number, number, Direction.IN, "", data)
    moment = filled(FinishedLog(LogReader(tmp_path / "flight.mcap"))).at(3.9)
    assert moment.nearest == pytest.approx(3.0) and moment.link_age == pytest.approx(1.92)


@pytest.mark.parametrize("state", [5, 6, 8], ids=["critical", "emergency", "flight termination"])
def test_a_vehicle_in_its_failsafe_says_so(tmp_path: Path, state: int) -> None:
    with Writer(tmp_path / "flight.mcap", 0, {}) as writer:
        for number in range(4):
            beat = (2, 12, 209, 10 << 16, 4 if number < 2 else state, 3)
            data = Encoder(1, 1).encode_fields(dialect.MAVLink_heartbeat_message, *beat)
            writer.datagram(1_000_000_000 * number, number, Direction.IN, "", data)
    history = filled(FinishedLog(LogReader(tmp_path / "flight.mcap")))
    assert [history.at(time).failsafe for time in (1.0, 2.0)] == [False, True]
    (finding,) = [each for each in findings(GatheredFlight(tmp_path / "flight.mcap")) if each.about == "failsafe"]
    assert finding.level is Level.PROBLEM and finding.at == (2.0,)


def test_what_a_vehicle_never_says_to_its_end_is_shown_soon(tmp_path: Path) -> None:
    """On the page of a flight that has no log of the companion's: the last piece of the text is lost."""
    with Writer(tmp_path / "flight.mcap", 0, {}) as writer:
        for number in range(200):
            data = said(1, number)
            if number == 60:
                data += Encoder(1, 1).encode_fields(dialect.MAVLink_statustext_message, 2, b"x" * 50, 7, 0)
            writer.datagram(20_000_000 * number, number, Direction.IN, "", data)
    (text,) = filled(FinishedLog(LogReader(tmp_path / "flight.mcap"))).texts
    assert (text.text, text.source) == ("x" * 50, "1/1") and text.time == pytest.approx(1.2)


def test_the_vehicle_that_the_companion_flies_is_told_of(tmp_path: Path) -> None:
    """Also where another one on the same link says more, and was heard first."""
    with Writer(tmp_path / "flight.mcap", 0, {}) as writer:
        for number in range(400):
            now = 10_000_000 * number
            writer.datagram(now, number, Direction.IN, "", said(1, number))
            writer.record(TRACE, now, number, packed(trace_values(now * 1e-9)))
            if number % 2:
                writer.datagram(now, number, Direction.IN, "", said(2, number // 2))
                fields = (number, 2, 1, 0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5)
                sent = COMPANION.encode_fields(dialect.MAVLink_set_attitude_target_message, *fields)
                writer.datagram(now, number, Direction.OUT, "", sent)
    history = filled(FinishedLog(LogReader(tmp_path / "flight.mcap")))
    place = history.at(3.0).position_ned
    assert history.vehicles == ("2/1",) and place is not None and place[1] == 20.0
    flight = GatheredFlight(tmp_path / "flight.mcap")
    assert flight.vehicle == "2/1"
    east = best_line(flight, "position_ned.1")
    assert east is not None and set(east.points()[1].tolist()) == {20.0}
