"""Stages of a formula: every way to go on, by hand."""

from __future__ import annotations

import numpy as np

from stlbench import stl
from stlbench_planning.maximin import Margin, Stages


def stages(formula: str, hold: int) -> Stages:
    return Stages(stl.fragment(stl.parse(formula)), hold)


def moves(formula: str, hold: int, stage: int, decision: int) -> list[tuple[int, list[tuple[int, list[int], bool]]]]:
    """(next stage, [(term, numbers of the active samples, whether the least counts)])."""

    def read(part: Margin) -> tuple[int, list[int], bool]:
        return part.term, np.flatnonzero(np.frombuffer(part.active, np.bool_)).tolist(), part.least

    return [(move.then, list(map(read, move.parts))) for move in stages(formula, hold).moves(stage, decision)]


def test_how_many_there_are() -> None:
    """1 of G, 2 of F, and of F G one more than the decisions its window lasts: 7 samples are 4 decisions of 2."""
    found = stages("G[0,4] x <= 1 & F[0,4] x >= 1 & F[0,3] G[1,7] x <= 0", 2)
    assert (found.sizes, found.count, found.over) == ((1, 2, 5), 10, 9)


def test_g_asks_for_the_least_of_the_samples_in_its_interval() -> None:
    """Decision 1 has the samples 4, 5 and 6."""
    assert moves("G[5,9] x <= 1", 3, 0, 0) == [(0, [])]
    assert moves("G[5,9] x <= 1", 3, 0, 1) == [(0, [(0, [1, 2], True)])]
    assert moves("G[5,9] x <= 1", 3, 0, 2) == [(0, [(0, [0, 1, 2], True)])]
    assert moves("G[5,9] x <= 1", 3, 0, 3) == [(0, [])]


def test_f_counts_now_or_is_put_off_while_its_interval_lasts() -> None:
    assert moves("F[2,5] x >= 1", 3, 0, 0) == [(1, [(0, [1, 2], False)]), (0, [])]
    assert moves("F[2,5] x >= 1", 3, 0, 1) == [(1, [(0, [0, 1], False)])]  # the last chance
    assert moves("F[2,5] x >= 1", 3, 1, 1) == [(1, [])]  # over
    assert moves("F[2,5] x >= 1", 3, 0, 2) == []  # missed
    assert moves("F[5,6] x >= 1", 3, 0, 0) == [(0, [])]  # not yet


def test_a_window_of_f_g_begins_with_a_decision_and_is_counted_down() -> None:
    """F[0,4] G[1,4]: 4 samples, whose first is one of 1 to 5; with decisions of 3 samples it is 1 or 4."""
    formula = "F[0,4] G[1,4] x <= 0"
    assert moves(formula, 3, 0, 0) == [(1, [(0, [0, 1, 2], True)]), (0, [])]
    assert moves(formula, 3, 1, 1) == [(2, [(0, [0], True)])]
    assert moves(formula, 3, 0, 1) == [(1, [(0, [0, 1, 2], True)])]
    assert moves(formula, 3, 2, 2) == [(2, [])]
    assert moves(formula, 3, 0, 2) == []


def test_terms_go_on_together() -> None:
    """Two F terms, stages 2 i + j: each may count now or later."""
    found = moves("F[1,4] x >= 1 & F[2,4] x <= -1", 1, 0, 1)
    assert found == [
        (3, [(0, [0], False), (1, [0], False)]),
        (2, [(0, [0], False)]),
        (1, [(1, [0], False)]),
        (0, []),
    ]


def test_which_term_can_never_begin() -> None:
    """Decisions begin with the samples 1, 4, 7, ..."""
    assert stages("F[2,3] G[0,1] x <= 0", 3).without_window() is not None
    assert stages("F[2,4] G[0,1] x <= 0", 3).without_window() is None
    assert stages("F[0,1] G[0,1] x <= 0", 3).without_window() is None
    assert stages("F[4,5] G[1,2] x <= 0 & F[5,6] x >= 1", 3).without_window() is not None
