"""The inverse sensor model: what one scan adds to a grid, without the map around it."""

import math

import numpy as np
import pytest

from companion.perception.inverse_sensor_model import Beams, Layer, add_beams, range_within_layer
from companion.perception.occupancy_grid import CEILING, FLOOR, OCCUPIED_ABOVE, Grid
from protocol.arrays import Array
from protocol.frames import from_euler

SIZE, CELL = 64, 0.25
LAYER = Layer(down=-3.0, half_height=1.5, ground_down=-0.5)


def empty_grid(corner_row: int = -SIZE // 2, corner_column: int = -SIZE // 2, memory: int = SIZE) -> Grid:
    log_odds, updated_s = np.zeros((memory, memory), np.float32), np.zeros((memory, memory), np.float32)
    return Grid(log_odds, updated_s, np.zeros((memory, memory, 3)), SIZE, corner_row, corner_column, CELL, 0.0, 0.1)


def random_beams(rng: np.random.Generator, here: Array) -> Beams:
    attitudes = np.tile(from_euler(rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), 0.4), (72, 1))
    hit, known = rng.random(72) < 0.5, rng.random(72) < 0.9
    bearings: Array = np.radians(5.0 * np.arange(72))
    return Beams(bearings, rng.uniform(0.5, 9.0, 72), hit, known, np.tile(here, (72, 1)), attitudes, math.radians(5.0))


def test_one_beam_lowers_its_wedge_and_raises_its_arc() -> None:
    """North of the sensor; behind the return and outside of the sector nothing changes."""
    grid = empty_grid()
    one = np.ones(1, np.bool_)
    pose = np.array([[0.1, 0.125, -3.0]]), np.array([from_euler(0.0, 0.0, 0.0)])
    add_beams(grid, Beams(np.zeros(1), np.array([2.0]), one, one, *pose, math.radians(5.0)), LAYER, True)
    rows, columns = np.nonzero(grid.log_odds)
    assert (columns == 0).all() and rows.tolist() == list(range(9))
    assert (grid.log_odds[:8, 0] < 0.0).all() and grid.log_odds[8, 0] == pytest.approx(0.5 * CEILING)
    assert grid.returns[8, 0] == pytest.approx([2.1, 0.125, 2.0], abs=0.5 * 2.0 * math.radians(5.0)), "on the arc"


def test_the_half_sector_on_which_an_obstacle_ends_is_believed_less() -> None:
    """Two returns side by side, 4 m ahead: the left half of the left one and the right half of the right one."""
    fine, bearings = 0.05, np.radians((-5.0, 0.0, 5.0, 10.0))
    grid = empty_grid(-128, -128, 256)._replace(size=256, cell=fine)
    here, level = np.tile((0.01, 0.01, -3.0), (4, 1)), np.tile(from_euler(0.0, 0.0, 0.0), (4, 1))
    known, hit = np.ones(4, np.bool_), np.array([False, True, True, False])
    beams = Beams(bearings, np.full(4, 4.0), hit, known, here, level, math.radians(5.0))
    for _ in range(8):
        add_beams(grid, beams, LAYER, True)
    for degrees, ends in ((-1.5, True), (1.5, False), (3.5, False), (6.5, True)):
        north, east = (4.0 * turn(math.radians(degrees)) for turn in (math.cos, math.sin))
        highest = grid.log_odds[math.floor(north / fine) - 1 :, math.floor(east / fine)][:3].max()
        assert 0.0 < highest <= 1.0 if ends else highest > 2.0, degrees


def test_log_odds_stay_within_their_bounds() -> None:
    rng = np.random.default_rng(7)
    grid = empty_grid()
    for k in range(200):
        here = np.array([*rng.uniform(-2.0, 2.0, 2), -3.0 + rng.uniform(-1.0, 1.0)])
        add_beams(grid._replace(now_s=0.066 * k), random_beams(rng, here), LAYER, True)
        assert grid.log_odds.min() >= FLOOR and grid.log_odds.max() <= CEILING
    assert grid.log_odds.min() == FLOOR and grid.log_odds.max() > 0.5 * CEILING


@pytest.mark.parametrize("shift", [(0, 3), (-7, 0), (17, -40), (64, 128)])
def test_the_place_in_memory_does_not_matter(shift: tuple[int, int]) -> None:
    """The same scans seen from elsewhere give the same cells, rolled by the shift modulo the size."""
    (rows, columns), here = shift, np.array([0.1, -0.2, -3.0])
    there = here + CELL * np.array([rows, columns, 0.0])
    first, second = empty_grid(), empty_grid(-SIZE // 2 + rows, -SIZE // 2 + columns)
    for seed in range(5):
        add_beams(first, random_beams(np.random.default_rng(seed), here), LAYER, True)
        add_beams(second, random_beams(np.random.default_rng(seed), there), LAYER, True)
    assert (first.log_odds != 0.0).sum() > 1000
    assert np.allclose(np.roll(first.log_odds, shift, (0, 1)), second.log_odds)


@pytest.mark.parametrize("corner", [(-SIZE // 2, -SIZE // 2), (64, 100), (-250, 500)])
@pytest.mark.parametrize("memory", [SIZE + 2, 3 * SIZE])
def test_a_memory_larger_than_the_window_gets_the_same_cells(corner: tuple[int, int], memory: int) -> None:
    here = np.array([*((np.array(corner) + 0.5 * SIZE) * CELL), -3.0])
    small, large = empty_grid(*corner), empty_grid(*corner, memory)
    for seed in range(5):
        for grid in (small, large):
            add_beams(grid, random_beams(np.random.default_rng(seed), here), LAYER, True)
    indices = [np.arange(first, first + SIZE) for first in corner]
    seen, kept = (grid.log_odds[np.ix_(*(i % len(grid.log_odds) for i in indices))] for grid in (small, large))
    assert np.array_equal(seen, kept)
    assert (large.log_odds != 0.0).sum() == (small.log_odds != 0.0).sum() > 1000


def test_returns_and_free_wedges_outside_of_the_layer_do_not_count() -> None:
    grid = empty_grid()
    above = random_beams(np.random.default_rng(1), np.array([0.0, 0.0, -3.0 - LAYER.half_height]))
    add_beams(grid, above, LAYER, True)
    assert not grid.log_odds.any()


def test_a_beam_is_followed_to_the_edge_of_the_layer() -> None:
    rng = np.random.default_rng(4)
    for above, down in zip(rng.uniform(-1.4, 1.4, 200), rng.uniform(-0.5, 0.5, 200), strict=True):
        there = above + range_within_layer(above, down, 1.5) * down
        assert there == pytest.approx(math.copysign(1.5, down))
    assert range_within_layer(0.3, 0.0, 1.5) == math.inf and range_within_layer(-1.6, 0.2, 1.5) == 0.0


@pytest.mark.parametrize("cell", [0.125, 0.2, 0.25, 0.5])
def test_a_wall_ahead_is_marked_wherever_in_its_cells_it_stands(cell: float) -> None:
    """The beam that meets it does not see the centre of its cell free."""
    bearings: Array = np.radians(5.0 * np.arange(-3, 4))
    one, level = np.ones(7, np.bool_), np.tile(from_euler(0.0, 0.0, 0.0), (7, 1))
    here = np.tile((0.0, 0.0, -3.0), (7, 1))
    for distance in np.arange(6.0, 12.0, 0.0631).tolist():
        grid = empty_grid(-128, -128, 256)._replace(size=256, cell=cell)
        beams = Beams(bearings, distance / np.cos(bearings), one, one, here, level, math.radians(5.0))
        for _ in range(10):
            add_beams(grid, beams, LAYER, True)
        rows, columns = np.nonzero(grid.log_odds > OCCUPIED_ABOVE)
        ahead = (np.minimum(columns, 256 - columns - 1) + 0.5) * cell < 0.5
        assert ahead.any() and np.abs((rows[ahead] + 0.5) * cell - distance).max() < 2.0 * cell, distance
