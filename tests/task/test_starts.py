"""Initial states: uniform where drawn, evenly spread and always the same where laid out."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench.errors import UsageError
from stlbench.task import starts
from stlbench.task.file import Region

DISC = Region(box={"x": (-1, 1), "y": (-1, 1), "heading": 0.5}, where="norm(x, y) <= 0.9")


class TestSample:
    def test_fills_the_region_uniformly(self) -> None:
        """In a disc of radius .9 a quarter of the area lies within .45, half of it on each side of an axis."""
        states = starts.sample(DISC, np.random.default_rng(0), 20_000)
        assert states.shape == (20_000, 3)
        radius = np.hypot(states[:, 0], states[:, 1])
        assert radius.max() <= 0.9
        assert np.all(states[:, 2] == 0.5)
        # a standard deviation is at most .0036
        assert np.mean(radius <= 0.45) == pytest.approx(0.25, abs=0.018)
        assert (states[:, :2] > 0).mean(axis=0) == pytest.approx([0.5, 0.5], abs=0.018)

    def test_is_the_generators_alone(self) -> None:
        first, again, other = (starts.sample(DISC, np.random.default_rng(seed), 10) for seed in (1, 1, 2))
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)

    def test_a_hopeless_condition_is_an_error(self) -> None:
        with pytest.raises(UsageError, match=r"the condition 'x >= 2' holds \(almost\) nowhere in the box"):
            starts.sample(Region(box={"x": (0, 1)}, where="x >= 2"), np.random.default_rng(0), 3)


class TestGrid:
    def test_is_the_same_at_every_call_and_fulfils_the_condition(self) -> None:
        states = starts.grid(DISC, 64)
        assert np.array_equal(states, starts.grid(DISC, 64))
        assert states.shape == (64, 3)
        assert np.hypot(states[:, 0], states[:, 1]).max() <= 0.9
        assert np.all(states[:, 2] == 0.5)
        assert len(np.unique(states, axis=0)) == 64

    def test_parts_share_no_state(self) -> None:
        report, selection = starts.grid(DISC, 64), starts.grid(DISC, 64, part=1)
        assert len(np.unique(np.concatenate([report, selection]), axis=0)) == 128

    def test_is_spread_evenly(self) -> None:
        # a quarter of 200 in each quadrant; random draws would be off by 6 (a standard deviation)
        states = starts.grid(DISC, 200)
        quadrants = np.unique((states[:, :2] > 0) @ [1, 2], return_counts=True)[1]
        assert np.abs(quadrants - 50).max() <= 4

    def test_a_single_free_coordinate_is_cut_into_equal_pieces(self) -> None:
        """Van der Corput's sequence in base 2 without 0: 1/2, 1/4, 3/4, 1/8 of [0, 8]."""
        region = Region(box={"a": 3, "b": (0, 8)})
        assert starts.grid(region, 4).tolist() == [[3, 4], [3, 2], [3, 6], [3, 1]]

    def test_a_region_of_one_state_repeats_it(self) -> None:
        assert starts.grid(Region(box={"a": 3, "b": -1}), 3).tolist() == [[3, -1]] * 3

    def test_a_hopeless_condition_is_an_error(self) -> None:
        with pytest.raises(UsageError, match=r"the condition 'x >= 2' holds \(almost\) nowhere in the box"):
            starts.grid(Region(box={"x": (0, 1)}, where="x >= 2"), 3)

    def test_a_single_state_that_breaks_its_condition_is_an_error(self) -> None:
        with pytest.raises(UsageError, match="the one state breaks the condition 'x >= 2'"):
            starts.grid(Region(box={"x": 1}, where="x >= 2"), 3)
