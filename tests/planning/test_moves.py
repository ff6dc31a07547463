"""The actions that are planned with, and what they lead to."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import lattice

from stlbench.contract import ActionBox, ActionGrid
from stlbench_planning.grid import ActionSet, simulated, sweep


def grid_of(*axes: tuple[float, ...]) -> ActionGrid:
    return ActionGrid(tuple("uvw"[: len(axes)]), axes)


class TestActions:
    def test_all_of_few_the_smallest_first(self) -> None:
        actions = grid_of((-2.0, -1.0, 0.0, 1.0, 2.0))
        chosen = ActionSet.of(actions, 25)
        assert chosen.vectors[:, 0].tolist() == [0, -1, 1, -2, 2]
        assert chosen.choices.tolist() == [2, 1, 3, 0, 4]

    @pytest.mark.parametrize("most", [2, 3, 5, 8, 25, 100])
    def test_of_many_both_ends_and_the_least_are_among_them(self, most: int) -> None:
        values = tuple(np.linspace(-3, 5, 33).tolist())
        chosen = ActionSet.of(grid_of(values), most)
        assert {-3.0, 0.0, 5.0} <= set(chosen.vectors[:, 0])
        assert len(chosen) <= most + 1
        assert np.array(values)[chosen.choices].tolist() == chosen.vectors[:, 0].tolist()

    def test_of_an_axis_without_0_the_nearest_to_it_is_first(self) -> None:
        """An axis that is always 0 does not matter."""
        assert ActionSet.of(grid_of((1.0, 2.0, 3.0), (0.0,)), 25).vectors[:, 0].tolist() == [1, 2, 3]

    def test_choices_are_numbers_of_the_tasks_vectors(self) -> None:
        actions = grid_of(tuple(np.linspace(-1, 1, 21).tolist()), tuple(np.linspace(-4, 4, 13).tolist()))
        chosen = ActionSet.of(actions, 25)
        assert len(chosen) == 25
        np.testing.assert_array_equal(actions.vectors[chosen.choices], chosen.vectors)
        assert (chosen.vectors[0] == 0).all()
        size = np.linalg.norm(chosen.vectors / [1, 4], axis=1)
        assert (np.diff(size) >= -1e-12).all()

    @pytest.mark.parametrize(("most", "each"), [(25, 5), (9, 3), (4, 3), (1, 3), (16, 5)])
    def test_of_a_box_an_odd_number_of_each_axis(self, most: int, each: int) -> None:
        """So that the middle, which is 0 where both ends are as large, is among them."""
        chosen = ActionSet.of(ActionBox(("u", "v"), (-1.0, -3.0), (1.0, 3.0)), most)
        assert len(chosen) == each**2
        assert chosen.choices is chosen.vectors
        assert (chosen.vectors[0] == 0).all()
        assert chosen.vectors.max(axis=0).tolist() == [1, 3]


class TestHeld:
    def test_an_action_is_held_and_every_sample_is_seen(self) -> None:
        model = lattice.task("G[0,6] x <= 1", 6, 3, ("x", "y"))
        path, samples = simulated(model, np.zeros((1, 2)), np.array([[1.0, -1.0]]))
        assert path[:, 0].tolist() == samples[:, 0].tolist() == [[0, 0], [1, -1], [2, -2], [3, -3]]

    def test_each_action_is_held_once_from_all_states(self) -> None:
        """What leaves the grid has no place."""
        model = lattice.task("G[0,6] x <= 1", 6, 2)
        grid, actions = lattice.whole(model, 3)
        seen = dict[int, list[float]]()
        places = sweep(model, grid, actions, [lambda a, samples: seen.update({a: samples[-1, :, 0].tolist()})])
        assert seen == {0: [-3, -2, -1, 0, 1, 2, 3], 1: [-5, -4, -3, -2, -1, 0, 1], 2: [-1, 0, 1, 2, 3, 4, 5]}
        assert (places.at[1] < 0).tolist() == [True, True, False, False, False, False, False]
        read = grid.points[places.at[0], 0] + places.weights[0, :, 0]
        assert read.tolist() == seen[0]
