"""Axes of a grid: where points lie, and between which two of them a value is."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import lattice
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from stlbench.contract import Unsuitable
from stlbench_planning.grid import Axis, AxisRecipe, axes_of

NUMBERS = st.floats(-50, 50).map(lambda value: round(value, 6))
RISING = st.lists(NUMBERS, min_size=2, max_size=12, unique=True).map(lambda found: np.array(sorted(found)))


def by_hand(points: np.ndarray, value: float) -> tuple[int, float]:
    """The first interval that has the value, from the top, and its share below the value."""
    for i in reversed(range(len(points) - 1)):
        if points[i] <= value <= points[i + 1]:
            return i, (value - points[i]) / (points[i + 1] - points[i])
    return -1, math.nan


class TestPlace:
    @given(RISING, st.lists(NUMBERS, max_size=8))
    def test_against_a_search_by_hand(self, points: np.ndarray, values: list[float]) -> None:
        """Points themselves are asked for, too, and both ends. A value that two intervals share is in the upper."""
        asked = np.array([*values, *points])
        place = Axis(points).place(asked)
        for value, below, weight in zip(asked, place.below, place.weight, strict=True):
            index, share = by_hand(points, value)
            assert below == index
            if index >= 0:
                assert weight == pytest.approx(share, abs=1e-6)

    @given(RISING, st.lists(NUMBERS, min_size=1, max_size=8))
    def test_a_clipped_axis_has_those_outside_at_its_ends(self, points: np.ndarray, values: list[float]) -> None:
        place = Axis(points).place(np.array(values), clip=True)
        read = points[place.below] + place.weight * (points[place.below + 1] - points[place.below])
        np.testing.assert_allclose(read, np.clip(values, points[0], points[-1]), atol=1e-4)

    @given(st.floats(-30, 30), st.integers(2, 9))
    def test_on_a_periodic_axis_whole_turns_change_nothing_and_nothing_is_outside(self, value: float, n: int) -> None:
        axis = Axis(np.linspace(-math.pi, math.pi, n + 1), periodic=True)
        place = axis.place(np.array([value, value + 2 * math.pi, value - 6 * math.pi]))
        assert ((place.below >= 0) & (place.below < n)).all()
        assert ((place.weight >= 0) & (place.weight <= 1)).all()
        around = (place.below + place.weight) * 2 * math.pi / n
        np.testing.assert_allclose(np.exp(1j * around), np.exp(1j * (value + math.pi)), atol=1e-5)

    @pytest.mark.parametrize("periodic", [False, True])
    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    def test_what_is_no_number_is_outside(self, value: float, periodic: bool) -> None:
        with np.errstate(invalid="ignore"):
            assert Axis(np.linspace(0, 1, 3), periodic).place(np.array([value])).below.item() == -1


class TestPoints:
    @pytest.mark.parametrize("near", [(0.0,), (-1.0, 2.5), (3.0,), (-3.0, 3.0), (0.2, 0.21)])
    @pytest.mark.parametrize("points", [2, 5, 30, 301])
    def test_gathered_points_rise_from_end_to_end(self, near: tuple[float, ...], points: int) -> None:
        axis = Axis.of(AxisRecipe(low=-3, high=3, near=near, width=0.3, density=8), points)
        assert (len(axis), axis.points[0], axis.points[-1]) == (points, -3, 3)
        assert (np.diff(axis.points) > 0).all()

    def test_they_are_as_many_times_closer_as_the_density_says(self) -> None:
        axis = Axis.of(AxisRecipe(low=-3, high=3, near=(1.0,), width=0.3, density=8), 601)
        apart, middle = np.diff(axis.points), (axis.points[1:] + axis.points[:-1]) / 2
        far, close = apart[np.abs(middle - 1) > 1.5].mean(), apart[np.abs(middle - 1) < 0.1].mean()
        assert far / close == pytest.approx(8, rel=0.1)

    @pytest.mark.parametrize("points", [15, 60, 301])
    def test_the_values_that_points_gather_near_are_points(self, points: int) -> None:
        axis = Axis.of(AxisRecipe(low=-3, high=3, near=(-1.23, 0.0, 2.5), width=0.3), points)
        assert {-1.23, 0.0, 2.5} <= set(axis.points)

    def test_a_finer_axis_keeps_its_points(self) -> None:
        axis = Axis(np.array([0.0, 1.0, 5.0]))
        assert axis.finer(2).points.tolist() == [0, 0.5, 1, 3, 5]
        assert axis.finer(1).points.tolist() == axis.points.tolist()

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"low": 2.0}, "low = 2 must be less than high = 1"),
            ({"periodic": True, "near": (0.5,)}, "a periodic axis has evenly spaced points"),
            ({"points": 1}, "greater than or equal to 2"),
            ({"width": 0.0}, "greater than 0"),
            ({"middle": 0.0}, "not permitted"),
        ],
    )
    def test_a_recipe_that_makes_no_sense(self, change: dict[str, object], message: str) -> None:
        with pytest.raises(ValidationError, match=message):
            AxisRecipe.model_validate({"low": 0.0, "high": 1.0} | change)


class TestAxesOf:
    def test_a_column_that_is_a_signal_has_its_range(self) -> None:
        (axis,) = axes_of(lattice.task("G[0,3] x <= 1", 3), {}, 1)
        assert (axis.points[0], axis.points[-1], len(axis)) == (-lattice.REACH, lattice.REACH, 2001)

    @pytest.mark.parametrize(("resolution", "points"), [(1, 5), (2, 9), (0.5, 3), (1e-9, 2)])
    def test_the_resolution_is_a_factor_on_intervals(self, resolution: float, points: int) -> None:
        model = lattice.task("G[0,3] x <= 1", 3)
        (axis,) = axes_of(model, {"x": AxisRecipe(low=-1, high=1, points=5)}, resolution)
        np.testing.assert_allclose(axis.points, np.linspace(-1, 1, points))

    @pytest.mark.parametrize(
        ("names", "grid", "resolution", "message"),
        [
            (tuple("xbcde"), {}, 1, r"^a state of 5 dimensions; a grid has at most 4$"),
            (("x",), {"z": AxisRecipe(low=0, high=1)}, 1, r"^grid: the state has no column 'z', it has x$"),
            (("x", "speed"), {}, 1, r"^the state's speed is no signal, so it has no range; give it one: grid:"),
            (("x",), {}, 1e9, r"^an axis x of 2000000000001 points; it may have 10000000$"),
        ],
    )
    def test_what_makes_no_grid_is_refused(self, names: Any, grid: Any, resolution: float, message: str) -> None:
        model = replace(lattice.task("G[0,3] x <= 1", 3), system=lattice.Lattice(names))
        with pytest.raises(Unsuitable, match=message):
            axes_of(model, grid, resolution)
