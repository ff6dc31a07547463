"""The values of a method's memory and their numbers."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import lattice
from helpers.stepwise import Stepwise
from hypothesis import given
from hypothesis import strategies as st

from stlbench.contract import Array, Integers, Unsuitable
from stlbench_planning.grid import ActionSet
from stlbench_planning.sums import USUAL, Limits, Memories

FLAGS = st.lists(st.tuples(*[st.integers(-2, 3)] * 3), min_size=1, max_size=20, unique=True)


class Counts(Stepwise):
    """Counts samples up to a limit."""

    memory_size = 1

    def __init__(self, limit: int, steps: int) -> None:
        super().__init__(lattice.specification("G[0,3] x <= 1", steps))
        self.limit = limit

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        return memory[:, 0], np.minimum(memory + 1, self.limit)


def found(limit: int, steps: int, hold: int = 1, limits: Limits = USUAL) -> Memories:
    model = lattice.model(Counts(limit, steps), hold)
    grid, actions = lattice.whole(model)
    return Memories.of(model, grid.points, ActionSet.of(model.actions, len(actions)), limits)


@given(FLAGS)
def test_each_value_has_its_own_number(rows: list[tuple[int, ...]]) -> None:
    memories = Memories(np.array(rows, dtype=float))
    assert memories.numbers(memories.values).tolist() == list(range(len(rows)))


def test_one_that_was_not_found_has_the_number_of_one_near_it() -> None:
    memories, others = Memories(np.array([[0.0], [1.0], [5.0]])), np.array([[0.9], [4.0], [9.0], [-1.0]])
    assert memories.numbers(others).tolist() == [1, 2, 2, 0]


@pytest.mark.parametrize(
    ("limit", "steps", "hold", "values"), [(3, 6, 1, 4), (9, 6, 1, 7), (9, 6, 3, 3), (63, 99, 1, 64)]
)
def test_all_that_occur_in_an_episode_are_found(limit: int, steps: int, hold: int, values: int) -> None:
    """At its decisions: of a count that grows by 3 while an action is held, only 0, 3 and 6."""
    assert len(found(limit, steps, hold)) == values


def test_more_than_can_be_planned_with_are_refused() -> None:
    """More may be asked for; several numbers are not rounded, and what fits is not."""
    with pytest.raises(Unsuitable, match=r"^a memory of 1 numbers that takes more than 64 values; a planner enumera"):
        found(99, 99)
    with pytest.raises(Unsuitable, match=r"^a memory of 2 numbers that takes more than 3 values"):
        Limits(values=3, rounded=9).rounds(np.arange(8.0).reshape(4, 2))
    assert len(found(99, 99, limits=Limits(values=100, rounded=2))) == 100


def test_one_number_is_rounded_to_evenly_spaced_values_between_its_ends() -> None:
    memories = found(99, 99, limits=Limits(values=7, rounded=5))
    assert memories.values[:, 0].tolist() == [0, 24.75, 49.5, 74.25, 99]
    assert memories.numbers(np.array([[0.0], [12.0], [13.0], [98.0]])).tolist() == [0, 0, 1, 4]


def test_a_method_without_memory_has_one_value() -> None:
    none = Memories.none()
    assert (len(none), none.numbers(np.empty((3, 0))).tolist()) == (1, [0, 0, 0])
