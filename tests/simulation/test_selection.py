"""The race of checkpoints on scores that are known beforehand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stlbench.contract import Array, Integers, Truth
from stlbench.simulation.referee import Race, race


def raced(satisfied: Array, robustness: Array) -> tuple[Race, list[tuple[list[int], int, int]]]:
    """The race of checkpoints with these scores (K, N), and which of them were played on what part."""
    played: list[tuple[list[int], int, int]] = []

    def play(which: Integers, part: slice) -> tuple[Truth, Array]:
        played.append((which.tolist(), part.start, part.stop))
        return satisfied[which, part] > 0, robustness[which, part]

    return race(play, *satisfied.shape), played


def best_of_all(satisfied: Array, robustness: Array) -> int:
    """By all the starts, of equals the first."""
    ranks = [(s.sum(), r.mean()) for s, r in zip(satisfied, robustness, strict=True)]
    return ranks.index(max(ranks))


def rows(*values: float, starts: int = 64) -> Array:
    """A checkpoint for each value, which it has from every start."""
    return np.repeat(np.array(values, dtype=float)[:, None], starts, axis=1)


class TestWhoWins:
    @pytest.mark.parametrize(
        ("satisfied", "robustness", "best"),
        [((0, 1, 0), (0.1, 0.01, 0.3), 1), ((1, 1, 1), (0.1, 0.3, 0.2), 1), ((1, 1, 0), (np.inf, np.inf, -np.inf), 0)],
        ids=["satisfaction comes first", "then the mean robustness", "which may be infinite"],
    )
    def test_by_satisfaction_and_then_robustness(self, satisfied: Any, robustness: Any, best: int) -> None:
        assert raced(rows(*satisfied), rows(*robustness))[0].best == best

    def test_of_equals_the_first_and_only_after_all_starts(self) -> None:
        found, _ = raced(rows(0, 1, 1), rows(0.1, 0.2, 0.2))
        assert found.best == 1
        assert found.starts.tolist() == [8, 64, 64]

    def test_one_alone_is_scored_from_the_first_starts(self) -> None:
        found, played = raced(rows(1), rows(0.5))
        assert (found.best, played) == (0, [([0], 0, 8)])

    @settings(max_examples=100)
    @given(st.integers(0, 10**6), st.integers(1, 12), st.integers(1, 8))
    def test_few_starts_are_all_played(self, seed: int, checkpoints: int, starts: int) -> None:
        generator = np.random.default_rng(seed)
        satisfied = generator.integers(0, 2, (checkpoints, starts)).astype(float)
        robustness = generator.normal(size=(checkpoints, starts)).round(1)
        found, played = raced(satisfied, robustness)
        assert found.best == best_of_all(satisfied, robustness)
        assert found.satisfaction == pytest.approx(satisfied.mean(axis=1))
        assert found.robustness_mean == pytest.approx(robustness.mean(axis=1))
        assert played == [(list(range(checkpoints)), 0, starts)]


class TestWhoLeaves:
    def test_rounds_double_and_only_who_is_left_plays(self) -> None:
        generator = np.random.default_rng(0)
        # the second and the third are alike but for noise, the first is far behind
        robustness = rows(-1, 0.2, 0.2) + generator.normal(0, 0.01, (3, 64))
        found, played = raced(rows(0, 1, 1), robustness)
        assert played == [([0, 1, 2], 0, 8), ([1, 2], 8, 16), ([1, 2], 16, 32), ([1, 2], 32, 64)]
        assert found.starts.tolist() == [8, 64, 64]
        assert found.best == best_of_all(rows(0, 1, 1), robustness)
        assert found.robustness_mean == pytest.approx([robustness[0, :8].mean(), *robustness[1:].mean(axis=1)])

    def test_an_eighth_of_many_starts_is_the_first_round(self) -> None:
        _, played = raced(rows(1, 1, starts=100), rows(0.1, 0.1, starts=100))
        assert [(first, end) for _, first, end in played] == [(0, 13), (13, 26), (26, 52), (52, 100)]

    @pytest.mark.parametrize(("missed", "rounds"), [(2, 2), (4, 1)])
    def test_how_far_behind_is_clearly_behind(self, missed: int, rounds: int) -> None:
        """Behind on 2 of 8 starts: by 0.25, of which the error is .164; on 4 of 8: by 0.5, of which it is .189.

        Both errors times the root of 1 - 8/16: 2.2 and 3.7 of them.
        """
        satisfied = np.ones((2, 16))
        satisfied[0, :missed] = 0
        found, played = raced(satisfied, rows(0, 0, starts=16))
        assert (found.best, len(played)) == (1, rounds)

    def test_a_lucky_start_does_not_decide(self) -> None:
        """Ahead by one start of the first eight, behind on all others."""
        satisfied = np.ones((2, 64))
        satisfied[0, 8:40], satisfied[1, 0] = 0, 0
        found, _ = raced(satisfied, rows(0.1, 0.1))
        assert found.best == 1

    def test_a_small_difference_decides_where_it_is_always_there(self) -> None:
        """Starts differ by far more than checkpoints do: the comparison is start by start, by half of them."""
        wide = 100 + np.random.default_rng(1).normal(0, 10, 64)
        found, played = raced(rows(1, 1), rows(0.1, 0.11) + wide)
        assert found.best == 1
        assert [end for _, _, end in played] == [8, 16, 32]

    def test_robustness_decides_only_where_the_leader_can_hardly_fail(self) -> None:
        """The leader is ahead nearly everywhere, but only 2 standard deviations above 0; from one start it fails."""
        wide = np.random.default_rng(1).normal(0.5, 0.25, 64)
        satisfied, robustness = np.ones((2, 64)), np.stack([wide, wide / 2])
        satisfied[0, 50], robustness[0, 50] = 0, -0.1
        found, _ = raced(satisfied, robustness)
        assert found.best == 1
        assert found.starts.tolist() == [64, 64]

    def test_a_margin_on_few_starts_is_not_enough(self) -> None:
        """The leader fails from one start in eight, without a sign of it on the first eight."""
        satisfied = np.ones((2, 64))
        satisfied[0, 8::8] = 0
        found, _ = raced(satisfied, rows(0.3, 0.2))
        assert found.best == 1

    def test_where_none_satisfies_robustness_decides_soon(self) -> None:
        wide = np.random.default_rng(1).normal(-0.5, 0.15, 64)
        found, played = raced(rows(0, 0), np.stack([wide, 2 * wide]))
        assert (found.best, len(played)) == (0, 1)

    def test_robustness_does_not_count_where_satisfaction_differs(self) -> None:
        satisfied = np.ones((2, 64))
        satisfied[0, 3], satisfied[1, 20:30] = 0, 0
        found, _ = raced(satisfied, rows(-5, 0.3))
        assert found.best == 0


@settings(max_examples=100)
@given(st.integers(0, 10**6))
def test_what_is_chosen_is_hardly_worse_than_the_best_of_all_starts(seed: int) -> None:
    """Ten checkpoints of any margin and any spread over the starts, with heavy tails."""
    generator = np.random.default_rng(seed)
    margin, spread = generator.uniform(-0.1, 0.1, (10, 1)), 10 ** generator.uniform(-4, -1, (10, 1))
    robustness = margin + spread * generator.standard_t(3, (10, 64))
    satisfied = (robustness > 0).astype(float)
    found, _ = raced(satisfied, robustness)
    best = best_of_all(satisfied, robustness)
    assert satisfied[found.best].mean() >= satisfied[best].mean() - 0.1
    assert set(found.starts.tolist()) <= {8, 16, 32, 64}
