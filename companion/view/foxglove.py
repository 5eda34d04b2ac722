"""`companion foxglove`: a copy of a log with topics that Foxglove draws without an extension.

The copy holds everything that was recorded except the bare datagrams. It is made after the flight and costs the flight
nothing. The frames are those of Foxglove's own converter for PX4: `local_origin` (east, north, up) and `base_link`
(forward, left, up). The schemas are Foxglove's, encoded as protobuf.
"""

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector2_pb2 import Vector2
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from companion.known_topics import is_foreign
from companion.logs.recordings import EXPORT_LIBRARY, commanded, has_texts, unpack
from companion.logs.target import output
from companion.records import LOGGED, PLANNED
from companion.state import Reason
from companion.view.accumulators.texts import Text, VehicleLines
from companion.view.attitudes import quaternions
from companion.view.lines import Floats, Track
from companion.view.mapping import NAMES, Mapper, avoidance_of, picture
from companion.view.rings import RING, SECTOR, RingTables, shows_around
from companion.view.scene import mesh, solids
from protocol.arrays import Array
from protocol.flightlog import DATAGRAM, TEXT, LogReader, Record
from protocol.frames import enu_to_ned, multiply

WORLD_FRAME, BODY_FRAME = "local_origin", "base_link"
_POSE_EVERY_S = 0.02
_PLAN_EVERY_S = 0.1
_MAP_EVERY_S = 1.0
_MAP_UP_M = 0.02
"""Height (m) of the map above the ground, so that the ground does not hide it."""
_GUARD_SHOWN_S = 0.3
_PATH_POINTS = 300
_ENU_NED = np.array([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0])
_FRD_FLU = np.array([0.0, 1.0, 0.0, 0.0])
_REASONS = {reason.value: reason.name.lower().replace("_", " ") for reason in Reason}


class Converter:
    """Copies the records of a log into another file and adds topics under /foxglove."""

    def __init__(self, log: LogReader, writer: Writer) -> None:
        self._log = log
        self._writer = writer
        self._copied: dict[str, int] = {}
        self._added: dict[str, tuple[int, int]] = {}
        self._written: dict[str, int] = {}
        """When (ns) each of what is thinned was written last."""
        self._position_ned: Array | None = None
        self._tracks = {name: Track(8, _PATH_POINTS) for name in ("path", "reference_path")}
        self._way = np.empty((0, 2))
        """(k, 2) north and east (m) of the last planned corners; the first is where the vehicle was then."""
        self._mapper = Mapper(avoidance_of(log.attachments.get("settings.json", b"{}")))
        self._start_ns = 0
        self._has_texts = has_texts(log)
        self._lines = VehicleLines()
        self._rings = RingTables()
        self._kinds = log.topics
        self._foreign = {topic for topic, kind in self._kinds.items() if is_foreign(kind)}
        self._others = _others(log)

    def run(self) -> int:
        """Convert the whole log. Returns the number of messages that were added."""
        topics = frozenset(self._log.topics) - {DATAGRAM.topic}
        for record in self._log.records(topics):
            if not self._copied:
                self._start_ns = record.time_ns
                self._add_world_and_vehicle(record.time_ns)
            self._copy(record)
            self._convert(record)
        self._say(self._lines.over(math.inf))
        return sum(sequence for _, sequence in self._added.values())

    def _copy(self, record: Record) -> None:
        channel = self._copied.get(record.topic)
        if channel is None:
            kind = self._log.topics[record.topic]
            schema = self._writer.register_schema(kind.schema_name, "ros1msg", kind.definition.encode())
            channel = self._copied[record.topic] = self._writer.register_channel(record.topic, "ros1", schema)
        time_ns = self._log.epoch_ns + record.time_ns
        self._writer.add_message(channel, time_ns, record.data, time_ns, record.sequence)

    def _add(self, name: str, time_ns: int, message: Any) -> None:
        """Write a message to /foxglove/`name`. The time is one of the log's clock."""
        known = self._added.get(name)
        if known is None:
            schema = register_schema(self._writer, type(message))
            known = self._writer.register_channel(f"/foxglove/{name}", "protobuf", schema), 0
        channel, sequence = known
        at = self._log.epoch_ns + time_ns
        self._writer.add_message(channel, at, message.SerializeToString(), at, sequence)
        self._added[name] = channel, sequence + 1

    def _stamp(self, time_ns: int) -> Timestamp:
        seconds, nanos = divmod(self._log.epoch_ns + time_ns, 1_000_000_000)
        return Timestamp(seconds=seconds, nanos=nanos)

    def _is_due(self, name: str, time_ns: int, every_s: float) -> bool:
        """Also where the clock was set back."""
        last_ns = self._written.get(name)
        if last_ns is not None and 0 <= time_ns - last_ns < round(every_s * 1e9):
            return False
        self._written[name] = time_ns
        return True

    def _convert(self, record: Record) -> None:
        if record.topic in self._foreign:
            return
        name = record.topic.rpartition("/")[2]
        if record.topic == LOGGED.topic:
            trace = self._fields(record)
            if self._is_due("plan", record.time_ns, _PLAN_EVERY_S):
                self._plan(record.time_ns, trace)
            if trace.get("guard_reason") and self._is_due("guard", record.time_ns, _PLAN_EVERY_S):
                self._guard(record.time_ns, trace)
        elif record.topic == PLANNED.topic:
            planned = self._fields(record)
            self._way = np.reshape(planned["way_ned"], (-1, 2))[: planned["corners"]]
        elif record.topic == TEXT.topic:
            said = self._fields(record)
            self._say([Text(record.time_ns * 1e-9, said["level"], said["name"], said["message"])])
        elif record.topic.startswith("/mavlink/") and (
            name == "STATUSTEXT" or _system(record.topic) not in self._others
        ):
            if name in (RING, SECTOR):
                self._ring(record, name)
            elif name in NAMES:
                self._mapper.take(name, self._fields(record), record.time_ns)
            self._message(record, name)

    def _ring(self, record: Record, name: str) -> None:
        """Add the ring that a message is or completes."""
        sender, times = record.topic.rpartition("/")[0], np.array([record.time_ns * 1e-9])
        rings = self._rings.take(sender, name, times, [self._fields(record)])
        for ring in () if rings is None else filter(shows_around, rings[1]):
            self._scan(record.time_ns, ring)
            if self._mapper.take(RING, ring, record.time_ns):
                self._map(record.time_ns)

    def _message(self, record: Record, name: str) -> None:
        if name == "LOCAL_POSITION_NED":
            place = self._fields(record)
            self._position_ned = np.array([place["x"], place["y"], place["z"]])
        elif name in ("ATTITUDE_QUATERNION", "ATTITUDE"):
            if self._position_ned is not None and self._is_due("pose", record.time_ns, _POSE_EVERY_S):
                self._pose(record.time_ns, _attitude(self._fields(record)))
        elif name == "GLOBAL_POSITION_INT":
            self._fix(record.time_ns, self._fields(record))
        elif name == "STATUSTEXT" and not self._has_texts:
            _, _, system, component, _ = record.topic.split("/")
            times = np.array([record.time_ns * 1e-9])
            self._say(self._lines.take(f"{system}/{component}", times, [self._fields(record)]))

    def _fields(self, record: Record) -> dict[str, Any]:
        return unpack(self._log, self._kinds[record.topic], record)

    def _pose(self, time_ns: int, attitude_ned_frd: Array) -> None:
        assert self._position_ned is not None
        stamp, place = self._stamp(time_ns), enu_to_ned(self._position_ned)
        turn = multiply(_ENU_NED, multiply(attitude_ned_frd, _FRD_FLU))
        pose = Pose(position=_vector(place), orientation=_quaternion(turn))
        transform = FrameTransform(
            timestamp=stamp,
            parent_frame_id=WORLD_FRAME,
            child_frame_id=BODY_FRAME,
            translation=_vector(place),
            rotation=_quaternion(turn),
        )
        self._add("transforms", time_ns, FrameTransforms(transforms=[transform]))
        self._add("pose", time_ns, PoseInFrame(timestamp=stamp, frame_id=WORLD_FRAME, pose=pose))
        self._add_to_path("path", time_ns, place, turn)

    def _add_to_path(self, name: str, time_ns: int, place: Array, turn: Array) -> None:
        """Add a pose (position (3,) in m and attitude (4,)) to a path."""
        track = self._tracks[name]
        track.add(np.array([time_ns * 1e-9]), np.concatenate((place, turn))[None])
        # A path is as long as the flight. It is written each second at first and then ever more rarely, to stay small.
        if self._is_due(name, time_ns, max(1.0, 0.02e-9 * (time_ns - self._start_ns))):
            poses = [Pose(position=_vector(row[1:4]), orientation=_quaternion(row[4:])) for row in track.rows()]
            self._add(name, time_ns, PosesInFrame(timestamp=self._stamp(time_ns), frame_id=WORLD_FRAME, poses=poses))

    def _plan(self, time_ns: int, trace: dict[str, Any]) -> None:
        stamp = self._stamp(time_ns)
        wanted, target, place = (
            enu_to_ned(np.array(trace[name])) for name in ("reference_position_ned", "target_ned", "position_ned")
        )
        yaw = math.pi / 2.0 - trace["reference_yaw"]
        turn = np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)])
        pose = Pose(position=_vector(wanted), orientation=_quaternion(turn))
        self._add("reference", time_ns, PoseInFrame(timestamp=stamp, frame_id=WORLD_FRAME, pose=pose))
        self._add_to_path("reference_path", time_ns, wanted, turn)
        color = _color(0.91, 0.63, 0.16) if trace["blocked"] else _color(0.23, 0.49, 0.87)
        ahead = [_point(np.array([east, north, target[2]])) for north, east in self._way[1:]]
        entity = SceneEntity(timestamp=stamp, frame_id=WORLD_FRAME, id="plan")
        size = Vector3(x=0.5, y=0.5, z=0.5)
        entity.spheres.append(SpherePrimitive(pose=_at(target), size=size, color=color))
        entity.lines.append(
            LinePrimitive(
                type=LinePrimitive.LINE_STRIP,
                pose=_at(np.zeros(3)),
                thickness=2.0,
                scale_invariant=True,
                points=[_point(place), *(ahead or [_point(target)])],
                color=color,
            )
        )
        entity.metadata.add(key="clearance, m", value=f"{trace['clearance']:.2f}")
        self._add("plan", time_ns, SceneUpdate(entities=[entity]))

    def _guard(self, time_ns: int, trace: dict[str, Any]) -> None:
        """A red disc at the vehicle, with the guard's reason, for a moment."""
        place = enu_to_ned(np.array(trace["position_ned"]))
        reason = _REASONS.get(trace["guard_reason"], f"reason {trace['guard_reason']}")
        entity = SceneEntity(timestamp=self._stamp(time_ns), frame_id=WORLD_FRAME, id="guard")
        entity.lifetime.CopyFrom(Duration(nanos=round(_GUARD_SHOWN_S * 1e9)))
        disc = CylinderPrimitive(pose=_at(place), color=_color(0.84, 0.15, 0.2, 0.45), bottom_scale=1.0, top_scale=1.0)
        disc.size.CopyFrom(Vector3(x=1.4, y=1.4, z=0.05))
        entity.cylinders.append(disc)
        text = f"{reason}, {trace['guard_change']:.1f} m/s²"
        above = _at(place + np.array([0.0, 0.0, 0.8]))
        entity.texts.append(
            TextPrimitive(pose=above, billboard=True, font_size=0.4, color=_color(0.84, 0.15, 0.2), text=text)
        )
        entity.metadata.add(key="reason", value=reason)
        entity.metadata.add(key="change, m/s2", value=f"{trace['guard_change']:.3f}")
        self._add("guard", time_ns, SceneUpdate(entities=[entity]))

    def _map(self, time_ns: int) -> None:
        """The map on the ground. A row of cells goes from west to east, and the southernmost row comes first."""
        if not self._is_due("map", time_ns, _MAP_EVERY_S):
            return
        view = self._mapper.view(time_ns)
        assert view is not None
        cells = np.ascontiguousarray(picture(view)[::-1])
        south, west = view.corner[0] * view.cell, view.corner[1] * view.cell
        grid = Grid(
            timestamp=self._stamp(time_ns),
            frame_id=WORLD_FRAME,
            pose=_at(np.array([west, south, _MAP_UP_M])),
            column_count=cells.shape[1],
            cell_size=Vector2(x=view.cell, y=view.cell),
            row_stride=cells.strides[0],
            cell_stride=cells.strides[1],
            data=cells.tobytes(),
        )
        for offset, color in enumerate(("red", "green", "blue", "alpha")):
            grid.fields.append(PackedElementField(name=color, offset=offset, type=PackedElementField.UINT8))
        self._add("map", time_ns, grid)

    def _scan(self, time_ns: int, distances: Mapping[str, Any] | np.void) -> None:
        step = math.radians(distances["increment_f"] or distances["increment"])
        offset = math.radians(distances["angle_offset"])
        reach = distances["max_distance"]
        # Sectors go clockwise in the message and counter-clockwise here, so the last one comes first.
        ranges = [0.01 * cm if cm <= reach else math.inf for cm in reversed(distances["distances"])]
        scan = LaserScan(
            timestamp=self._stamp(time_ns),
            frame_id=BODY_FRAME,
            pose=_at(np.zeros(3)),
            start_angle=-(offset + step * (len(ranges) - 1)),
            end_angle=-offset,
            ranges=ranges,
        )
        self._add("ring", time_ns, scan)

    def _fix(self, time_ns: int, place: dict[str, Any]) -> None:
        fix = LocationFix(
            timestamp=self._stamp(time_ns),
            frame_id=WORLD_FRAME,
            latitude=place["lat"] * 1e-7,
            longitude=place["lon"] * 1e-7,
            altitude=place["alt"] * 1e-3,
        )
        self._add("fix", time_ns, fix)

    def _say(self, lines: list[Text]) -> None:
        for line in lines:
            time_ns = round(line.time * 1e9)
            level: Any = line.level  # the numbers of foxglove.Log
            said = Log(timestamp=self._stamp(time_ns), level=level, name=line.source, message=line.text)
            self._add("log", time_ns, said)

    def _add_world_and_vehicle(self, time_ns: int) -> None:
        stamp = self._stamp(time_ns)
        entities = []
        for number, prism in enumerate(solids(self._log.attachments.get("world.toml", b""))):
            entity = SceneEntity(timestamp=stamp, frame_id=WORLD_FRAME, id=f"{number} {prism.name}")
            entity.metadata.add(key="name", value=prism.name)
            corners, faces = mesh(prism)
            entity.triangles.append(
                TriangleListPrimitive(
                    pose=_at(np.zeros(3)),
                    points=[Point3(x=x, y=y, z=z) for x, y, z in corners],
                    indices=[index for face in faces for index in face],
                    color=_color(0.48, 0.62, 0.41) if prism.round else _color(0.69, 0.66, 0.61),
                )
            )
            entities.append(entity)
        if entities:
            self._add("world", time_ns, SceneUpdate(entities=entities))
        self._add("vehicle", time_ns, SceneUpdate(entities=[_airframe(stamp)]))


def _others(log: LogReader) -> frozenset[str]:
    """The systems that tell a place, but for the one that setpoints were sent to, or else tells it most: the vehicle
    that is drawn."""
    told = [topic for topic in log.topics if topic.startswith("/mavlink/") and topic.endswith("/LOCAL_POSITION_NED")]
    if len(told) < 2:
        return frozenset()
    counts = Counter(_system(record.topic) for record in log.records(told))
    flown = commanded(log)
    return frozenset(sorted(counts, key=lambda system: (system in flown, counts[system]))[:-1])


def _system(topic: str) -> str:
    return topic.split("/", 3)[2]


def _airframe(stamp: Timestamp) -> SceneEntity:
    """The vehicle's body, arms and rotors, fixed to base_link."""
    ink, red = _color(0.18, 0.19, 0.21), _color(0.84, 0.27, 0.38)
    entity = SceneEntity(timestamp=stamp, frame_id=BODY_FRAME, id="vehicle", frame_locked=True)
    for x, y, z, color in ((0.18, 0.18, 0.09, ink), (0.54, 0.03, 0.02, ink), (0.03, 0.54, 0.02, ink)):
        entity.cubes.append(CubePrimitive(pose=_at(np.zeros(3)), size=Vector3(x=x, y=y, z=z), color=color))
    nose = _at(np.array([0.38, 0.0, 0.0]))
    entity.cubes.append(CubePrimitive(pose=nose, size=Vector3(x=0.1, y=0.05, z=0.04), color=red))
    for forward, left in ((0.23, 0.0), (-0.23, 0.0), (0.0, 0.23), (0.0, -0.23)):
        disc = CylinderPrimitive(pose=_at(np.array([forward, left, 0.03])), color=ink, bottom_scale=1.0, top_scale=1.0)
        disc.size.CopyFrom(Vector3(x=0.26, y=0.26, z=0.01))
        entity.cylinders.append(disc)
    return entity


def _attitude(fields: dict[str, Any]) -> Array:
    if "q1" in fields:
        return np.array([fields["q1"], fields["q2"], fields["q3"], fields["q4"]])
    angles = np.array([[fields["roll"], fields["pitch"], fields["yaw"]]])
    turn: Array = quaternions(angles)[0].astype(np.float64)
    return turn


def _vector(place: Floats) -> Vector3:
    return Vector3(x=float(place[0]), y=float(place[1]), z=float(place[2]))


def _point(place: Floats) -> Point3:
    return Point3(x=float(place[0]), y=float(place[1]), z=float(place[2]))


def _quaternion(turn: Floats) -> Quaternion:
    w, x, y, z = turn.tolist()
    return Quaternion(w=w, x=x, y=y, z=z)


def _at(place: Floats) -> Pose:
    return Pose(position=_vector(place), orientation=Quaternion(w=1.0))


def _color(red: float, green: float, blue: float, alpha: float = 1.0) -> Color:
    return Color(r=red, g=green, b=blue, a=alpha)


def beside(log: Path) -> Path:
    """Where the copy of a log goes."""
    return log.with_name(f"{log.stem}_foxglove.mcap")


class Drawn(NamedTuple):
    """What was written."""

    path: Path
    added: int
    """Messages beside those of the log."""
    problem: str | None
    """What is wrong with the log; the rest of it was written."""


def convert(log: Path, target: Path | None = None) -> Drawn:
    """Write a copy of a log for Foxglove, by default NAME_foxglove.mcap beside it. An older copy is replaced.

    Raises FlightLogError if the log can't be read, or if the target can't be written or is a recording itself.
    """
    reader = LogReader(log)
    target = beside(log) if target is None else target
    with output(target, source=log, replaces=True) as draft, draft.open("wb") as file:
        writer = Writer(file)
        writer.start("", EXPORT_LIBRARY)
        for name, table in reader.metadata.items():
            writer.add_metadata(name, table)
        for name, content in reader.attachments.items():
            writer.add_attachment(reader.epoch_ns, reader.epoch_ns, name, "application/octet-stream", content)
        try:
            added = Converter(reader, writer).run()
        except SystemError as error:  # what protobuf makes of a Ctrl-C
            raise (error.__cause__ or error) from None
        writer.finish()  # type: ignore[no-untyped-call]
    return Drawn(target, added, reader.problem)
