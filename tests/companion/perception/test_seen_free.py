"""What was seen free stays free where something else explains a return."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from companion.perception.map_view import FREE, OCCUPIED
from companion.perception.rolling_map import RollingMap
from companion.state import Scan
from protocol.arrays import Array, BoolArray
from tests.companion.perception.rings import GROUND, HERE, HULL, LEVEL, SETTINGS, scan_of, see_a_post, state_at

BACK = HERE - np.array([7.0, 0.0, 0.0])
"""From where a sector is 0.9 m wide at what `HERE` has 3 m ahead, and 0.3 m."""


def ring(distance: float, sector: int = 0) -> tuple[Array, BoolArray]:
    """Ranges (72,) m of which one has returned, as a rule that of the sector ahead."""
    ranges, hit = np.full(72, 15.0), np.arange(72) == sector
    ranges[sector] = distance
    return ranges, hit


@pytest.mark.parametrize("keeps_free", [True, False])
def test_what_was_seen_free_beside_a_post_stays_free_when_the_post_is_seen_from_afar(keeps_free: bool) -> None:
    """Without that a gap beside it seems to close. A post that comes there closes it all the same."""
    rolling = RollingMap(replace(SETTINGS, keeps_free=keeps_free), HULL)
    ahead = HERE[0] + 3.0
    see_a_post(rolling, 0)
    for _ in range(6):
        rolling.add(scan_of(*ring(10.0)), BACK, LEVEL, GROUND)
    view, beside = rolling.view(0), (HERE[1] - 0.35, HERE[1] + 0.35)
    assert state_at(view, ahead, HERE[1]) == OCCUPIED
    assert [state_at(view, ahead, east) for east in beside] == [FREE if keeps_free else OCCUPIED] * 2
    for _ in range(3):
        rolling.add(scan_of(*ring(8.0)), BACK, LEVEL, GROUND)
    assert state_at(rolling.view(0), ahead - 2.0, HERE[1] + 0.1) == OCCUPIED, "nothing stands there that explains it"


@pytest.mark.parametrize("distance, closes", [(2.0, True), (4.0, False)])
def test_a_narrow_arc_closes_all_of_it(distance: float, closes: bool) -> None:
    """A post is seen from its side, and free space beside it; from up to 2.3 m that is no more than the post may be."""
    rolling, place = RollingMap(SETTINGS, HULL), HERE + np.array([distance, 0.0, 0.0])
    aside = place + np.array([0.0, 1.0, 0.0])
    for _ in range(4):
        rolling.add(scan_of(*ring(1.05, 54)), aside, LEVEL, GROUND)
    view = rolling.view(0)
    assert state_at(view, place[0], HERE[1]) == OCCUPIED and state_at(view, place[0], HERE[1] + 0.1) == FREE
    for _ in range(12):
        rolling.add(scan_of(*ring(distance)), HERE, LEVEL, GROUND)
    assert (state_at(rolling.view(0), place[0], HERE[1] + 0.1) == OCCUPIED) is closes


@pytest.mark.parametrize("sectors, keeps_free", [(24, True), (20, False), (8, False)])
def test_wide_sectors_close_what_was_seen_free(sectors: int, keeps_free: bool) -> None:
    """A post ahead whose sides were seen free in narrow sectors, and again in as many as there are, from 4 m away."""
    rolling = RollingMap(SETTINGS, HULL)
    see_a_post(rolling, 0)
    bearings: Array = np.radians(360.0 / sectors * np.arange(sectors))
    hit, known, here = np.arange(sectors) == 0, np.ones(sectors, bool), HERE - np.array([1.0, 0.0, 0.0])
    distance = 4.0 / math.cos(math.pi / sectors)  # the middle of the sector's chord is at the post
    for _ in range(12):
        rolling.add(Scan(0, 0, bearings, np.where(hit, distance, 15.0), hit, known), here, LEVEL, GROUND)
    view = rolling.view(0)
    assert state_at(view, HERE[0] + 3.0, HERE[1]) == OCCUPIED
    assert (state_at(view, HERE[0] + 3.0, HERE[1] + 0.4) == FREE) is keeps_free


@pytest.mark.parametrize("keeps_free", [True, False])
def test_a_wall_is_not_joined_over_what_was_seen_free(keeps_free: bool) -> None:
    """A wall at a slant in three sectors, and a place on it behind the arc of the one in the middle."""
    rolling = RollingMap(replace(SETTINGS, keeps_free=keeps_free), HULL)
    ranges, hit, place = np.full(72, 15.0), np.zeros(72, bool), HERE + np.array([6.0, 2.0, 0.0])
    for sector in (3, 4, 5):
        ranges[sector], hit[sector] = 2.0 / math.sin(5.0 * math.radians(sector)), True
    for seen_before in (False, True):
        if seen_before:
            for _ in range(4):
                rolling.add(scan_of(np.full(72, 1.0), np.zeros(72, bool)), place, LEVEL, GROUND)
        for _ in range(2):
            rolling.add(scan_of(ranges, hit), HERE, LEVEL, GROUND)
        assert (state_at(rolling.view(0), place[0], place[1]) == OCCUPIED) is not (seen_before and keeps_free)
