"""The distance field: against scipy's exact transform, at the smallest cell, between the cells."""

import math

import numpy as np
import pytest
from scipy import ndimage

from companion.perception.distance_field import FAR_M, between, distance_to, fill_distances_to_returns
from companion.runtime.files import load_settings
from protocol.toml_files import TomlFileError


def test_distances_against_scipy() -> None:
    rng = np.random.default_rng(3)
    for density in (0.0005, 0.01, 0.3):
        marked = rng.random((70, 70)) < density
        marked[5, 60] = True
        exact = 0.2 * ndimage.distance_transform_edt(~marked)
        assert np.allclose(distance_to(marked, 0.2), np.minimum(exact, FAR_M), rtol=1e-6)
    assert (distance_to(np.zeros((16, 16), bool), 0.2) == FAR_M).all()


def test_distances_at_the_smallest_cell_that_settings_allow() -> None:
    smallest = 0.025
    with pytest.raises(TomlFileError, match=r"avoidance\.map\.cell"):
        load_settings(None, [f"avoidance.map.cell={math.nextafter(smallest, 0.0)}"])
    assert load_settings(None, [f"avoidance.map.cell={smallest}"]).avoidance.map.cell == smallest
    marked = np.zeros((320, 320), bool)
    marked[[140, 200, 310], [160, 90, 10]] = True
    exact = ndimage.distance_transform_edt(~marked) * smallest
    assert np.allclose(distance_to(marked, smallest), np.minimum(exact, FAR_M), rtol=1e-6)


def test_between_is_linear_and_nothing_outside() -> None:
    slope = np.add.outer(2.0 * np.arange(6.0), 3.0 * np.arange(5.0))
    for row, column in ((0.0, 0.0), (2.25, 1.5), (4.75, 3.999)):
        assert between(slope, row, column) == pytest.approx(2.0 * row + 3.0 * column)
    for row, column in ((-0.1, 2.0), (2.0, -0.1), (5.1, 2.0), (2.0, 4.5)):
        assert between(slope, row, column) == 0.0


def test_short_distances_are_those_to_the_returns() -> None:
    """Against all pairs: to the nearest return where that is near, to the nearest cell's centre elsewhere."""
    rng = np.random.default_rng(5)
    cell, corner = 0.2, (-30, 17)
    marked = rng.random((60, 50)) < 0.01
    cells = np.argwhere(marked) + np.array(corner)
    returns = (cells + rng.random(cells.shape)) * cell
    distances = np.empty(marked.shape, np.float32)
    fill_distances_to_returns(distances, marked, returns, corner, cell)
    centres = (np.moveaxis(np.indices(marked.shape), 0, -1) + np.array(corner) + 0.5) * cell
    to_returns = np.hypot(*np.moveaxis(centres[:, :, None] - returns, -1, 0)).min(axis=-1)
    to_centres = np.minimum(cell * ndimage.distance_transform_edt(~marked), FAR_M)
    near, far = to_returns < 0.799, to_returns > 0.801
    assert near.sum() > 300 and far.sum() > 300
    assert np.allclose(distances[near], to_returns[near], atol=1e-5)
    assert np.allclose(distances[far], np.maximum(to_centres, 0.8)[far], atol=1e-5)
