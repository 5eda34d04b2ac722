"""The paper's rule and the braking distance: sides, margins, mirror and rotation, and the ground left out."""

import math

import numpy as np
import pytest
from scipy.cluster import hierarchy

from companion.avoidance.braking import free_distance, stopping_speed
from companion.avoidance.none import NoAvoidance
from companion.avoidance.paper import PaperRule, clusters
from companion.config_avoidance import Avoidance
from companion.perception.recent_returns import RecentReturns
from companion.perception.scans import obstacle_points
from companion.state import AvoidanceDecision, Scan
from protocol.arrays import Array, BoolArray
from protocol.frames import from_euler

SETTINGS = Avoidance()
HERE = np.array([0.0, 0.0, -3.0])
STILL = np.zeros(3)
BEHIND = 8.0 + SETTINGS.vehicle_radius + SETTINGS.safe_distance
"""Where setpoints lie behind a face at 8 m that can be passed in a straight line."""
GOAL = np.array([50.0, 0.0, -3.0])
SPEED = 4.0


def wall(north: float, east_from: float, east_to: float, count: int = 9) -> Array:
    """Returns of a flat face across the way, from left to right."""
    east = np.linspace(east_from, east_to, count)
    return np.column_stack([np.full(count, north), east, np.full(count, -3.0)])


def decide(
    points: Array, goal: Array = GOAL, velocity: Array = STILL, rule: PaperRule | None = None
) -> AvoidanceDecision:
    return (rule or PaperRule(SETTINGS)).decide(points, HERE, velocity, goal, SPEED)


def turned(vectors: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    result: Array = vectors @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return result


def scan_of(ranges: Array, hit: BoolArray | None = None) -> Scan:
    hits = np.ones(72, bool) if hit is None else hit
    return Scan(0, 0, np.radians(5.0 * np.arange(72)), ranges, hits, np.ones(72, bool))


def test_free_way_is_left_alone() -> None:
    decision = decide(np.empty((0, 3)))
    assert np.array_equal(decision.target_ned, GOAL)
    assert (decision.speed_limit, decision.clearance, decision.blocked) == (SPEED, math.inf, False)
    aside = decide(wall(8.0, 4.0, 6.0))
    assert np.array_equal(aside.target_ned, GOAL) and not aside.blocked


def test_setpoint_is_three_metres_outside_the_nearer_edge() -> None:
    """(30), (31): the edges are at -1 and +2, so the left one is nearer; and the other way round."""
    left = decide(wall(8.0, -1.0, 2.0))
    assert np.allclose(left.target_ned, [BEHIND, -4.0, -3.0])
    right = decide(wall(8.0, -2.0, 1.0))
    assert np.allclose(right.target_ned, [BEHIND, 4.0, -3.0])
    tie = decide(wall(8.0, -1.0, 1.0))
    assert np.allclose(tie.target_ned, [BEHIND, -4.0, -3.0])


def test_margin_is_a_setting() -> None:
    decision = decide(wall(8.0, -1.0, 2.0), rule=PaperRule(Avoidance(lateral_margin=2.0)))
    assert decision.target_ned[1] == pytest.approx(-3.0)


def test_gap_wide_enough_is_passed_with_less_than_the_margin() -> None:
    """Between -5.5 and -1: no three metres, but room; the other way round is far."""
    points = np.vstack([wall(8.0, -12.0, -4.5, 30), wall(8.0, -1.0, 12.0, 40)])
    assert -4.5 < decide(points).target_ned[1] < -1.0


def test_gap_too_narrow_to_pass_is_no_gap() -> None:
    points = np.vstack([wall(8.0, -4.0, -2.5), wall(8.0, -1.0, 2.0)])
    decision = decide(points)
    assert np.allclose(decision.target_ned, [BEHIND, 5.0, -3.0])


def test_setpoint_that_can_not_be_reached_is_not_taken() -> None:
    """The nearer edge is the left one, but a wall leads up to it on that side."""
    barrier = np.column_stack([np.linspace(1.0, 8.0, 30), np.full(30, -1.5), np.full(30, -3.0)])
    assert decide(np.vstack([wall(8.0, -1.0, 2.0), barrier])).target_ned[1] > 2.0


def test_without_any_way_it_stays() -> None:
    bearings = np.linspace(0.0, 2.0 * math.pi, 72, endpoint=False)
    cage = np.column_stack([3.0 * np.cos(bearings), 3.0 * np.sin(bearings), np.full(72, -3.0)])
    decision = decide(cage)
    assert decision.blocked and np.allclose(decision.target_ned, HERE)


def test_a_course_is_never_set_through_a_point() -> None:
    """Whatever the field: the straight way to the setpoint keeps the standoff (or what there is of it)."""
    rng = np.random.default_rng(5)
    moved = 0
    for _ in range(200):
        points = np.column_stack([rng.uniform(-12.0, 12.0, (25, 2)), np.full(25, -3.0)])
        if np.hypot(points[:, 0], points[:, 1]).min() < 1.7:
            continue
        target = decide(points).target_ned
        along = np.linspace(0.0, 1.0, 200)[:, None] * target[:2]
        gaps = np.hypot(*(points[None, :, :2] - along[:, None, :]).transpose(2, 0, 1))
        assert gaps.min() >= SETTINGS.vehicle_radius + SETTINGS.safe_distance - 0.02
        moved += not np.array_equal(target, HERE)
    assert moved > 100


def test_things_behind_the_goal_or_the_vehicle_do_not_matter() -> None:
    goal = np.array([5.0, 0.0, -3.0])
    assert not decide(wall(8.0, -2.0, 2.0), goal).blocked
    assert not decide(wall(-4.0, -2.0, 2.0)).blocked


def test_mirror_and_rotation() -> None:
    """A mirrored or turned scene has the mirrored or turned answer."""
    rng = np.random.default_rng(1)
    flip = np.array([1.0, -1.0, 1.0])
    for _ in range(100):
        centre = rng.uniform(-2.5, 2.5)
        points = np.vstack([wall(rng.uniform(5.0, 12.0), centre - 1.3, centre + 1.4), wall(10.0, 6.0, 9.0)])
        expected = decide(points)
        mirrored = decide((points * flip)[::-1])
        assert np.allclose(mirrored.target_ned, expected.target_ned * flip)
        angle = rng.uniform(-math.pi, math.pi)
        rotated = decide(turned(points, angle), turned(GOAL, angle))
        assert np.allclose(rotated.target_ned, turned(expected.target_ned, angle))
        assert rotated.speed_limit == pytest.approx(expected.speed_limit)


def test_side_is_kept_while_the_same_thing_is_in_the_way() -> None:
    rule = PaperRule(SETTINGS)
    first = decide(wall(8.0, -1.9, 2.0), rule=rule)
    assert first.target_ned[1] < 0.0
    kept = decide(wall(8.0, -2.0, 1.9), rule=rule)  # a fresh rule would turn right now
    assert kept.target_ned[1] < 0.0
    decide(np.empty((0, 3)), rule=rule)
    assert decide(wall(8.0, -2.0, 1.9), rule=rule).target_ned[1] > 0.0


def test_clusters_follow_the_gaps_in_any_order() -> None:
    """Two groups; scipy's single linkage as the oracle for random ones."""
    bearings = np.radians([-10, -5, 0, 5, 10, 90, 95, 100])
    rng = np.random.default_rng(1)
    points = rng.permutation(5.0 * np.column_stack([np.cos(bearings), np.sin(bearings)]))
    for _ in range(30):
        cloud = rng.uniform(-8.0, 8.0, (40, 2))
        expected = hierarchy.fcluster(hierarchy.linkage(cloud, "single"), 1.5, "distance")
        assert sorted(map(len, clusters(cloud, 1.5))) == sorted(np.bincount(expected)[1:])
    found = clusters(points, 1.0)
    assert sorted(len(cluster) for cluster in found) == [3, 5]
    assert len(clusters(points, 100.0)) == 1
    assert clusters(np.empty((0, 2)), 1.0) == []


def test_free_distance_against_a_march() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        points = np.column_stack([rng.uniform(-10, 10, (12, 2)), np.full(12, -3.0)])
        angle = rng.uniform(-math.pi, math.pi)
        direction = np.array([math.cos(angle), math.sin(angle), 0.0])
        radius = 0.8
        if np.hypot(points[:, 0], points[:, 1]).min() < radius:
            continue
        along = np.arange(0.0, 12.0, 0.01)
        centres = along[:, None] * direction[:2]
        gaps = np.hypot(*(points[None, :, :2] - centres[:, None, :]).transpose(2, 0, 1)).min(axis=1)
        touched = np.flatnonzero(gaps < radius)
        expected = along[touched[0]] if touched.size else math.inf
        found = free_distance(points, HERE, direction, radius)
        assert (found > 11.9 and expected > 11.9) or found == pytest.approx(expected, abs=0.03)


def test_stopping_speed_stops_in_time() -> None:
    for distance in (0.1, 1.0, 5.0, 15.0):
        v = stopping_speed(distance, 2.5, 0.3)
        assert v * 0.3 + v * v / (2 * 2.5) == pytest.approx(distance)
    assert stopping_speed(0.0, 2.5, 0.3) == 0.0


def test_speed_is_limited_in_the_direction_of_flight() -> None:
    fast = decide(wall(4.0, -2.0, 2.5), velocity=np.array([4.0, 0.0, 0.0]))
    assert SETTINGS.least_speed < fast.speed_limit < SPEED
    sideways = decide(wall(4.0, -2.0, 2.5), velocity=np.array([0.0, -4.0, 0.0]))
    assert sideways.speed_limit == SPEED
    near = decide(wall(0.8, -2.0, 2.5), velocity=np.array([4.0, 0.0, 0.0]))
    assert near.speed_limit == SETTINGS.least_speed


def test_clearance_is_from_the_hull() -> None:
    assert decide(wall(8.0, -1.0, 2.0, 4)).clearance == pytest.approx(8.0 - 0.36, abs=0.1)
    assert NoAvoidance(SETTINGS).decide(wall(8.0, 0.0, 2.0), HERE, STILL, GOAL, SPEED).clearance == pytest.approx(7.64)


def test_ring_only_on_the_right() -> None:
    """A vehicle that heads east and sees something to its right sees it in the south."""
    ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
    ranges[18], hit[18] = 4.0, True
    points = obstacle_points(scan_of(ranges, hit), HERE, from_euler(0.0, 0.0, math.pi / 2), 0.0)
    assert np.allclose(points, [[-4.0, 0.0, -3.0]])


def test_ground_seen_by_a_tilted_ring_is_no_obstacle() -> None:
    """20 degrees nose down at 3 m: the forward beam meets the ground after 8.8 m, the backward one looks up."""
    ranges = np.full(72, 12.0)
    ranges[0] = 3.0 / math.sin(math.radians(20.0))
    points = obstacle_points(scan_of(ranges), HERE, from_euler(0.0, -math.radians(20.0), 0.0), -0.5)
    assert np.all(points[:, 2] < -0.5)
    forward = points[(np.abs(points[:, 1]) < 0.1) & (points[:, 0] > 0.0)]
    assert len(forward) == 0
    assert len(points) > 30


def test_memory_keeps_thins_out_and_forgets() -> None:
    memory = RecentReturns(2.0, 0.3)
    first = np.array([[5.0, 0.0, -3.0], [5.1, 0.0, -3.0], [8.0, 1.0, -3.0]])
    assert len(memory.add(first, 0)) == 2
    second = memory.add(np.array([[5.05, 0.1, -3.0]]), 1_500_000_000)
    assert len(second) == 2 and [5.05, 0.1, -3.0] in second.tolist()
    third = memory.add(np.empty((0, 3)), 2_500_000_000)
    assert third.tolist() == [[5.05, 0.1, -3.0]]
    assert len(memory.add(np.empty((0, 3)), 4_000_000_000)) == 0


def test_memory_is_bounded() -> None:
    memory = RecentReturns(1e9, 0.1)
    rng = np.random.default_rng(3)
    for _ in range(60):
        kept = memory.add(rng.uniform(-1000.0, 1000.0, (72, 3)), 0)
    assert len(kept) == 2048
