"""When a term is active, and how the rewards of active terms become one."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench import stl
from stlbench_methods.schedule import Activity, active_from, active_table, least_active


def terms(text: str) -> tuple[stl.Term, ...]:
    return stl.fragment(stl.parse(text))


def active_steps(text: str, steps: int, activity: Activity) -> list[list[int]]:
    return [np.flatnonzero(row).tolist() for row in active_table(terms(text), steps, activity)]


@pytest.mark.parametrize(
    ("text", "begins"),
    [
        ("G[3,5] x >= 0", [0]),
        # eq. 11: the second funnel runs from b1
        ("F[2,4] x >= 0 & G[6,9] x <= 1", [0, 4]),
        # eq. 15, the pendulum: t, t - 700, t - 1200
        ("G[400,700] x >= 0 & G[1000,1200] x >= 0 & G[1700,2000] x >= 0", [0, 700, 1200]),
        # the order of the conjuncts does not matter, and of two deadlines it is the later one that counts
        ("G[10,12] x >= 0 & F[0,3] x >= 0 & F[4,6] x >= 0", [6, 0, 3]),
        # the paper's overlap task: nothing ends before F[0,50] starts; F[0,50] itself ends at the start of F[50,90]
        ("G[0,100] x >= 0 & F[0,50] x >= 1 & F[50,90] x >= 2", [0, 0, 50]),
        # F[1,2] G[3,4] is observed until step 2 + 4
        ("F[1,2] G[3,4] x >= 0 & G[6,8] x >= 0", [0, 6]),
    ],
)
def test_a_term_runs_from_the_latest_deadline_before_it(text: str, begins: list[int]) -> None:
    assert active_from(terms(text), "last-deadline") == begins
    assert active_from(terms(text), "literal") == [0] * len(begins)


def test_a_sequence_is_covered_without_gap_and_without_overlap() -> None:
    sequence = "F[2,4] x >= 0 & G[6,9] x <= 1"
    assert active_steps(sequence, 11, "last-deadline") == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]]
    assert active_steps(sequence, 11, "literal") == [[2, 3, 4], [6, 7, 8, 9]]


def test_terms_that_overlap_are_active_together() -> None:
    overlap = "G[0,10] x >= 0 & F[3,5] x >= 1 & F[5,8] x >= 2"
    assert active_steps(overlap, 10, "last-deadline") == [list(range(11)), [0, 1, 2, 3, 4, 5], [6, 7, 8]]
    assert active_steps(overlap, 10, "literal") == [list(range(11)), [3, 4, 5], [5, 6, 7, 8]]


def test_the_reward_is_the_minimum_of_the_active_terms_and_0_without_any() -> None:
    # Algorithm 1 starts from 0 and could never pay 3 at t = 1 or 5 at t = 2; METHODS.md: the active terms only.
    active = np.array([[False, True, True, False], [False, True, False, True]])
    least = least_active([lambda s, t: s[:, 0], lambda s, t: s[:, 1] - t], active)
    signals = np.array([[5.0, 4.0]] * 4)
    assert least(signals, np.arange(4)).tolist() == [0.0, 3.0, 5.0, 1.0]
    assert least(signals, np.array([3, 1, 1, 0])).tolist() == [1.0, 3.0, 3.0, 0.0]
    assert least(-signals, np.arange(4)).tolist() == [0.0, -5.0, -5.0, -7.0]
