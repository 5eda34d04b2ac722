"""The rolling map: evidence cell by cell against a plain model, sides and frames, the window, fading."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from scipy import ndimage

from companion.config_avoidance import AvoidanceMap
from companion.perception.inverse_sensor_model import FREE_STEP, Beams
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, MapView
from companion.perception.occupancy_grid import CEILING, FLOOR
from companion.perception.rolling_map import RollingMap
from companion.state import Scan
from protocol.arrays import Array, BoolArray
from protocol.frames import from_euler, rotate, to_body
from tests.companion.perception.rings import (
    GROUND,
    HERE,
    HULL,
    LEVEL,
    SETTINGS,
    scan_of,
    see_a_post,
    state_at,
)

WIDTH = math.radians(5.0)


def seen(
    ranges: Array,
    hit: BoolArray | None = None,
    attitude: Array = LEVEL,
    here: Array = HERE,
    settings: AvoidanceMap = SETTINGS,
    scans: int = 1,
) -> MapView:
    rolling = RollingMap(settings, HULL)
    for _ in range(scans):
        rolling.add(scan_of(ranges, hit), here, attitude, GROUND)
    return rolling.view(0)


def test_nothing_is_known_before_the_first_scan() -> None:
    assert (RollingMap(SETTINGS, HULL).view(0).states == UNKNOWN).all()


def test_a_wall_on_the_right_only() -> None:
    """Heading north it is in the east, heading east in the south; nothing is known behind it."""
    ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
    ranges[17:20], hit[17:20] = 4.0, True
    for yaw, (dn, de) in ((0.0, (0.0, 1.0)), (math.pi / 2, (-1.0, 0.0)), (-math.pi / 2, (1.0, 0.0))):
        view = seen(ranges, hit, from_euler(0.0, 0.0, yaw))
        assert state_at(view, HERE[0] + 4.0 * dn, HERE[1] + 4.0 * de) == OCCUPIED
        assert state_at(view, HERE[0] + 3.0 * dn, HERE[1] + 3.0 * de) == FREE
        assert state_at(view, HERE[0] + 6.0 * dn, HERE[1] + 6.0 * de) == UNKNOWN
        assert state_at(view, HERE[0] - 4.0 * dn, HERE[1] - 4.0 * de) == FREE


def test_free_wedges_against_a_model_cell_by_cell() -> None:
    """Random scans from random poses, tilted: each cell is asked for its own sector, slant range and height."""
    rng = np.random.default_rng(1)
    settings = AvoidanceMap(cell=0.5, cells=64, layer=1.5, memory_s=40.0)
    none = np.zeros(72, bool)
    for _ in range(6):
        ranges = rng.uniform(2.0, 12.0, 72)
        known = rng.random(72) > 0.1
        here = np.array([*rng.uniform(-50.0, 50.0, 2), -3.0])
        attitude = from_euler(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), rng.uniform(-3.0, 3.0))
        rolling = RollingMap(settings, 0.1)
        rolling.add(scan_of(ranges, none, known=known), here, attitude, GROUND)
        view = rolling.view(0)
        forward, right = rotate(attitude, np.array([1.0, 0.0, 0.0])), rotate(attitude, np.array([0.0, 1.0, 0.0]))
        inverse = np.linalg.inv(np.array([forward[:2], right[:2]]).T)
        wrong = doubtful = 0
        for row in range(64):
            for column in range(64):
                offset = view.centre_of((row, column)) - here[:2]
                along, across = inverse @ offset
                slant, azimuth = math.hypot(along, across), math.atan2(across, along)
                sector = round(azimuth / WIDTH) % 72
                aside = abs(azimuth - round(azimuth / WIDTH) * WIDTH)
                down = abs(rotate(attitude, np.array([math.cos(sector * WIDTH), math.sin(sector * WIDTH), 0.0]))[2])
                reach = min(ranges[sector], settings.layer / down) * math.cos(0.5 * WIDTH) / math.cos(aside)
                if math.hypot(*offset) < 0.3 or abs(slant - reach) < 1e-6 or abs(aside - 0.5 * WIDTH) < 1e-6:
                    doubtful += 1
                    continue
                expected = FREE if known[sector] and slant < reach else UNKNOWN
                wrong += view.states[row, column] != expected
        assert wrong == 0 and doubtful < 10


def test_evidence_adds_up_is_bounded_and_fades() -> None:
    """One cell ahead, hit at close range and then seen free again and again: the sum in log-odds, by hand."""
    rolling = RollingMap(SETTINGS, HULL)
    ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
    near, ahead = ranges.copy(), hit.copy()
    near[0], ahead[0] = 2.0, True
    cell = (math.floor((HERE[0] + 2.0) / 0.2) % SETTINGS.memory, math.floor(HERE[1] / 0.2) % SETTINGS.memory)
    expected, fading = 0.0, CEILING / SETTINGS.memory_s
    for k, (r, h) in enumerate([(near, ahead)] * 4 + [(ranges, hit)] * 9 + [(near, ahead)]):
        rolling.add(scan_of(r, h, k * 100_000_000), HERE, LEVEL, GROUND)
        expected = math.copysign(max(abs(expected) - 0.1 * fading, 0.0), expected) if k else 0.0
        raised, lowered = max(expected, min(expected + 0.5 * CEILING, CEILING)), max(expected - FREE_STEP, FLOOR)
        expected = raised if h[0] else lowered
        assert rolling._log_odds[cell] == pytest.approx(expected)
    assert state_at(rolling.view(1_300_000_000), HERE[0] + 2.0, HERE[1]) == OCCUPIED
    assert state_at(rolling.view(60_000_000_000), HERE[0] + 2.0, HERE[1]) == UNKNOWN


@pytest.mark.parametrize("start_s", [0.001, 10 * 86_400, 1_790_000_000, 2**31])
def test_fading_does_not_depend_on_the_absolute_time(start_s: float) -> None:
    start_ns = round(start_s * 1e9)
    bearings, attitude = np.radians(np.arange(0.0, 360.0, 5.0)), np.array([1.0, 0.0, 0.0, 0.0])
    ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
    ranges[0], hit[0] = 2.0, True

    def counts(start_ns: int) -> list[tuple[int, int]]:
        rolling = RollingMap(SETTINGS, HULL)
        for k in range(20):
            time_ns = start_ns + k * 66_000_000
            scan = Scan(time_ns, time_ns // 1000, bearings, ranges, hit, np.ones(72, bool))
            rolling.add(scan, np.array([0.0, 0.0, -3.0]), attitude, -0.5)
        views = (rolling.view(start_ns + round(s * 1e9)) for s in (2.0, 7.0, 20.0, 35.0, 36.5, 37.0, 45.0))
        return [(int((view.states == OCCUPIED).sum()), int((view.states == FREE).sum())) for view in views]

    found = counts(start_ns)
    assert found == counts(0)
    assert found[0][0] > 0 and found[0][1] > 1000 and found[-1] == (0, 0)


def test_a_wide_arc_is_believed_less() -> None:
    """At 12 m the arc is five cells wide: all are occupied, and one or two free scans from there clear them; a
    return at 2 m takes more."""
    for distance, scans in ((12.0, 2), (2.0, 8)):
        rolling = RollingMap(SETTINGS, HULL)
        ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
        ranges[0], hit[0] = distance, True
        for _ in range(20):
            rolling.add(scan_of(ranges, hit), HERE, LEVEL, GROUND)
        half = max(0.5 * distance * WIDTH - 0.15, 0.0)  # the neighbours see what lies at the ends free
        for east in np.linspace(-half, half, 9):
            assert state_at(rolling.view(0), HERE[0] + distance, HERE[1] + east) == OCCUPIED
        count = 0
        while state_at(rolling.view(0), HERE[0] + distance, HERE[1]) == OCCUPIED:
            rolling.add(scan_of(np.full(72, 15.0), np.zeros(72, bool)), HERE, LEVEL, GROUND)
            count += 1
        assert (count <= scans) if distance > 5.0 else (count >= scans)


def test_a_beam_that_passes_over_a_near_return_does_not_clear_it() -> None:
    """Nose down by 15 degrees a beam passes 3 m ahead 0.8 m lower: not where the return was."""
    rolling = RollingMap(SETTINGS, HULL)
    see_a_post(rolling, 0)
    for _ in range(20):
        rolling.add(scan_of(np.full(72, 15.0), np.zeros(72, bool)), HERE, from_euler(0.0, -0.26, 0.0), GROUND)
    assert state_at(rolling.view(0), HERE[0] + 3.0, HERE[1]) == OCCUPIED
    for _ in range(20):
        rolling.add(scan_of(np.full(72, 15.0), np.zeros(72, bool)), HERE, LEVEL, GROUND)
    assert state_at(rolling.view(0), HERE[0] + 3.0, HERE[1]) == FREE


def test_level_beams_clear_whatever_height_the_map_began_at() -> None:
    """The map began on the climb, 1.3 m lower, too little to clear it; an obstacle with strong evidence has gone."""
    settings = replace(SETTINGS, layer=3.0)
    rolling = RollingMap(settings, HULL)
    nothing = scan_of(np.full(72, 15.0), np.zeros(72, bool))
    rolling.add(nothing, HERE + np.array([0.0, 0.0, 1.3]), LEVEL, GROUND)
    hit = np.zeros(72, bool)
    hit[0] = True
    for _ in range(10):
        rolling.add(scan_of(np.where(hit, 2.0, 15.0), hit), HERE, LEVEL, GROUND)
    assert state_at(rolling.view(0), 2.05, -0.03) == OCCUPIED
    for _ in range(10):
        rolling.add(nothing, HERE, LEVEL, GROUND)
    assert state_at(rolling.view(0), 2.05, -0.03) == FREE


def test_returns_from_the_ground_and_above_the_layer_are_no_obstacles() -> None:
    """Nose down 20 degrees at 3 m: forward the ground at 8.8 m, backward something 5 m away and 1.7 m up."""
    ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
    ranges[0], ranges[36] = 3.0 / math.sin(math.radians(20.0)), 5.0
    hit[0] = hit[36] = True
    view = seen(ranges, hit, from_euler(0.0, -math.radians(20.0), 0.0), scans=5)
    assert not (view.states == OCCUPIED).any()
    assert state_at(view, 4.0, 0.0) == FREE  # the layer of 1.5 m is left after 4.4 m
    assert state_at(view, 5.0, 0.0) == UNKNOWN
    low = seen(ranges, hit, from_euler(0.0, -math.radians(20.0), 0.0), np.array([0.0, 0.0, -1.0]), scans=5)
    assert not (low.states == OCCUPIED).any()


def test_unknown_sectors_and_moving_returns_leave_no_mark() -> None:
    ranges, hit, known = np.full(72, 15.0), np.zeros(72, bool), np.ones(72, bool)
    ranges[0], hit[0] = 5.0, True
    known[18] = False
    rolling = RollingMap(SETTINGS, HULL)
    rolling.add(scan_of(ranges, hit, known=known), HERE, LEVEL, GROUND, moving=hit)
    view = rolling.view(0)
    assert not (view.states == OCCUPIED).any()
    assert state_at(view, 4.0, 0.0) == FREE and state_at(view, 6.0, 0.0) == UNKNOWN
    assert state_at(view, 0.0, 5.0) == UNKNOWN and state_at(view, 0.0, -5.0) == FREE


@pytest.mark.parametrize(("away", "marked"), [(4.0, True), (5.5, True), (8.0, False)])
def test_the_whole_arc_of_a_wide_sector_is_occupied_where_it_is_near(away: float, marked: bool) -> None:
    """The return in one of eight sectors is anywhere between its edges; and all obstacles count for larger."""
    ranges, hit = np.full(8, 15.0), np.zeros(8, bool)
    ranges[0], hit[0] = away, True
    rolling = RollingMap(SETTINGS, HULL)
    for _ in range(3):
        rolling.add(Scan(0, 0, np.radians(45.0 * np.arange(8)), ranges, hit, np.ones(8, bool)), HERE, LEVEL, GROUND)
    view = rolling.view(0)
    chord = away * math.cos(math.pi / 8.0)
    for bearing in np.radians((-20.0, 0.0, 20.0)):
        assert (state_at(view, chord, chord * math.tan(bearing)) == OCCUPIED) is marked
    distance = view.distance_at(np.array([chord - 2.0, 0.0]))
    assert distance is not None and (distance == pytest.approx(2.0 - 0.3, abs=0.15) if marked else distance > 2.0)


@pytest.mark.parametrize("above, below, pitch, marked", [
    (math.inf, math.inf, -10.0, True),
    (math.inf, 0.4, -10.0, False),
    (math.inf, 0.6, -10.0, True),
    (0.4, math.inf, -10.0, True),
    (math.inf, 0.4, 10.0, True),
    (0.4, math.inf, 10.0, False),
    (0.6, math.inf, 10.0, True),
])  # fmt: skip
def test_returns_that_are_not_in_the_way_mark_nothing(above: float, below: float, pitch: float, marked: bool) -> None:
    """A wall 3 m ahead that the leaning scan meets half a metre below or above the vehicle. Level beams see it from
    both. Nothing is said of what lies behind."""
    ranges, hit, attitude = np.full(72, 6.0), np.zeros(72, bool), from_euler(0.0, math.radians(pitch), 0.0)
    ranges[0], hit[0] = 3.0, True
    ahead = HERE[0] + 3.0 * math.cos(math.radians(pitch))
    rolling = RollingMap(SETTINGS, HULL)
    rolling.in_the_way = above, below
    for _ in range(3):
        rolling.add(scan_of(ranges, hit), HERE, attitude, GROUND)
    view = rolling.view(0)
    assert state_at(view, ahead, HERE[1]) == (OCCUPIED if marked else UNKNOWN)
    assert state_at(view, HERE[0] + 2.0, HERE[1]) == FREE and state_at(view, ahead + 0.4, HERE[1]) == UNKNOWN
    rolling.add(scan_of(ranges, hit), HERE, LEVEL, GROUND)
    assert state_at(rolling.view(0), HERE[0] + 3.0, HERE[1]) == OCCUPIED


def test_each_beam_with_the_pose_of_its_own_time() -> None:
    """The same range from two places along the way marks two places."""
    rolling = RollingMap(SETTINGS, HULL)
    positions = np.array([[0.1, 0.1, -3.0], [1.1, 0.1, -3.0]])
    attitudes = np.array([from_euler(0.0, 0.0, -math.pi / 2), from_euler(0.0, 0.0, math.pi / 2)])
    both = np.ones(2, bool)
    beams = Beams(np.zeros(2), np.array([3.0, 3.0]), both, both, positions, attitudes, WIDTH)
    rolling.add_beams(0, beams, GROUND)
    view = rolling.view(0)
    assert state_at(view, 0.1, -2.9) == OCCUPIED and state_at(view, 1.1, 3.1) == OCCUPIED
    assert state_at(view, 1.1, -2.9) != OCCUPIED and state_at(view, 0.1, 3.1) != OCCUPIED


@pytest.mark.parametrize("memory_cells", [0, 500, 1024])
def test_the_window_moves_and_what_leaves_it_is_remembered_within_the_memory(memory_cells: int) -> None:
    """Flown 60 m and back: an obstacle is seen as long as it is in the window, never appears at an alias, and is known
    at the return if it was no farther away than half of the memory."""
    rolling = RollingMap(replace(SETTINGS, memory_cells=memory_cells), HULL)
    see_a_post(rolling, 18)
    corner = rolling.view(0).corner
    nothing = np.zeros(72, bool)
    for north in np.arange(0.5, 60.0, 0.5):
        here = np.array([north, HERE[1], -3.0])
        rolling.add(scan_of(np.full(72, 0.5), nothing), here, from_euler(0.0, 0.0, math.pi), GROUND)
        view = rolling.view(0)
        inside = view.contains(view.cell_of(np.array([HERE[0], HERE[1] + 3.0])))
        assert (view.states == OCCUPIED).any() == inside == (north < 25.8)
    rolling.add(scan_of(np.full(72, 0.5), nothing), HERE, LEVEL, GROUND)
    assert rolling.view(0).corner == corner
    assert (rolling.view(0).states == OCCUPIED).any() == (memory_cells * SETTINGS.cell > 2 * 60.0)


def test_all_that_is_remembered_is_seen_at_its_place_from_far_away() -> None:
    """A post is seen from 3 m, and the vehicle flies 50 m on: the window has lost it, the whole memory has not."""
    rolling = RollingMap(SETTINGS, HULL)
    see_a_post(rolling, 18)
    here = HERE + np.array([50.0, 0.0, 0.0])
    rolling.add(scan_of(np.full(72, 0.5), np.zeros(72, bool)), here, LEVEL, GROUND)
    assert not (rolling.view(0).states == OCCUPIED).any()
    whole, post = rolling.whole(0), HERE[:2] + np.array([0.0, 3.0])
    assert whole.hits is not None and whole.cell == pytest.approx(SETTINGS.cell)
    assert np.hypot(*(whole.hits - post).T).max() < 0.4
    assert (whole.distance_at(post) or 0.0) < 0.4 and whole.state_at(here) == FREE
    assert whole.state_at(HERE + np.array([0.0, 1.5, 0.0])) == FREE


def test_turning_or_mirroring_the_world_turns_or_mirrors_the_map() -> None:
    rng = np.random.default_rng(2)
    centre = np.array([0.1, 0.1, -3.0])
    ranges, hit = rng.uniform(1.0, 14.0, 72), rng.random(72) < 0.6
    tilted = from_euler(0.1, -0.15, 0.3)
    states = seen(ranges, hit, tilted, centre).states[1:, 1:]
    turned = seen(ranges, hit, from_euler(0.1, -0.15, 0.3 + math.pi / 2), centre).states[1:, 1:]
    assert (turned != np.rot90(states)).mean() < 1e-4
    back = -np.arange(72) % 72
    mirrored = seen(ranges[back], hit[back], from_euler(-0.1, -0.15, -0.3), centre).states[1:, 1:]
    assert (mirrored != states[:, ::-1]).mean() < 1e-4


def test_a_change_of_height_clears_the_map() -> None:
    rolling = RollingMap(SETTINGS, HULL)
    ranges = np.full(72, 3.0)
    rolling.add(scan_of(ranges), HERE, LEVEL, GROUND)
    assert (rolling.view(0).states == OCCUPIED).any()
    rolling.add(scan_of(ranges, np.zeros(72, bool)), HERE + np.array([0.0, 0.0, -2.0]), LEVEL, GROUND)
    assert not (rolling.view(0).states == OCCUPIED).any()


def test_a_place_is_forgotten() -> None:
    rolling = RollingMap(SETTINGS, HULL)
    rolling.add(scan_of(np.full(72, 3.0)), HERE, LEVEL, GROUND)
    before = rolling.view(0).states.copy()
    rolling.forget(np.array([3.0, 0.0]), 0.3, 0.8, 0)
    view = rolling.view(0)
    assert state_at(view, 3.05, 0.0) == UNKNOWN and state_at(view, -2.99, -0.03) == OCCUPIED
    centres = np.moveaxis(np.array([[view.centre_of((i, j)) for j in range(256)] for i in range(256)]), 2, 0)
    away = np.hypot(centres[0] - 3.0, centres[1])
    assert (view.states[away <= 0.3] == UNKNOWN).all() and not (view.states[away <= 0.8] == OCCUPIED).any()
    was_free = (away > 0.31) & (before == FREE)
    assert (was_free & (away < 0.8)).any() and (view.states[was_free] == FREE).all(), "what was seen free stays so"


@pytest.mark.parametrize("aside", [0.0, 0.09, 0.19])
def test_a_scan_that_sees_beyond_the_window_leaves_its_border_unknown(aside: float) -> None:
    """Wherever in its cell the vehicle is; up to the border all is free."""
    view = seen(np.full(72, 100.0), np.zeros(72, bool), here=HERE + np.array([aside, -aside, 0.0]))
    assert (view.states == OCCUPIED).sum() == 0
    for border in (view.states[:2], view.states[-2:], view.states[:, :2], view.states[:, -2:]):
        assert (border == UNKNOWN).all()
    size = SETTINGS.cells
    middle = size // 2
    for cell in ((4, middle), (size - 5, middle), (middle, 4), (middle, size - 5)):
        assert view.states[cell] == FREE


def test_all_cells_up_to_the_range_are_free() -> None:
    """The free disc has no pinholes."""
    view = seen(np.full(72, 10.0), np.zeros(72, bool))
    rows, columns = np.indices(view.states.shape)
    centres = (np.stack([rows, columns], -1) + np.array(view.corner) + 0.5) * view.cell
    away = np.hypot(*(centres - HERE[:2]).transpose(2, 0, 1))
    assert (view.states[away < 9.9] == FREE).all() and (view.states[away > 10.05] == UNKNOWN).all()


def test_an_odd_size_is_refused() -> None:
    with pytest.raises(ValueError, match="251: not an even"):
        AvoidanceMap(cell=0.2, cells=251)


def test_a_free_beam_has_the_direction_that_the_frames_say() -> None:
    """A single known sector, 30 degrees to the right of a nose that points 40 degrees: free along 70 degrees."""
    known = np.zeros(72, bool)
    known[6] = True
    rolling = RollingMap(SETTINGS, HULL)
    attitude = from_euler(0.0, 0.0, math.radians(40.0))
    rolling.add(scan_of(np.full(72, 8.0), np.zeros(72, bool), known=known), HERE, attitude, GROUND)
    free = np.argwhere(rolling.view(0).states == FREE)
    for cell in free:
        offset = rolling.view(0).centre_of((int(cell[0]), int(cell[1]))) - HERE[:2]
        body = np.array(to_body(attitude, np.array([*offset, 0.0])))
        if math.hypot(*offset) > HULL:
            assert abs(math.atan2(body[1], body[0]) - math.radians(30.0)) < 0.5 * WIDTH + 1e-9
    assert len(free) > 50


def walled(distance: float, slope: float, gap: tuple[float, float] | None = None) -> tuple[Array, BoolArray]:
    """Ranges of a long thin wall that crosses the way north at a distance, turned by a slope, the nearest of five beams
    a sector; nothing in a gap (m along it)."""
    beams = np.radians(5.0 * np.arange(72)[:, None] + np.linspace(-2.0, 2.0, 5)[None, :])
    closing = np.cos(beams) - slope * np.sin(beams)
    reach = np.where(closing > 1e-3, distance / np.maximum(closing, 1e-3), np.inf)
    if gap is not None:
        along = reach * np.sin(beams)
        reach = np.where((along > gap[0]) & (along < gap[1]), np.inf, reach)
    ranges = reach.min(axis=1)
    return np.minimum(ranges, 15.0), ranges < 15.0


@pytest.mark.parametrize("slope", [0.0, 0.6, -0.6, 1.2])
def test_a_wall_seen_at_a_slant_has_no_holes(slope: float) -> None:
    """No way leads through between the arcs of its sectors, though each is a step behind the last; one leads through
    where there is a gap as wide as a door."""
    here, beyond = (SETTINGS.cells // 2 + round(north / SETTINGS.cell) for north in (0.0, 8.1))
    for gap, leads_through in ((None, False), ((-1.5, 1.5), True)):
        view = seen(*walled(6.0, slope, gap), scans=3)
        near = view.to_occupied[here - 10 : beyond + 1, here - 25 : here + 26] >= 0.6
        parts, _ = ndimage.label(near, structure=np.ones((3, 3)))
        assert parts[10, 25] > 0 and parts[-1, 25] > 0
        assert (parts[10, 25] == parts[-1, 25]) == leads_through


def test_short_distances_are_measured_to_the_return() -> None:
    """An obstacle dead ahead, wherever in its cell: the distance at a place before it is that to the arc."""
    for distance in (2.0, 2.07, 2.13, 2.19):
        ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
        ranges[[71, 0, 1]], hit[[71, 0, 1]] = distance, True
        view = seen(ranges, hit)
        place = view.centre_of(view.cell_of(HERE + np.array([distance - 0.5, 0.0, 0.0])))
        arc = HERE[:2] + distance * np.stack([np.cos(t := np.radians(np.arange(-7.5, 7.5, 0.1))), np.sin(t)], axis=1)
        exact = np.hypot(*(arc - place).T).min()
        assert view.to_occupied[view.cell_of(place)] == pytest.approx(exact, abs=0.03)


@pytest.mark.parametrize(
    ("ranges_m", "blur"), [((0.6,), 0.0), ((3.0,), 0.262), ((3.0, 2.0), 0.175), ((2.0, 3.0), 0.175)]
)
def test_a_return_is_as_blurred_as_from_the_nearest_look(ranges_m: tuple[float, ...], blur: float) -> None:
    """A sector of 5 degrees is 0.262 m wide at 3 m; the obstacle is 3 m north of the first place in each look."""
    rolling = RollingMap(SETTINGS, HULL)
    for distance in ranges_m:
        ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
        ranges[[71, 0, 1]], hit[[71, 0, 1]] = distance, True
        place = HERE + np.array([ranges_m[0] - distance, 0.0, 0.0])
        rolling.add(scan_of(ranges, hit), place, LEVEL, GROUND)
    view = rolling.view(0)
    assert view.hits is not None and view.blurs is not None
    nearest = np.hypot(*(view.hits - HERE[:2] - [ranges_m[0], 0.0]).T).argmin()
    assert view.blurs[nearest] == pytest.approx(blur, abs=1e-3)
