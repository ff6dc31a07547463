"""A grid: its numbering, and what is read between its points, against SciPy's interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from stlbench_planning.grid import Axis, Grid


def uneven(dimensions: int) -> Grid:
    """Of 3 to 6 points an axis, at random distances."""
    generator = np.random.default_rng(dimensions)
    return Grid(tuple(Axis(generator.uniform(0.1, 1, 3 + i).cumsum()) for i in range(dimensions)))


def inside(grid: Grid, count: int) -> np.ndarray:
    low, high = ([axis.points[i] for axis in grid.axes] for i in (0, -1))
    return np.random.default_rng(0).uniform(low, high, (count, len(grid.axes)))


@pytest.mark.parametrize("dimensions", [1, 2, 3, 4])
class TestRead:
    def test_as_scipy_reads_it(self, dimensions: int) -> None:
        grid = uneven(dimensions)
        values = np.random.default_rng(1).normal(size=grid.size).astype(np.float32)
        truth = RegularGridInterpolator([axis.points for axis in grid.axes], values.reshape(grid.shape))
        points = np.concatenate([inside(grid, 200), grid.points])
        np.testing.assert_allclose(grid.read(values, points, -1), truth(points), atol=2e-6)

    def test_at_its_points_it_has_their_values(self, dimensions: int) -> None:
        """The number of a point is its row among them."""
        grid = uneven(dimensions)
        numbers = np.arange(grid.size, dtype=np.float32)
        np.testing.assert_allclose(grid.read(numbers, grid.points, -1), numbers, atol=1e-4)

    def test_outside_along_any_axis(self, dimensions: int) -> None:
        grid = uneven(dimensions)
        for i, axis in enumerate(grid.axes):
            for value in (axis.points[0] - 1e-6, axis.points[-1] + 1e-6, np.nan):
                point = inside(grid, 1)
                point[0, i] = value
                assert grid.read(np.ones(grid.size, np.float32), point, -7).item() == -7


def test_clipped_points_lie_at_the_border() -> None:
    grid = Grid((Axis(np.arange(3.0)), Axis(np.arange(4.0))))
    found = grid.places(np.array([[5.0, -2.0], [1.0, 9.0]]), clip=True)
    assert found.at.tolist() == [4, 6]
    assert found.weights.tolist() == [[1, 0], [0, 1]]


def test_across_the_ends_of_a_periodic_axis() -> None:
    """The last point is the first again; a value beyond it lies between the first two."""
    grid = Grid((Axis(np.array([0.0, 1.0, 2.0, 3.0]), periodic=True),))
    values = np.array([5.0, 7.0, 8.0, 5.0], np.float32)
    assert grid.read(values, np.array([[3.25], [-0.5], [3.0]]), -1).tolist() == [5.5, 6.5, 5]


def test_a_grid_says_its_size() -> None:
    grid = uneven(3)
    assert (str(grid), grid.size, grid.strides.tolist()) == ("3 x 4 x 5", 60, [20, 5, 1])
