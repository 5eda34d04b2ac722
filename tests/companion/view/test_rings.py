"""Rings that a vehicle sends as eighths, DISTANCE_SENSORs, are shown as those that come whole."""

import math
from pathlib import Path

import numpy as np
import pytest

from companion.config_avoidance import Avoidance
from companion.logs.writer import Writer
from companion.perception.map_view import FREE, UNKNOWN
from companion.view.findings import findings
from companion.view.foxglove import convert
from companion.view.gather import GatheredFlight
from companion.view.mapping import MapAt
from companion.view.report_charts import charts
from companion.view.report_page import unpacked
from companion.view.sources import FinishedLog
from protocol.flightlog import Direction, LogReader
from protocol.messages import Encoder, dialect
from tests.companion.view.test_foxglove import decoded
from tests.companion.view.test_live import filled
from tests.flights.test_sectors import FAR_CM, sensor

RIGHT_CM = 300
RINGS = 30


@pytest.fixture(scope="module", params=[False, True])
def log(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A vehicle that hovers with something on its right; nothing else is there, or the sector behind is broken."""
    name = "broken" if request.param else "whole"
    vehicle, path = Encoder(1, 1), tmp_path_factory.mktemp("rings") / f"{name}.mcap"
    with Writer(path, 0, {}) as writer:
        for number in range(RINGS):
            boot_ms = 1000 + 100 * number
            said = vehicle.encode_fields(dialect.MAVLink_local_position_ned_message, boot_ms, 0, 0, -3.0, 0, 0, 0)
            said += vehicle.encode_fields(dialect.MAVLink_attitude_quaternion_message, boot_ms, 1, 0, 0, 0, 0, 0, 0)
            for sector in range(8):
                fields = list(
                    sensor(sector, RIGHT_CM if sector == 2 else FAR_CM, quality=sector == 4 and request.param)
                )
                fields[0] = boot_ms
                said += vehicle.encode_fields(dialect.MAVLink_distance_sensor_message, *fields)
            writer.datagram(boot_ms * 1_000_000, number, Direction.IN, "", said)
    return path


def test_the_live_page_shows_what_is_on_the_right(log: Path) -> None:
    history = filled(FinishedLog(LogReader(log)))
    moment = history.at(history.end)
    assert moment.nearest == pytest.approx(0.01 * RIGHT_CM)
    assert np.allclose(moment.returns_frd, [[0.0, 0.01 * RIGHT_CM, 0.0]], atol=1e-9)
    shown = MapAt(Avoidance()).at(history.end, history.scans(-np.inf, history.end))
    assert shown is not None
    distance = shown[0].distance_at(np.array([0.0, 0.01 * RIGHT_CM, -3.0]))
    assert distance is not None and distance < 0.3
    behind = shown[0].states[shown[0].cell_of(np.array([-4.0, 0.0, -3.0]))]
    assert behind == (UNKNOWN if log.stem == "broken" else FREE)


def test_the_report_has_the_nearest_range(log: Path) -> None:
    flight = GatheredFlight(log)
    assert flight.scanner == "1/1"
    times, nearest = flight.lines["1/1/OBSTACLE_DISTANCE:nearest"].points()
    assert len(times) == RINGS and np.allclose(nearest, 0.01 * RIGHT_CM)
    (chart,) = (each for each in charts(flight) if each.kind == "ring")
    bearings = unpacked(chart.curves[0].y)
    assert sorted(bearings) == [45.0 * sector for sector in range(-4, 4)]


def test_foxglove_has_ring_and_map(log: Path) -> None:
    found = decoded(convert(log)[0])
    rings = [ring for _, ring in found["/foxglove/ring"]]
    assert len(rings) == RINGS and len(found["/foxglove/map"]) > 0
    finite = np.isfinite(rings[-1].ranges)
    bearings = np.linspace(rings[-1].start_angle, rings[-1].end_angle, finite.size)
    (hit,) = np.flatnonzero(finite)
    assert np.degrees(bearings[hit]) == pytest.approx(-90.0), "to the left is positive there"
    assert rings[-1].ranges[hit] == pytest.approx(0.01 * RIGHT_CM)


def test_a_range_sensor_beside_whole_rings_is_no_part_of_one(tmp_path: Path) -> None:
    vehicle, path = Encoder(1, 1), tmp_path / "both.mcap"
    whole = [FAR_CM + 1] * 72
    with Writer(path, 0, {}) as writer:
        for number in range(RINGS):
            ring = (100_000 * number, 0, whole, 5, 20, FAR_CM, 5.0, 0.0, dialect.MAV_FRAME_BODY_FRD)
            said = vehicle.encode_fields(dialect.MAVLink_obstacle_distance_message, *ring)
            said += vehicle.encode_fields(dialect.MAVLink_distance_sensor_message, *sensor(0, RIGHT_CM))
            writer.datagram(100_000_000 * number, number, Direction.IN, "", said)
    assert len(decoded(convert(path)[0])["/foxglove/ring"]) == RINGS


@pytest.mark.parametrize(
    ("increment", "offset", "frame"),
    [
        (math.nan, 0.0, dialect.MAV_FRAME_BODY_FRD),
        (5.0, math.nan, dialect.MAV_FRAME_BODY_FRD),
        (math.inf, 0.0, dialect.MAV_FRAME_BODY_FRD),
        (0.0, 0.0, dialect.MAV_FRAME_BODY_FRD),
        (5.0, 0.0, dialect.MAV_FRAME_GLOBAL),
    ],
)
def test_a_ring_whose_beams_look_nowhere_is_none(increment: float, offset: float, frame: int, tmp_path: Path) -> None:
    """Nor is one from the north on. Report, live page and Foxglove show those before it."""
    vehicle, path = Encoder(1, 1), tmp_path / "odd.mcap"
    distances = [RIGHT_CM, *[FAR_CM + 1] * 71]
    with Writer(path, 0, {}) as writer:
        for number in range(RINGS + 1):
            last = (5.0, 90.0, dialect.MAV_FRAME_BODY_FRD) if number < RINGS else (increment, offset, frame)
            ring = (100_000 * number, 0, distances, 0, 20, FAR_CM, *last)
            said = vehicle.encode_fields(dialect.MAVLink_obstacle_distance_message, *ring)
            writer.datagram(100_000_000 * number, number, Direction.IN, "", said)
    flight, history = GatheredFlight(path), filled(FinishedLog(LogReader(path)))
    assert len(flight.lines["1/1/OBSTACLE_DISTANCE:nearest"].points()[0]) == RINGS
    scans = flight.scans.of["1/1"]
    assert (scans.offset_deg, scans.increment_deg) == (90.0, 5.0)
    assert len([each for each in charts(flight) if each.kind == "ring"]) == 1
    assert np.allclose(history.at(history.end).returns_frd, [[0.0, 0.01 * RIGHT_CM, 0.0]], atol=1e-9)
    assert [each.text for each in findings(flight) if each.about == "rings"] == [
        "Not drawn: one ring without bearings from the vehicle's nose."
    ]
    assert len(decoded(convert(path)[0])["/foxglove/ring"]) == RINGS
