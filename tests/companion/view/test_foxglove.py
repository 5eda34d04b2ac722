"""What Foxglove is given, read back by the libraries that its makers publish."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from mcap_ros1.decoder import DecoderFactory as Ros1DecoderFactory

from companion.logs.writer import Writer
from companion.view.foxglove import convert
from protocol.flightlog import DATAGRAM, TEXT, Direction, FlightLogError, LogReader
from protocol.frames import from_euler
from protocol.messages import Encoder, dialect
from protocol.toml_files import ROOT
from tests.companion.view.made_logs import SPEED, STEP_NS, Values, from_tlog, make, telemetry

DATA = Path(__file__).resolve().parents[2] / "data"
SCHEMAS = {
    "transforms": "foxglove.FrameTransforms",
    "pose": "foxglove.PoseInFrame",
    "path": "foxglove.PosesInFrame",
    "reference": "foxglove.PoseInFrame",
    "reference_path": "foxglove.PosesInFrame",
    "ring": "foxglove.LaserScan",
    "map": "foxglove.Grid",
    "guard": "foxglove.SceneUpdate",
    "plan": "foxglove.SceneUpdate",
    "world": "foxglove.SceneUpdate",
    "vehicle": "foxglove.SceneUpdate",
    "log": "foxglove.Log",
}


def decoded(path: Path) -> dict[str, list[tuple[int, Any]]]:
    found: dict[str, list[tuple[int, Any]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory(), Ros1DecoderFactory()])
        for schema, channel, message, content in reader.iter_decoded_messages():
            name = channel.topic.removeprefix("/foxglove/")
            if name != channel.topic and schema is not None:
                assert schema.name == SCHEMAS.get(name, "foxglove.LocationFix")
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def turned(orientation: Any, x: float, y: float, z: float) -> list[float]:
    """A vector by a quaternion, by the definition q v q*."""
    w, i, j, k = orientation.w, orientation.x, orientation.y, orientation.z
    matrix = [
        [1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)],
        [2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)],
        [2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)],
    ]
    return [float(value) for value in np.array(matrix) @ (x, y, z)]


def test_every_topic_is_there_with_foxgloves_own_schema_and_all_that_was_recorded(tmp_path: Path) -> None:
    def change(time: float, values: Values) -> None:
        values["guard_reason"] = 2 * (time >= 2.0)

    log = make(tmp_path, 4.0, change=change)
    before = log.read_bytes()
    target, added, _ = convert(log)
    assert target == tmp_path / "flight_foxglove.mcap"
    found = decoded(target)
    mine = {topic for topic in found if topic.startswith("/foxglove/")}
    assert {topic.removeprefix("/foxglove/") for topic in mine} == set(SCHEMAS)
    assert added == sum(len(found[topic]) for topic in mine)
    source = LogReader(log)
    for topic in source.topics:
        if topic != DATAGRAM.topic:
            recorded = [record.time_ns for record in source.records((topic,))]
            assert [time for time, _ in found.get(topic, [])] == recorded
    with target.open("rb") as file:
        attachments = {each.name: each.data for each in make_reader(file, validate_crcs=True).iter_attachments()}
    assert attachments == source.attachments
    assert log.read_bytes() == before


def test_poses_are_east_north_up_and_the_nose_points_north(tmp_path: Path) -> None:
    found = decoded(convert(make(tmp_path, 4.0))[0])
    time, transforms = found["/foxglove/transforms"][50]
    (transform,) = transforms.transforms
    assert (transform.parent_frame_id, transform.child_frame_id) == ("local_origin", "base_link")
    place = transform.translation
    assert [place.x, place.y, place.z] == pytest.approx([0.0, SPEED * time * 1e-9, 3.0], abs=1e-5)
    assert turned(transform.rotation, 1.0, 0.0, 0.0) == pytest.approx([0.0, 1.0, 0.0]), "forward is north"
    assert turned(transform.rotation, 0.0, 1.0, 0.0) == pytest.approx([-1.0, 0.0, 0.0]), "left is west"
    assert turned(transform.rotation, 0.0, 0.0, 1.0) == pytest.approx([0.0, 0.0, 1.0]), "up is up"
    assert transform.timestamp.seconds * 1_000_000_000 + transform.timestamp.nanos == time
    path = found["/foxglove/path"][-1][1].poses
    assert [pose.position.y for pose in path] == sorted(pose.position.y for pose in path)
    assert path[-1].position.y == pytest.approx(SPEED * 3.0, abs=0.1)


def flown(path: Path, back_s: int = 0) -> Path:
    """A vehicle's telemetry of 20 s from 2023, with a clock that is set back in the middle."""
    vehicle = Encoder(1, 1)
    with Writer(path, 17 * 10**17, {}) as writer:
        for number in range(1000):
            time_ns = 20_000_000 * number + (back_s * 10**9 if number < 500 else 0)
            writer.datagram(time_ns, number, Direction.IN, "", telemetry(vehicle, number, 1.0))
    return path


def test_a_log_whose_start_is_damaged_is_drawn_as_a_whole_one(tmp_path: Path) -> None:
    """Its times count from 1970 then."""
    whole, damaged = flown(tmp_path / "whole.mcap"), tmp_path / "damaged.mcap"
    damaged.write_bytes(whole.read_bytes().replace(b"epoch_ns", b"epoch_xx"))
    counts = []
    for path in (whole, damaged):
        found = decoded(convert(path, tmp_path / "drawn.mcap").path)
        counts.append({topic: len(messages) for topic, messages in found.items()})
    assert counts[0] == counts[1] and counts[0]["/foxglove/path"] > 10


def test_a_clock_that_was_set_back_stops_no_topic(tmp_path: Path) -> None:
    poses = decoded(convert(flown(tmp_path / "back.mcap", 100)).path)["/foxglove/pose"]
    late = [time_ns for time_ns, _ in poses if time_ns < 17 * 10**17 + 50 * 10**9]
    assert len(late) == len(poses) - len(late) > 50


def test_the_reference_looks_where_its_yaw_says(tmp_path: Path) -> None:
    def change(_: float, values: Values) -> None:
        values["reference_yaw"] = math.radians(30.0)

    reference = decoded(convert(make(tmp_path, 1.0, change=change))[0])["/foxglove/reference"][3][1]
    wanted = [math.sin(math.radians(30.0)), math.cos(math.radians(30.0)), 0.0]
    assert turned(reference.pose.orientation, 1.0, 0.0, 0.0) == pytest.approx(wanted)
    assert from_euler(0.0, 0.0, math.radians(30.0))[3] > 0.0, "a positive yaw is to the right, as east is of north"


def test_the_ring_s_return_is_ahead_and_to_the_right(tmp_path: Path) -> None:
    scan = decoded(convert(make(tmp_path, 1.0))[0])["/foxglove/ring"][0][1]
    ranges = np.array(scan.ranges)
    angles = np.linspace(scan.start_angle, scan.end_angle, len(ranges))
    (hit,) = np.flatnonzero(np.isfinite(ranges))
    x, y = ranges[hit] * math.cos(angles[hit]), ranges[hit] * math.sin(angles[hit])
    assert [x, y] == pytest.approx([3.0 / math.sqrt(2.0), -3.0 / math.sqrt(2.0)]), "left is positive"
    assert scan.frame_id == "base_link"


def test_the_map_is_where_the_ring_saw_something(tmp_path: Path) -> None:
    """One return of a vehicle that hovers 10 m north of its home, 3 m away to the north-east."""
    log, vehicle, north = tmp_path / "hovering.mcap", Encoder(1, 1), 10.0
    with Writer(log, 0, {}) as writer:
        for step in range(500):
            data = telemetry(vehicle, step, north)
            writer.datagram(step * STEP_NS, step, Direction.IN, "", data)
    _, grid = decoded(convert(log)[0])["/foxglove/map"][-1]
    cells = np.frombuffer(grid.data, np.uint8).reshape(-1, grid.column_count, 4)
    assert (grid.row_stride, grid.cell_stride) == (4 * grid.column_count, 4)
    assert [(field.name, field.offset) for field in grid.fields] == [
        ("red", 0),
        ("green", 1),
        ("blue", 2),
        ("alpha", 3),
    ]
    assert (grid.pose.orientation.w, grid.frame_id) == (1.0, "local_origin")

    def cell(east: float, north: float) -> tuple[int, int]:
        x, y = east - grid.pose.position.x, north - grid.pose.position.y
        return math.floor(y / grid.cell_size.y), math.floor(x / grid.cell_size.x)

    red = cells[..., 0] > cells[..., 2]
    reach = 3.0 / math.sqrt(2.0)
    corner = [grid.pose.position.y, grid.pose.position.x]
    away = np.linalg.norm((np.argwhere(red) + 0.5) * grid.cell_size.x + corner - [north + reach, reach], axis=1)
    assert away.min() < grid.cell_size.x
    assert away.max() < 2.5, "nothing else stands there"
    free = cells[cell(0.0, north + 2.0)]
    assert free[2] > free[0] and free[3] > 0, "ahead"
    assert cells[cell(15.0, north)][3] == 0, "beyond the ring's 5 m nothing is known"


def test_the_guard_is_shown_while_it_acts_and_why(tmp_path: Path) -> None:
    def change(time: float, values: Values) -> None:
        if 1.0 <= time < 1.1 or 3.0 <= time < 3.003:
            values["guard_reason"], values["guard_change"] = 2, 1.25

    shown = decoded(convert(make(tmp_path, 4.0, change=change, trace_rate=50.0))[0])["/foxglove/guard"]
    assert [round(time * 1e-9, 2) for time, _ in shown] == [1.0, 1.1, 3.0]
    (entity,) = shown[0][1].entities
    assert entity.texts[0].text == "stop, 1.2 m/s²"
    assert entity.cylinders[0].pose.position.y == pytest.approx(SPEED, abs=0.05)
    assert 0 < entity.lifetime.nanos < 1_000_000_000


def test_the_plan_is_the_way_over_the_map(tmp_path: Path) -> None:
    around = [(3.9, 0.0), (4.0, 1.0), (8.0, 1.5), (12.0, 0.0)]
    log = make(tmp_path, 4.0, planned=lambda time: around if time >= 2.0 else [])
    for time, message in decoded(convert(log)[0])["/foxglove/plan"]:
        (entity,) = message.entities
        (line,) = entity.lines
        wanted = [(0.0, SPEED * time * 1e-9)]
        wanted += [(east, north) for north, east in around[1:]] if time >= 2.1e9 else [(0.0, 0.0)]
        if not 2.0e9 <= time < 2.1e9:
            assert np.array([(point.x, point.y) for point in line.points]) == pytest.approx(np.array(wanted), abs=0.01)


@pytest.mark.parametrize("name", ["px4_offboard", "ardupilot_guided"])
def test_flights_of_other_systems_are_drawn_too(tmp_path: Path, name: str) -> None:
    log = from_tlog(DATA / f"{name}.tlog", tmp_path)
    found = decoded(convert(log)[0])
    poses = found["/foxglove/pose"]
    recorded = list(LogReader(log).records(("/mavlink/1/1/LOCAL_POSITION_NED",)))
    kind = LogReader(log).topics["/mavlink/1/1/LOCAL_POSITION_NED"]
    highest = max(-kind.unpack(record.data)["z"] for record in recorded)
    assert max(pose.pose.position.z for _, pose in poses) == pytest.approx(highest, abs=0.1)
    fix = found["/foxglove/fix"][-1][1]
    assert abs(fix.latitude) > 1.0 and abs(fix.longitude) > 1.0
    texts = found.get("/foxglove/log", [])
    assert [said.message for _, said in texts] == [
        kinds.unpack(record.data)["text"]
        for topic, kinds in LogReader(log).topics.items()
        if topic.endswith("/STATUSTEXT")
        for record in LogReader(log).records((topic,))
    ]


def test_the_vehicle_s_words_are_there_once(tmp_path: Path) -> None:
    """By the companion's log, which repeats them; without one by the sender's ids."""
    said = Encoder(1, 1).encode_fields(dialect.MAVLink_statustext_message, 4, b"low battery")
    for own in (False, True):
        log = tmp_path / f"{own}.mcap"
        with Writer(log, 0, {}) as writer:
            writer.datagram(0, 0, Direction.IN, "", said)
            if own:
                writer.record(TEXT, 1, 1, TEXT.pack(0, 1, 3, "low battery", "vehicle", "", 0))
        ((_, line),) = decoded(convert(log)[0])["/foxglove/log"]
        assert (line.message, line.name) == ("low battery", "vehicle" if own else "1/1")


def test_a_long_text_of_a_vehicle_is_one_line(tmp_path: Path) -> None:
    """Also one that the log's end cuts off."""
    texts, vehicle = ("Arming denied: Resolve system health failures first, please", "x" * 60), Encoder(1, 1)
    log = tmp_path / "long.mcap"
    with Writer(log, 0, {}) as writer:
        for number, text in enumerate(texts):
            for piece in range(2 - number):
                part = text[50 * piece :][:50].encode()
                said = vehicle.encode_fields(dialect.MAVLink_statustext_message, 4, part, number + 1, piece)
                writer.datagram(10 * number + piece, 0, Direction.IN, "", said)
    lines = [line for _, line in decoded(convert(log)[0])["/foxglove/log"]]
    assert [(line.message, line.name, line.level) for line in lines] == [(texts[0], "1/1", 3), ("x" * 50, "1/1", 3)]


def test_a_log_is_never_written_over(tmp_path: Path) -> None:
    log = make(tmp_path, 1.0)
    before = log.read_bytes()
    with pytest.raises(FlightLogError, match="never written over"):
        convert(log, log)
    assert log.read_bytes() == before


def test_the_layout_shows_only_what_there_is(tmp_path: Path) -> None:
    """Topics and fields that the layout names are in a converted flight of our own."""
    layout = json.loads((ROOT / "docs" / "foxglove_layout.json").read_text(encoding="utf-8"))
    topics = LogReader(make(tmp_path, 0.1)).topics
    fields = {topic: {field.name for field in kind.fields} for topic, kind in topics.items()}
    plotted = [path["value"] for panel in layout["configById"].values() for path in panel.get("paths", ())]
    assert plotted
    for path in plotted:
        topic, _, field = path.partition(".")
        assert field.partition("[")[0].partition(".")[0] in fields[topic], path
    drawn = {topic for panel in layout["configById"].values() for topic in panel.get("topics", ())}
    assert {topic.removeprefix("/foxglove/") for topic in drawn} <= set(SCHEMAS)

    def panels(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else [*panels(node["first"]), *panels(node["second"])]

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])


@pytest.mark.parametrize("flown", [2, 1])
def test_of_several_vehicles_one_is_drawn(tmp_path: Path, flown: int) -> None:
    """The one that is flown, or else tells its place most; the other one's place is no leap of it, and its ring none of
    its own."""
    drawn, other = Encoder(2, 1), Encoder(1, 1)
    with Writer(tmp_path / "two.mcap", 0, {}) as writer:
        for number in range(1000):
            told = telemetry(drawn, number, 50.0)
            if number % 2:
                told += telemetry(other, number - 1, 0.0)
            writer.datagram(7_000_000 * number, number, Direction.IN, "", told)
        if flown == 1:
            fields = (0, 1, 1, 0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5)
            sent = Encoder(1, 191).encode_fields(dialect.MAVLink_set_attitude_target_message, *fields)
            writer.datagram(7_000_000_000, 1000, Direction.OUT, "", sent)
    found = decoded(convert(tmp_path / "two.mcap")[0])
    poses = [pose for _, pose in found["/foxglove/pose"]]
    assert len(poses) > 50 and {round(each.pose.position.y) for each in poses} == {50 if flown == 2 else 0}
    assert len(found["/foxglove/ring"]) == (40 if flown == 2 else 20)
