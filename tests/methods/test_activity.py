"""When a term is active, and how the rewards of active terms become one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench_methods.formula_parts import Activity, active_from, active_table, least_active


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
        # one sample: its own end, and all others at its sample, are no ends before it
        ("G[90,90] x >= 0 & F[90,190] x >= 1", [0, 90]),
        ("G[0,90] x >= 0 & F[90,90] x >= 1 & G[90,90] x <= 2", [0, 0, 0]),
        ("F[0,40] x >= 0 & F[30,30] G[60,60] x >= 1 & F[190,190] x <= 2", [0, 40, 90]),
        ("G[0,0] x >= 0 & F[0,0] x >= 1 & G[1,1] x <= 2", [0, 0, 0]),
    ],
)
def test_a_term_runs_from_the_latest_deadline_before_it(text: str, begins: list[int]) -> None:
    assert active_from(terms(text), "last-deadline") == begins
    assert active_from(terms(text), "literal") == [0] * len(begins)


def test_a_sequence_is_covered_without_gap_and_without_overlap() -> None:
    sequence = "F[2,4] x >= 0 & G[6,9] x <= 1"
    assert active_steps(sequence, 11, "last-deadline") == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]]
    assert active_steps(sequence, 11, "literal") == [[2, 3, 4], [6, 7, 8, 9]]


def test_a_term_of_one_sample_is_active_up_to_it() -> None:
    sequence = "G[3,3] x >= 0 & F[3,6] x >= 1 & F[6,6] x >= 2 & G[8,8] x >= 3"
    expected = [[0, 1, 2, 3], [4, 5, 6], [4, 5, 6], [7, 8]]
    assert active_steps(sequence, 9, "last-deadline") == expected
    assert active_steps(sequence, 9, "literal") == [[3], [3, 4, 5, 6], [6], [8]]


@st.composite
def any_terms(draw: st.DrawFn) -> str:
    """Up to four terms within 12 steps, many of one sample."""
    found = list[str]()
    for _ in range(draw(st.integers(1, 4))):
        a, b, c, d = (draw(st.integers(0, most)) for most in (6, 2, 2, 2))
        kinds = [f"F[{a},{a + b}]", f"G[{a},{a + b}]", f"F[{a},{a + b}] G[{c},{c + d}]"]
        found.append(f"{draw(st.sampled_from(kinds))} x >= {len(found)}")
    return " & ".join(found)


@given(text=any_terms(), activity=st.sampled_from(["last-deadline", "literal"]))
def test_each_term_is_active_at_its_last_sample_and_never_after_it(text: str, activity: Activity) -> None:
    for term, active in zip(terms(text), active_steps(text, 12, activity), strict=True):
        assert active[-1] == term.end
        assert active == list(range(active[0], term.end + 1))


@given(text=any_terms())
def test_a_term_of_more_samples_runs_from_the_latest_end_before_it(text: str) -> None:
    all_terms = terms(text)
    for term, t0 in zip(all_terms, active_from(all_terms, "last-deadline"), strict=True):
        if term.start < term.end:
            assert t0 == max([0, *(other.end for other in all_terms if other.end <= term.start)])


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


class Table(np.ndarray[Any, Any]):
    """An array of another library, which is read at times of its own."""

    def __getitem__(self, t: Any) -> Any:
        return np.asarray(self)[t.own]


def test_times_of_another_library_are_looked_up_by_it() -> None:
    """Nobody knows them while JAX traces, so no term is left out: the values are the same."""
    active = np.array([[False, True, True, False], [False, True, False, False]])
    least = least_active([lambda s, t: s[:, 0], lambda s, t: s[:, 1]], active)
    signals, t = np.array([[5.0, 4.0]] * 4), np.array([3, 1, 2, 0])
    library = SimpleNamespace(asarray=lambda table: table.view(Table))
    foreign: Any = SimpleNamespace(own=t, size=4, shape=(4,), __array_namespace__=lambda: library)
    assert least(signals, foreign).tolist() == least(signals, t).tolist() == [0.0, 4.0, 5.0, 0.0]
