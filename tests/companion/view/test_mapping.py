"""The map for display, from a simulated vehicle's telemetry: obstacles in their places, and the flight's own map."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from companion.config import Settings
from companion.config_avoidance import Avoidance
from companion.estimate import Estimator
from companion.link import wire, wire_ranges
from companion.perception.local_map import LocalMap
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, MapView
from companion.view.batches import Batch
from companion.view.history import History
from companion.view.mapping import MapAt, Mapper, avoidance_of, picture
from protocol.flightlog.mavlink_records import message_type
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from tests.vehicle_sim.foreign_pilot import AIRFRAME, world_with_wall
from vehicle_sim.vehicle import Vehicle

WALL = 6.0
"""m north, its middle; it is 1 m thick and reaches from 5 m west to 5 m east."""

Message = tuple[str, dict[str, Any], int]


@pytest.fixture(scope="module")
def heard() -> list[Message]:
    """The messages of a vehicle that takes off in front of a wall and turns freely."""
    vehicle = Vehicle(AIRFRAME, world_with_wall(WALL))
    pilot = Encoder(254, 190)
    for _ in range(400):
        vehicle.advance()
    nan = float("nan")
    for command, first in ((dialect.MAV_CMD_NAV_TAKEOFF, nan), (dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)):
        fields = (1, 1, command, 0, first, 0.0, 0.0, nan, nan, nan, nan)
        vehicle.receive(pilot.encode_fields(dialect.MAVLink_command_long_message, *fields))
    return [message for _ in range(1500) for message in said(vehicle)]


def said(vehicle: Vehicle) -> Iterator[Message]:
    for datagram in vehicle.advance():
        for frame in Framer().datagram(datagram):
            message = decode(frame)
            assert message is not None
            yield message.get_type(), message.to_dict(), vehicle.time_ns


def mapped(messages: list[Message], avoidance: Avoidance) -> tuple[MapView, int]:
    mapper = Mapper(avoidance)
    count = sum(mapper.take(*message) for message in messages)
    view = mapper.view(messages[-1][2])
    assert view is not None and mapper.position_ned is not None
    return view, count


def state_at(view: MapView, north: float, east: float) -> int:
    return view.state_at(np.array([north, east]))


def test_a_wall_is_in_its_place_with_free_before_it_and_unknown_behind(heard: list[Message]) -> None:
    view, count = mapped(heard, Avoidance())
    assert count == sum(name == "OBSTACLE_DISTANCE" for name, _, _ in heard) > 80
    for east in (-3.0, 0.0, 3.0):
        assert OCCUPIED in {state_at(view, WALL - 0.5 + off, east) for off in (-0.1, 0.1, 0.3)}
        assert state_at(view, 3.0, east) == FREE
        assert state_at(view, WALL + 3.0, east) == UNKNOWN
    assert state_at(view, -6.0, 6.0) == FREE, "nothing stands south-east"


def test_it_is_the_map_that_avoidance_uses(heard: list[Message]) -> None:
    """Bit for bit the map of the stages that avoidance uses, given the same scans and poses."""
    avoidance = Avoidance()
    local_map, estimator = LocalMap(avoidance), Estimator()
    for name, fields, time_ns in heard:
        message = SimpleNamespace(**fields)
        if name == "ATTITUDE_QUATERNION":
            estimator.attitude(wire.attitude_quaternion(message), time_ns)
            estimator.state()
        elif name == "LOCAL_POSITION_NED":
            estimator.position(wire.local_position(message), time_ns)
        elif name == "OBSTACLE_DISTANCE":
            scan = wire_ranges.obstacle_distance(message, time_ns)
            pose = estimator.pose_at(scan.boot_time_us)
            if pose is not None:
                local_map.add(scan, pose, -avoidance.ground_height, time_ns)
                last_ns = time_ns
    local_map.look(last_ns)
    mapper = Mapper(avoidance)
    for message_ in heard:
        mapper.take(*message_)
    view = mapper.view(last_ns)
    assert view is not None and local_map.view is not None
    assert view.corner == local_map.view.corner
    assert np.array_equal(view.states, local_map.view.states)


def test_angles_do_for_a_vehicle_without_quaternions_and_the_clock_may_restart(heard: list[Message]) -> None:
    whole, count = mapped(heard, Avoidance())
    angles_only, fewer = mapped([each for each in heard if each[0] != "ATTITUDE_QUATERNION"], Avoidance())
    assert fewer > 0.9 * count
    assert state_at(angles_only, 3.0, 0.0) == state_at(whole, 3.0, 0.0) == FREE
    mapper = Mapper(Avoidance())
    later = heard[-1][2]
    twice = heard + [(name, fields, time_ns + later) for name, fields, time_ns in heard]
    assert sum(mapper.take(*message) for message in twice) == 2 * count


def as_batch(name: str, messages: list[Message]) -> Batch:
    """All messages of one name, as a source gives them."""
    chosen = [(fields, time_ns) for other, fields, time_ns in messages if other == name]
    shapes = {key: np.asarray(value) for key, value in chosen[0][0].items() if key != "mavpackettype"}
    table = np.zeros(len(chosen), [(key, value.dtype, value.shape) for key, value in shapes.items()])
    for row, (fields, _) in zip(table, chosen, strict=True):
        for key in shapes:
            row[key] = fields[key]
    kind = message_type(getattr(dialect, f"MAVLINK_MSG_ID_{name}"), f"/mavlink/1/1/{name}")[0]
    return kind.topic, kind, np.array([time_ns for _, time_ns in chosen]), table


def test_the_map_at_any_time_is_that_of_the_stream(heard: list[Message]) -> None:
    """Step by step, after a leap ahead and back again, from batches in any order."""
    history, maps = History(), MapAt(Avoidance())
    for name in ("OBSTACLE_DISTANCE", "LOCAL_POSITION_NED", "HEARTBEAT", "ATTITUDE_QUATERNION"):
        history.take(as_batch(name, heard))

    def at(time: float) -> MapView:
        shown = maps.at(time, history.scans(maps.wants_from(time), time))
        assert shown is not None
        return shown[0]

    for time in (4.0, 4.2, 4.3, 7.5, 5.0, history.end):
        wanted, _ = mapped([each for each in heard if each[2] <= time * 1e9], Avoidance())
        view = at(time)
        assert view.corner == wanted.corner
        assert (view.states == wanted.states).mean() > 0.998, time
        assert state_at(view, WALL - 0.4, 0.0) == OCCUPIED
    assert maps.at(maps.wants_from(1e6) + 40.0, history.scans(1e6, 1e6)) is None, "nothing is remembered for so long"


def test_impossible_values_are_ignored() -> None:
    mapper = Mapper(Avoidance())
    nan = float("nan")
    assert not mapper.take("LOCAL_POSITION_NED", {"time_boot_ms": 1, **dict.fromkeys(("x", "y", "z"), nan)}, 0)
    assert not mapper.take("HEARTBEAT", {}, 0)
    assert mapper.view(0) is None


def test_the_picture_has_north_above_and_east_on_the_right() -> None:
    states = np.full((4, 4), UNKNOWN, np.uint8)
    states[3, 0], states[0, 2] = OCCUPIED, FREE  # the north-west corner, and east of the south-west one
    view = MapView(states, np.zeros((4, 4), np.float32), (0, 0), 0.2)
    shown = picture(view)
    assert np.argwhere(shown[..., 3]).tolist() == [[0, 0], [3, 2]]
    assert shown[0, 0, 3] > shown[3, 2, 3], "what stands there is the clearer"
    assert view.obstacle_centres() == pytest.approx(np.array([[0.7, 0.1]]))


def test_a_flight_s_own_settings_make_its_map() -> None:
    changed = msgspec.structs.replace(Avoidance(), vehicle_radius=0.5)
    assert avoidance_of(msgspec.json.encode(Settings(avoidance=changed))).vehicle_radius == 0.5
    assert avoidance_of(b"") == avoidance_of(b'{"control": 3}') == Avoidance()


def test_the_settings_of_an_old_log_are_read_by_their_old_names() -> None:
    old = b'{"avoidance": {"tracks": {"slowest": 0.8, "rest": 9, "gap": 0.7}, "map": {"cells": 64}}}'
    avoidance = avoidance_of(old)
    assert (avoidance.tracks.min_speed, avoidance.tracks.stopped_scans, avoidance.tracks.range_gap) == (0.8, 9, 0.7)
    assert avoidance.map.cells == 64
