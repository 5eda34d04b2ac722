"""Whether an obstacle was seen to move: arcs before and behind what a ring saw, and around its nose."""

import math

import numpy as np
import pytest

from companion.perception.departure import Sight, seen_past
from protocol.arrays import Array
from protocol.frames import from_euler, rotate

WIDTH = math.radians(5.0)
HERE = np.array([1.0, -2.0, -3.0])
ALL = (-math.inf, math.inf)
"""An obstacle that was hit at all heights."""


def sight(ranges: Array, yaw: float = 0.0, pitch: float = 0.0, first: float = 0.0) -> Sight:
    return Sight(ranges, HERE, from_euler(0.0, pitch, yaw), first, WIDTH)


def at(bearing_deg: float, distance: float, down: float = 0.0) -> Array:
    """A place by its direction from HERE, clockwise from north."""
    bearing = math.radians(bearing_deg)
    place: Array = HERE + np.array([distance * math.cos(bearing), distance * math.sin(bearing), down])
    return place


@pytest.mark.parametrize("bearing_deg", [-178.9, -92.0, -2.4, 0.3, 2.4, 41.0, 177.6])
@pytest.mark.parametrize("yaw_deg", [0.0, 77.0, -160.0])
def test_all_sectors_of_the_arc_count_and_no_others(bearing_deg: float, yaw_deg: float) -> None:
    """An arc seen from the ring's own place is one sector wide: it lies in one or two sectors of the turned ring, whose
    beams may go either way round."""
    place = at(bearing_deg, 6.0)
    own = (bearing_deg - yaw_deg) / 5.0
    beams = {math.floor(own + side * 0.4999 + 0.5) % 72 for side in (-1.0, 1.0)}
    yaw = math.radians(yaw_deg)
    for k in range(72):
        ranges = np.full(72, 15.0)
        ranges[k] = 6.3
        assert seen_past(sight(ranges, yaw), place, HERE, ALL) == (k not in beams), k
        left = sight(np.roll(ranges[::-1], 1), yaw)._replace(step=-WIDTH)
        assert seen_past(left, place, HERE, ALL) == (k not in beams), k


@pytest.mark.parametrize("step_deg", [4.9, 5.0, 5.1, 6.5, 7.0, 8.5, 11.0, 13.3])
@pytest.mark.parametrize("goes", [1.0, -1.0])
def test_a_post_is_never_seen_past_from_the_same_place_by_a_ring_that_is_turned(step_deg: float, goes: float) -> None:
    """Whole turns are no whole number of most of these sectors: such rings leave a gap, or overlap."""
    rng, count = np.random.default_rng(1), min(72, math.ceil(360.0 / step_deg - 1e-9))
    bearings, asked = goes * step_deg * np.arange(count), 0
    for post, *yaws in rng.uniform(-180.0, 180.0, (400, 3)).tolist():
        hits = [np.abs((yaw + bearings - post + 180.0) % 360.0 - 180.0) <= 0.5 * step_deg for yaw in yaws]
        before, ring = hits[0], np.where(hits[1], 6.0, 15.0)
        turned = Sight(ring, HERE, from_euler(0.0, 0.0, math.radians(yaws[1])), 0.0, goes * math.radians(step_deg))
        for bearing in bearings[before].tolist():
            assert not seen_past(turned, at(yaws[0] + bearing, 6.0), HERE, ALL)
            asked += 1
    assert asked > 300


@pytest.mark.parametrize("roll", [-0.6, 0.6])
def test_a_tilted_ring_sees_past_what_is_above_its_plane(roll: float) -> None:
    """What stands is upright: the beam that counts meets the vertical through the place, which turned into the body's
    plane lies sectors away."""
    attitude = from_euler(roll, 0.3, 0.0)
    beams = np.array([rotate(attitude, np.array([math.cos(k * WIDTH), math.sin(k * WIDTH), 0.0])) for k in range(72)])
    directions = np.degrees(np.arctan2(beams[:, 1], beams[:, 0]))
    meets = int(np.abs(directions - 80.0).argmin())
    place = at(80.0, 0.8, 0.8 * beams[meets, 2] / math.hypot(*beams[meets, :2]) - 0.3)
    for k in range(72):
        ranges = np.full(72, 15.0)
        ranges[k] = 1.1
        seen = seen_past(Sight(ranges, HERE, attitude, 0.0, WIDTH), place, HERE, ALL)
        assert seen or abs(k - meets) <= 1, k
        assert not seen or k != meets, k


def test_an_arc_seen_from_afar_is_wide() -> None:
    """Seen from 14 m away across it is 1.2 m long: nearby that is many sectors."""
    place, origin = at(90.0, 2.0), at(90.0, 16.0)
    blocked = 0
    for k in range(72):
        ranges = np.full(72, 15.0)
        ranges[k] = 2.2
        blocked += not seen_past(sight(ranges), place, origin, ALL)
    assert blocked == 7  # 2 atan(0.61 / 2) = 34 degrees, and no more behind it


def test_what_was_not_measured_or_not_at_that_height_is_not_seen() -> None:
    place = at(30.0, 6.0)
    free = np.full(72, 15.0)
    assert seen_past(sight(free), place, HERE, ALL)
    assert not seen_past(sight(np.where(np.arange(72) == 6, 0.0, free)), place, HERE, ALL)
    assert not seen_past(sight(free), at(30.0, 14.9), HERE, ALL), "not farther than it saw"
    assert seen_past(sight(free), at(30.0, 6.0, -0.9), HERE, ALL) and not seen_past(
        sight(free), at(30.0, 6.0, -1.1), HERE, ALL
    )
    assert seen_past(sight(free), at(30.0, 6.0, 0.4), HERE, ALL)
    assert not seen_past(sight(free), at(30.0, 6.0, 0.6), HERE, ALL), "it may have looked over the top"
    for falls, seen in ((0.62, False), (0.68, True), (0.9, True)):  # m on 6 m: it looks over, at, and under 0.7 m
        assert seen_past(sight(free, pitch=-math.atan2(falls, 6.0)), at(0.0, 6.0, 0.7), HERE, ALL) is seen, falls
    assert not seen_past(sight(free, pitch=-0.25), at(0.0, 6.0), HERE, ALL), "a tilted ring looks over it"
    ahead = sight(np.full(37, 15.0), first=-0.5 * math.pi)  # half a ring, from the left to the right
    assert seen_past(ahead, at(60.0, 6.0), HERE, ALL) and not seen_past(ahead, at(150.0, 6.0), HERE, ALL)
    assert seen_past(ahead, at(-60.0, 6.0), HERE, ALL) and not seen_past(ahead, at(-150.0, 6.0), HERE, ALL)


@pytest.mark.parametrize("pitch_deg", [-3.0, 0.0, 3.0])
def test_a_ring_sees_past_what_was_hit_above_its_beam_and_below(pitch_deg: float) -> None:
    """At 6 m the tilt of 3 degrees is 0.31 m: over a top that was never hit so high, or under a crown."""
    pitched, place, up = sight(np.full(72, 15.0), pitch=math.radians(pitch_deg)), at(0.0, 6.0), HERE[2]
    beam = up - 6.0 * math.tan(math.radians(pitch_deg))
    for highest, lowest in ((-0.4, 0.4), (-0.4, 0.1), (-0.1, 0.4), (-0.1, 0.1)):
        heights = (up + highest, up + lowest)
        assert seen_past(pitched, place, HERE, heights) == (heights[0] <= beam <= heights[1])
