"""The cells of the occupancy grid: fading, the window's memory, discs, classification."""

import numpy as np
import pytest

from companion.perception.distance_field import Floats
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN
from companion.perception.occupancy_grid import (
    FREE_BELOW,
    OCCUPIED_ABOVE,
    Grid,
    classify,
    classify_coarse,
    faded,
    move_memory,
    set_disc,
)
from protocol.arrays import Array

SIZE, CELL = 16, 0.5
CORNERS = [(0, 0), (-5, 7), (1003, -1009)]
MEMORIES = [SIZE, SIZE + 6, 4 * SIZE]


def grid_of(log_odds: Floats, corner: tuple[int, int], now_s: float = 0.0, fading: float = 0.0) -> Grid:
    times, returns = np.zeros(log_odds.shape, np.float32), np.zeros((*log_odds.shape, 3))
    return Grid(log_odds, times, returns, SIZE, *corner, CELL, now_s, fading)


def in_order(values: Array | Floats, corner: tuple[int, int]) -> Array:
    """The window's cells in its order, from that of the memory."""
    rows, columns = (np.arange(first, first + SIZE) % len(values) for first in corner)
    return np.asarray(values[np.ix_(rows, columns)], np.float64)


def test_fading_ends_at_unknown() -> None:
    for value in (-1.0, 0.0, 2.5):
        assert faded(value, 0.0, 0.1) == value and faded(value, 100.0, 0.1) == 0.0
        assert faded(faded(value, 3.0, 0.1), 4.0, 0.1) == pytest.approx(faded(value, 7.0, 0.1))
        assert faded(-value, 5.0, 0.1) == -faded(value, 5.0, 0.1)


@pytest.mark.parametrize("corner", CORNERS)
@pytest.mark.parametrize("step", [(0, 0), (3, -2), (-1, 0), (SIZE, 0), (5, 40)])
def test_the_memory_keeps_what_stays_in_it(corner: tuple[int, int], step: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    log_odds = rng.uniform(1.0, 2.0, (SIZE, SIZE)).astype(np.float32)
    before = in_order(log_odds, corner)
    moved = corner[0] + step[0], corner[1] + step[1]
    move_memory(log_odds, *corner, *moved)
    after = in_order(log_odds, moved)
    for i in range(SIZE):
        for j in range(SIZE):
            row, column = i + step[0], j + step[1]
            stays = 0 <= row < SIZE and 0 <= column < SIZE
            assert after[i, j] == (before[row, column] if stays else 0.0)


@pytest.mark.parametrize("memory", MEMORIES)
@pytest.mark.parametrize("corner", CORNERS)
def test_a_disc_is_set_within_the_window_alone(corner: tuple[int, int], memory: int) -> None:
    """At the window's edge the part outside is not wrapped to the other side."""
    rng = np.random.default_rng(2)
    indices = np.indices((SIZE, SIZE))
    centres = [(axis + first + 0.5) * CELL for axis, first in zip(indices, corner, strict=True)]
    log_odds = rng.uniform(-1.0, 1.0, (memory, memory)).astype(np.float32)
    before, beyond = in_order(log_odds, corner), log_odds.copy()
    north, east = (corner[0] + 1.3) * CELL, (corner[1] + 9.1) * CELL
    away = np.hypot(centres[0] - north, centres[1] - east)
    set_disc(grid_of(log_odds, corner), north, east, 1.7, 3.0, False)
    assert 0 < (away <= 1.7).sum() < 60
    assert np.array_equal(in_order(log_odds, corner), np.where(away <= 1.7, 3.0, before))
    assert (log_odds != beyond).sum() == (away <= 1.7).sum(), "beyond the window nothing changes"
    grid = grid_of(rng.uniform(-1.0, 1.0, (memory, memory)).astype(np.float32), corner)
    grid.returns[:] = rng.uniform(0.0, 2.0, grid.returns.shape)
    before, certain = in_order(grid.log_odds, corner).copy(), in_order(grid.returns[:, :, 2], corner) < 0.7
    set_disc(grid, north, east, 1.7, 0.0, True)
    set_disc(grid, north, east, 1.1, 0.0, False)
    gone = np.where(before > 0.0, (away <= 1.7) & ~certain, away <= 1.1)
    assert (certain & (before > 0.0) & (away <= 1.1)).any(), "what is certain stays"
    assert np.array_equal(in_order(grid.log_odds, corner), np.where(gone, 0.0, before))


@pytest.mark.parametrize("memory", MEMORIES)
@pytest.mark.parametrize("corner", CORNERS)
def test_classification_against_a_model(corner: tuple[int, int], memory: int) -> None:
    rng = np.random.default_rng(3)
    grid = grid_of(rng.uniform(-1.5, 1.5, (memory, memory)).astype(np.float32), corner, now_s=4.0, fading=0.1)
    grid.returns[:] = rng.uniform(0.0, 2.0, grid.returns.shape)
    grid.updated_s[:] = rng.uniform(0.0, 4.0, grid.updated_s.shape)
    states = np.empty((SIZE, SIZE), np.uint8)
    hits = classify(grid, states)
    values = in_order(grid.log_odds, corner)
    left = np.sign(values) * np.maximum(np.abs(values) - 0.1 * (4.0 - in_order(grid.updated_s, corner)), 0.0)
    expected = np.where(left > OCCUPIED_ABOVE, OCCUPIED, np.where(left < FREE_BELOW, FREE, UNKNOWN))
    assert np.array_equal(states, expected) and set(np.unique(states)) == {UNKNOWN, FREE, OCCUPIED}
    returns = np.stack([in_order(grid.returns[:, :, k], corner) for k in range(3)], -1)
    assert np.array_equal(hits, returns[states == OCCUPIED])


@pytest.mark.parametrize("factor", [1, 2, 3])
@pytest.mark.parametrize("corner", CORNERS)
def test_a_coarse_cell_is_what_its_cells_are(corner: tuple[int, int], factor: int) -> None:
    """Occupied where one of them is, else free where one is, with a return of one that is occupied."""
    rng, memory = np.random.default_rng(4), 4 * SIZE
    log_odds = np.where(rng.random((memory, memory)) < 0.3, rng.uniform(-1.0, 1.0, (memory, memory)), 0.0)
    grid = grid_of(log_odds.astype(np.float32), corner, now_s=10.0, fading=0.01)
    grid.returns[:] = rng.random((memory, memory, 3))
    first, count = (corner[0] // factor - 3, corner[1] // factor - 5), 18
    states = np.empty((count, count), np.uint8)
    hits = classify_coarse(tuple(grid), factor, first, states)
    found = 0
    for i, j in np.ndindex(count, count):
        rows, columns = (np.arange(at * factor, (at + 1) * factor) % memory for at in (first[0] + i, first[1] + j))
        cells = [faded(value, 10.0, 0.01) for value in log_odds[np.ix_(rows, columns)].astype(np.float32).flat]
        occupied = [value > OCCUPIED_ABOVE for value in cells]
        if any(occupied):
            assert states[i, j] == OCCUPIED
            returns = grid.returns[np.ix_(rows, columns)].reshape(-1, 3)[occupied]
            assert (hits[found] == returns).all(axis=1).any()
            found += 1
        else:
            assert states[i, j] == (FREE if any(-value > -FREE_BELOW for value in cells) else UNKNOWN)
    assert found == len(hits) > 20
