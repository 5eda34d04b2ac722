"""Rings of surroundings that stand still are believed from anywhere; frozen and random ones are not for long."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from companion.perception.ring_check import RingCheck
from companion.state import Pose, Scan
from protocol.arrays import Array
from protocol.frames import from_euler

BEARINGS = np.radians(5.0 * np.arange(72))
FAR = 15.0
PERIOD_NS = 66_000_000


def ring(ranges: Array) -> Scan:
    known = np.full(72, True)
    return Scan(0, 0, BEARINGS, np.minimum(ranges, FAR), ranges < FAR, known)


def among(trunks: Array, pose: Pose, noise: Array) -> Scan:
    """What is seen of trunks (n, 2) of half a metre's radius."""
    ranges = np.full(72, 2.0 * FAR)
    yaw = 2.0 * math.atan2(pose[1][3], pose[1][0])
    beams = np.stack([np.cos(BEARINGS + yaw), np.sin(BEARINGS + yaw)])
    for trunk in trunks - pose[0][:2]:
        along = trunk @ beams
        inside = 0.25 - (trunk @ trunk - along**2)
        seen = (inside > 0.0) & (along > 0.0)
        ranges[seen] = np.minimum(ranges[seen], along[seen] - np.sqrt(inside[seen]))
    return ring(np.round(ranges + noise, 2))


def corridor(pose: Pose) -> Scan:
    """Two walls without an end, 3 m to each side, seen by a perfect sensor that looks along them."""
    with np.errstate(divide="ignore"):
        return ring(np.round(np.minimum(3.0 / np.abs(np.sin(BEARINGS)), 2.0 * FAR), 2))


def way(speed: float, turning: float = 0.0, count: int = 60) -> Iterator[tuple[int, Pose]]:
    for i in range(count):
        s = i * PERIOD_NS * 1e-9
        yield i * PERIOD_NS, (np.array([speed * s, 0.3, -3.0]), from_euler(0.0, 0.0, turning * s))


def forest(seed: int) -> Array:
    places = np.random.default_rng(seed).uniform(-25.0, 25.0, (120, 2))
    return places[np.abs(places[:, 1]) > 1.5]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("speed", "turning"), [(0.0, 0.0), (4.0, 0.0), (2.0, 1.5), (0.0, 2.0)])
def test_a_true_ring_is_believed(seed: int, speed: float, turning: float) -> None:
    check, random = RingCheck(), np.random.default_rng(seed)
    for now, pose in way(speed, turning):
        assert check.believes(among(forest(seed), pose, random.normal(0.0, 0.02, 72)), pose, now)
        assert check.sure_ns is not None and now - check.sure_ns <= PERIOD_NS


def test_a_frozen_ring_with_a_single_return_is_none_either() -> None:
    """A vehicle that had just left the ground saw one house, and flew by that ring for three seconds."""
    check, lone = RingCheck(), np.array([[11.0, 5.4]])
    frozen = among(lone, (np.array([0.0, 0.3, -3.0]), from_euler(0.0, 0.0, 0.0)), np.zeros(72))
    assert frozen.hit.sum() == 1
    believed = [check.believes(frozen, pose, now) for now, pose in way(2.0)]
    assert believed[0] and not any(believed[5:])


def test_between_walls_a_ring_of_a_sensor_with_noise_is_frozen_once_it_repeats() -> None:
    """What a perfect sensor sees there is the same for ever, and is believed; noise never is."""
    check, random = RingCheck(), np.random.default_rng(3)
    for now, pose in way(0.0, count=20):
        noise = np.round(random.normal(0.0, 0.02, 72), 2)
        assert check.believes(ring(corridor(pose).ranges_m + noise), pose, now)
    frozen = ring(corridor(pose).ranges_m + noise)
    believed = [check.believes(frozen, moved, now + later + PERIOD_NS) for later, moved in way(2.0)]
    assert believed[0] and not any(believed[3:])
    assert check.believes(corridor(pose), pose, now + 100 * PERIOD_NS), "it is alive again"


@pytest.mark.parametrize(("speed", "turning"), [(2.0, 0.0), (0.0, 1.5)])
def test_a_frozen_ring_is_none_from_where_it_froze(speed: float, turning: float) -> None:
    check, frozen, believed = RingCheck(), None, []
    for now, pose in way(speed, turning):
        frozen = frozen or among(forest(1), pose, np.zeros(72))
        believed.append(check.believes(frozen, pose, now))
    assert believed[0] and not any(believed[5:]) and check.sure_ns == 0 and check.refused > 50
    assert check.believes(among(forest(1), pose, np.zeros(72)), pose, now + PERIOD_NS), "it is alive again"


@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_equal_rings_are_believed_where_all_looks_the_same(speed: float) -> None:
    for seen in (corridor, lambda pose: ring(np.full(72, 2.0 * FAR))):
        check = RingCheck()
        for now, pose in way(speed):
            assert check.believes(seen(pose), pose, now)


def test_a_vehicle_at_rest_may_see_the_same_for_ever() -> None:
    check = RingCheck()
    for now, pose in way(0.0):
        assert check.believes(among(forest(2), pose, np.zeros(72)), pose, now)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_a_random_ring_is_none_after_three(seed: int, speed: float) -> None:
    check, random = RingCheck(), np.random.default_rng(seed)
    believed = [check.believes(ring(random.uniform(0.3, FAR + 0.5, 72)), pose, now) for now, pose in way(speed)]
    assert not any(believed[3:]) and check.sure_ns == 0


@pytest.mark.parametrize("seed", range(5))
def test_a_wrong_ring_that_looks_right_is_doubted_with_the_next(seed: int) -> None:
    """The first random ring may have enough returns near those of the last true one; the second contradicts it."""
    check, random = RingCheck(), np.random.default_rng(seed)
    for k, (now, pose) in enumerate(way(3.0, count=12)):
        noise = np.where(np.arange(72) % 3 == 0, 3.0, 0.0) if k == 10 else np.zeros(72)
        scan = among(forest(seed), pose, noise) if k < 11 else ring(random.uniform(0.3, FAR + 0.5, 72))
        assert check.believes(scan, pose, now)
        assert check.sure_ns == (9 if k == 11 else k) * PERIOD_NS


def eighths(trunks: Array, pose: Pose) -> Scan:
    """The same as eight nearest returns, to the centimetre and without noise."""
    fine = among(trunks, pose, np.zeros(72))
    bins = np.roll(np.where(fine.hit, fine.ranges_m, FAR), 4).reshape(8, 9).min(axis=1)
    return Scan(0, 0, np.radians(45.0 * np.arange(8)), bins, bins < FAR, np.full(8, True))


@pytest.mark.parametrize(("speed", "turning"), [(0.0, 0.3), (0.0, 1.5), (1.0, 0.0), (4.0, 0.3)])
@pytest.mark.parametrize("seed", range(3))
def test_eight_sectors_that_say_the_same_while_the_vehicle_turns_are_believed(
    seed: int, speed: float, turning: float
) -> None:
    """The nearest return of 45 degrees is as far away as before, and is told twice before the beam is back. ArduPilot's
    simulated LiDAR has no noise."""
    check = RingCheck()
    poses = [pose for _, pose in way(speed, turning)]
    for k, pose in enumerate(poses):
        now = k * PERIOD_NS
        assert check.believes(eighths(forest(seed), poses[k - k % 2]), pose, now)
        assert check.sure_ns is not None and now - check.sure_ns <= 2 * PERIOD_NS


@pytest.mark.parametrize("seed", range(3))
def test_eight_sectors_that_are_frozen_are_not(seed: int) -> None:
    check = RingCheck()
    poses = [pose for _, pose in way(4.0)]
    frozen = eighths(forest(seed), poses[0])
    believed = [check.believes(frozen, pose, k * PERIOD_NS) for k, pose in enumerate(poses)]
    assert not any(believed[15:]), "a second and 4 m later"
