"""Clusters: which returns are one segment, and what is known of a segment's centroid."""

import math

import numpy as np
import pytest

from companion.config_avoidance import AvoidanceTracks
from companion.perception.clusters import Clusters, Returns, find_clusters, segments
from companion.perception.tracks import Tracker
from protocol.arrays import Array

WIDTH = math.radians(5.0)
BEARINGS: Array = np.radians(5.0 * np.arange(72))
RULE = Tracker(AvoidanceTracks())._rules[0]


def clusters_of(ranges: dict[int, float], noise: float = 0.0) -> Clusters:
    """The clusters of a ring at 2 m in which these beams alone have a return."""
    usable = np.isin(np.arange(72), list(ranges))
    measured = np.array([ranges.get(k, 15.0) for k in range(72)])
    points = np.column_stack([measured * np.cos(BEARINGS), measured * np.sin(BEARINGS), np.full(72, -2.0)])
    return Clusters(*find_clusters(Returns(points, usable, measured, np.array([0.0, 0.0, -2.0]), WIDTH, noise), RULE))


def test_segments_go_around_the_ring() -> None:
    """A segment across the last and the first beam is one; a ring in which all are connected has none."""
    ranges = np.full(72, 5.0)
    ranges[[1, 41]] = 5.15
    usable = np.zeros(72, np.bool_)
    usable[[70, 71, 0, 1, 20, 40, 41]] = True
    assert sorted(map(tuple, segments(ranges, usable, 0.2, True).tolist())) == [(20, 1), (40, 2), (70, 4)]
    assert len(segments(ranges, np.ones(72, np.bool_), 0.2, True)) == 0
    assert sorted(segments(ranges, usable, 0.1, True)[:, 1].tolist()) == [1, 1, 1, 1, 3]


@pytest.mark.parametrize("near", [slice(0, 5), slice(70, 72)])
def test_the_ends_of_a_ring_that_does_not_close_are_no_neighbours(near: slice) -> None:
    """A camera's, over 79 degrees: what stands at one edge neither hides nor continues what stands at the other."""
    ranges, usable = np.full(72, 5.0), np.ones(72, np.bool_)
    assert segments(ranges, usable, 0.2, False).tolist() == [[0, 72]]
    usable[5:70] = False
    assert segments(ranges, usable, 0.2, False).tolist() == [[0, 5], [70, 2]]
    width = math.radians(79.0 / 72.0)
    bearings = width * (np.arange(72) - 35.5)
    ranges[near] = 3.0
    points = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings), np.full(72, -2.0)])
    found = find_clusters(Returns(points, usable, ranges, np.array([0.0, 0.0, -2.0]), width, 0.0), RULE)
    assert found.spans.tolist() == [[0, 5], [70, 2]] and not found.hidden.any()


@pytest.mark.parametrize("distance", [1.5, 3.0, 6.0])
def test_who_stands_before_a_wall_is_a_cluster_at_any_distance(distance: float) -> None:
    """0.4 m before a wall: the returns of both are as near to each other as those of the wall are."""
    wall = {k % 72: (distance + 0.4) / math.cos(k * WIDTH) for k in range(-10, 11)}
    person = {k % 72: distance + 0.02 * abs(k) for k in (-1, 0, 1)}
    found = clusters_of(wall | person)
    place = found.spans.tolist().index([71, 3])
    assert found.centroids[place] == pytest.approx([distance, 0.0], abs=0.05) and not found.hidden[place]


@pytest.mark.parametrize("side", [-1, 1])
def test_what_a_nearer_return_may_hide_is_known_less_well_across_and_as_well_along(side: int) -> None:
    """On either side; beside a farther return all of it is seen."""
    alone, beside = clusters_of({0: 4.0}), clusters_of({0: 4.0, side % 72: 5.0})
    hidden = clusters_of({0: 4.0, side % 72: 3.0})
    place = int(np.flatnonzero(hidden.spans[:, 0] == 0)[0])
    assert hidden.hidden[place] and not hidden.hidden[1 - place]
    assert not alone.hidden[0] and not beside.hidden[np.flatnonzero(beside.spans[:, 0] == 0)[0]]
    along, across = np.diag(alone.covariances[0])
    assert np.diag(hidden.covariances[place]) == pytest.approx([along, across + 0.3**2])


def test_a_noisy_lidar_parts_later_and_knows_less_along() -> None:
    """With what is usual nothing changes."""
    quiet, usual, noisy = (clusters_of({0: 4.0, 1: 4.5, 20: 5.0}, noise) for noise in (0.0, 0.03, 0.1))
    assert quiet.spans.tolist() == usual.spans.tolist() == [[0, 1], [1, 1], [20, 1]]
    assert (quiet.covariances == usual.covariances).all()
    assert noisy.spans.tolist() == [[0, 2], [20, 1]]
    bearing = BEARINGS[20]
    beam, across = np.array([math.cos(bearing), math.sin(bearing)]), np.array([-math.sin(bearing), math.cos(bearing)])
    before, after = quiet.covariances[2], noisy.covariances[1]
    assert beam @ before @ beam == pytest.approx(0.08**2) and beam @ after @ beam == pytest.approx(0.15**2)
    assert across @ after @ across > across @ before @ across > 0.01


def test_a_wide_segment_is_no_cluster() -> None:
    """A wall across, and a wall all around the vehicle."""
    assert len(clusters_of({k % 72: 4.0 for k in range(-10, 11)}).spans) == 0
    assert len(clusters_of(dict.fromkeys(range(30), 0.5)).spans) == 0
