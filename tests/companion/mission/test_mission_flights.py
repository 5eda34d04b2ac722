"""Missions with curves, flown by both sides in memory."""

import numpy as np
import pytest

from companion.mission.plan import Phase
from companion.supervision.states import State
from protocol.framing import Framer
from protocol.messages import dialect
from studies.joined import Joined, mission_of
from tests.flights.short import SMALL_MAP, landing

FREE = ("avoidance.method=none",)


def flown(mission: str, *changes: str) -> Joined:
    joined = Joined(mission_of(mission, *changes), overrides=FREE, remembers=False).fly(until=landing)
    assert landing(joined) and joined.autopilot.supervisor.fault is None
    return joined


@pytest.mark.parametrize(
    ("mission", "within"), [("circle", 0.05), ("lemniscate", 0.05), ("helix", 0.05), ("ellipse", 0.05), ("square", 0.5)]
)
def test_a_shape_is_flown_to_its_end(mission: str, within: float) -> None:
    joined = flown(mission, "trajectory.laps=1")
    trace = joined.trace()
    track = trace[trace["phase"] == Phase.TRACK.value]
    shape = joined.mission.trajectory
    assert shape is not None
    speed = np.linalg.norm(track["reference_velocity_ned"], axis=1)
    assert speed.max() == pytest.approx(shape.speed, rel=1e-3)
    error = np.linalg.norm(track["position_ned"] - track["reference_position_ned"], axis=1)
    assert error.max() < within
    assert np.hypot(*joined.vehicle.motion.position_ned[:2]) < 0.3


def test_a_curve_of_least_snap_passes_its_points_and_comes_back() -> None:
    joined = flown("curve")
    trace = joined.trace()
    curved = trace[np.isin(trace["step"], [1, 2])]
    assert set(curved["phase"]) == {Phase.TRACK.value, Phase.RETURN.value}
    error = np.linalg.norm(curved["position_ned"] - curved["reference_position_ned"], axis=1)
    assert error.max() < 0.05
    assert np.linalg.norm(curved["reference_velocity_ned"], axis=1).max() <= joined.mission.speed
    start = trace["position_ned"][0]
    for step in (1, 2):
        path = trace[trace["step"] == step]["position_ned"] - start
        for waypoint in joined.mission.waypoints:
            place = np.array([waypoint.north, waypoint.east, -waypoint.height])
            assert np.linalg.norm(path - place, axis=1).min() < 0.05


def test_a_hold_on_the_circle_brakes_smoothly_and_the_rest_is_flown_afterwards() -> None:
    """No ring for a second at 4 m/s; the circle is taken up where it was left, and ends where it began."""
    joined = Joined(mission_of("circle"), overrides=(SMALL_MAP,), remembers=False)
    joined.fly(until=lambda each: each.autopilot.navigator.phase is Phase.TRACK).fly(limit_s=7.0)
    assert np.linalg.norm(joined.vehicle.motion.velocity_ned) == pytest.approx(4.0, abs=0.1)
    blind_ns = range(joined.vehicle.time_ns, joined.vehicle.time_ns + 1_000_000_000)
    joined.meddle = lambda time_ns, data: without_ring(data) if time_ns in blind_ns else data
    joined.fly(until=landing)
    assert landing(joined) and joined.autopilot.supervisor.fault is None
    trace = joined.trace()
    in_the_air = trace[(trace["phase"] == Phase.TRACK.value) & (trace["step"] == 1)]
    held = in_the_air["state"] == State.HOLD.value
    assert held.sum() >= 250
    where_left = in_the_air["reference_position_ned"][np.argmax(held) - 1]
    assert np.abs(np.diff(in_the_air["reference_acceleration_ned"], axis=0)).max() < 0.3
    assert np.abs(np.diff(in_the_air["reference_velocity_ned"], axis=0)).max() < 0.03
    after = in_the_air[np.flatnonzero(held)[-1] :]
    assert np.linalg.norm(after["reference_position_ned"] - where_left, axis=1).min() < 0.02
    assert np.linalg.norm(after["reference_velocity_ned"], axis=1).max() == pytest.approx(4.0, rel=1e-3)
    error = np.linalg.norm(in_the_air["position_ned"] - in_the_air["reference_position_ned"], axis=1)
    assert error.max() < 0.1
    start, end = in_the_air["reference_position_ned"][[0, -1]]
    assert np.allclose(start, end, atol=0.01)


def without_ring(data: bytes) -> bytes:
    ring = dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE
    return b"".join(frame.raw for frame in Framer().datagram(data) if frame.message_id != ring)
