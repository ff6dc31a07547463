"""Initial states: uniform where drawn, evenly spread and always the same where laid out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.task import load_task, starts
from stlbench.task.entry import Region

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

    def test_a_single_state_of_a_small_part_of_the_box_is_found(self) -> None:
        """Training asks for one state at the end of each episode: a miss would stop it."""
        corner = Region(box={"x": (0, 1)}, where="x >= 0.99")
        for seed in range(40):
            assert starts.sample(corner, np.random.default_rng(seed), 1) >= 0.99

    def test_a_hopeless_condition_is_an_error(self) -> None:
        with pytest.raises(UsageError, match=r"the condition 'x >= 2' holds \(almost\) nowhere in the box"):
            starts.sample(Region(box={"x": (0, 1)}, where="x >= 2"), np.random.default_rng(0), 3)


class TestGrid:
    def test_few_states_of_a_small_part_of_the_box_are_found(self) -> None:
        strip = Region(box={"x": (0, 1), "y": (0, 1)}, where="x >= 0.15 & x <= 0.156")
        many = starts.grid(strip, 64)
        for count in (1, 4):
            assert np.array_equal(starts.grid(strip, count), many[:count])

    def test_is_the_same_at_every_call_and_fulfils_the_condition(self) -> None:
        states = starts.grid(DISC, 64)
        assert np.array_equal(states, starts.grid(DISC, 64))
        assert states.shape == (64, 3)
        assert np.hypot(states[:, 0], states[:, 1]).max() <= 0.9
        assert np.all(states[:, 2] == 0.5)
        assert len(np.unique(states, axis=0)) == 64

    def test_is_spread_evenly(self) -> None:
        # a quarter of 200 in each quadrant; random draws would be off by 6 (a standard deviation)
        states = starts.grid(DISC, 200)
        quadrants = np.unique((states[:, :2] > 0) @ [1, 2], return_counts=True)[1]
        assert np.abs(quadrants - 50).max() <= 4

    def test_a_single_free_coordinate_is_cut_into_equal_pieces(self) -> None:
        """Van der Corput's sequence in base 2 without 0: 1/2, 1/4, 3/4, 1/8 of [0, 8]."""
        region = Region(box={"a": 3, "b": (0, 8)})
        assert starts.grid(region, 4).tolist() == [[3, 4], [3, 2], [3, 6], [3, 1]]

    def test_is_haltons_sequence_without_its_first_point(self) -> None:
        sequence = qmc.Halton(d=12, scramble=False)
        sequence.fast_forward(1)
        region = Region(box={f"x{i}": (0, 1) for i in range(12)})
        assert np.array_equal(starts.grid(region, 500), sequence.random(500))

    def test_a_region_of_one_state_repeats_it(self) -> None:
        assert starts.grid(Region(box={"a": 3, "b": -1}), 3).tolist() == [[3, -1]] * 3

    def test_a_hopeless_condition_is_an_error(self) -> None:
        with pytest.raises(UsageError, match=r"the condition 'x >= 2' holds \(almost\) nowhere in the box"):
            starts.grid(Region(box={"x": (0, 1)}, where="x >= 2"), 3)

    def test_a_single_state_that_breaks_its_condition_is_an_error(self) -> None:
        with pytest.raises(UsageError, match="the one state breaks the condition 'x >= 2'"):
            starts.grid(Region(box={"x": 1}, where="x >= 2"), 3)


class TestGridApart:
    """The report's states are those of the grid; those for selection come next and are others."""

    def test_the_second_set_goes_on_in_the_sequence(self) -> None:
        """1/2, 1/4, 3/4, 1/8, 5/8, 3/8 of [0, 8], as 0, 1, 2, ... mirrored in base 2."""
        report, selection = starts.grid_apart(Region(box={"x": (0, 8)}), 3, lambda points: points)
        assert report.tolist() == [[4], [2], [6]]
        assert selection.tolist() == [[1], [5], [3]]

    def test_states_count_and_not_the_points_that_lead_to_them(self) -> None:
        """Points are rounded down to even numbers: 4 2 6 | 0 4 2 6 0 ..., of which only 0 is new."""
        region = Region(box={"x": (0, 8)})
        report, selection = starts.grid_apart(region, 3, lambda points: 2 * np.floor(points / 2))
        assert report.tolist() == [[4], [2], [6]]
        assert selection.tolist() == [[0], [0], [0]]

    def test_minus_zero_is_zero(self) -> None:
        """Points 0, -4, 4; the first two lead to 0 and -0."""
        region = Region(box={"x": (-8, 8)})
        report, selection = starts.grid_apart(region, 1, lambda points: np.where(points < 0, -0.0, points))
        assert (report.tolist(), selection.tolist()) == ([[0]], [[4]])

    def test_where_all_points_lead_to_one_state_both_sets_have_it(self) -> None:
        for region in (Region(box={"x": (0, 8)}), Region(box={"x": 7})):
            report, selection = starts.grid_apart(region, 2, lambda points: np.ones((len(points), 2)))
            assert report.tolist() == selection.tolist() == [[1, 1], [1, 1]]

    @pytest.mark.parametrize("name", plugins.available("tasks"))
    def test_no_task_selects_on_states_that_it_reports_on(self, name: str) -> None:
        """Of `fetch-reach`, several points lead to one state: where no action is taken, the action does not matter."""
        task = load_task(name)
        report, selection = task.starts.report_and_selection()
        width = 1 if task.file.initial is None else len(task.system.state)  # seeds, or states
        assert report.shape == selection.shape == (task.file.starts, width)
        reported = {tuple(state) for state in report}
        assert not reported & {tuple(state) for state in selection}
        assert len({tuple(state) for state in selection}) == len(selection)
