"""A schedule around witnesses: by hand, and that it is sound and satisfied on generated formulas."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from stlbench import stl
from stlbench.schedules.regions import Regions
from stlbench.schedules.schedule import around

LAST = 60
REGIONS = Regions({"x": (-1.0, 1.0)}, {}, np.zeros((1, 1)))


def _trace(**visits: tuple[int, int]) -> NDArray[np.float64]:
    """x is 0, but 1 in the steps `a` (both ends included), and -1 in the steps `b`."""
    trace = np.zeros((LAST + 1, 1))
    for name, (begin, end) in visits.items():
        trace[begin : end + 1] = 1.0 if name[0] == "a" else -1.0
    return trace


def _parsed(formula: str) -> stl.Formula:
    return stl.parse(formula.replace("A", "x >= 0.5").replace("B", "x <= -0.5"))


def _margin(terms: Sequence[stl.Term], traces: NDArray[np.float64]) -> int:
    """The least number of steps by which the window of an event may end earlier, for one that is met last."""
    fewest = LAST
    for term in (term for term in terms if term.kind != "G"):
        last = term.end - term.length + 1
        for row in stl.holds(term.psi, ("x",))(traces):
            met = next(t for t in range(term.start, last + 1) if row[t : t + term.length].all())
            fewest = min(fewest, last - met)
    return fewest


CHAIN, PATROL = "F[0,30] (A & F[0,30] B)", "G[0,30] (F[0,30] A & F[0,30] B)"
RESPONSE = "F[0,30] A & G[0,30] (A -> F[0,20] B)"


@pytest.mark.parametrize(
    ("formula", "visits", "margin"),
    [
        (CHAIN, [{"a": (10, 10), "b": (30, 30)}], 10),  # B by 40, 30 steps after the window of A begins
        (
            CHAIN,
            [{"a": (10, 10), "b": (30, 30)}, {"a": (14, 14), "b": (24, 24)}],
            6,
        ),  # A by 20, as the first takes 20 steps to B
        (CHAIN, [{"a": (10, 16), "b": (30, 30)}], 14),  # A may be met as late as at 16, and then B by 46
        (RESPONSE, [{"a": (12, 15), "b": (25, 25)}], 7),  # B by 32, 20 steps after the first A
        (PATROL, [{"a": (10, 10), "b": (30, 30), "a2": (40, 40)}], 0),  # B at 30 serves 0..30
        ("F[0,30] G[0,4] A", [{"a": (10, 16)}], 20),  # its window ends at 30
        ("F[0,20] A | F[0,20] B", [{"b": (5, 5)}], 15),
    ],
)
def test_windows_leave_time(formula: str, visits: list[dict[str, tuple[int, int]]], margin: int) -> None:
    traces = np.array([_trace(**each) for each in visits])
    assert stl.satisfied(_parsed(formula), traces, ["x"]).all()
    found = around(_parsed(formula), REGIONS, 1, LAST, traces)
    assert found is not None
    assert stl.satisfied(found.formula, traces, ["x"]).all()
    assert _margin(found.terms, traces) >= margin


def test_a_witness_that_goes_another_way_than_those_before_it_is_left_out() -> None:
    formula, either = _parsed("F[0,20] A | F[0,20] B"), np.array([_trace(a=(5, 5)), _trace(b=(5, 5)), _trace(a=(8, 8))])
    found = around(formula, REGIONS, 1, LAST, either)
    assert found is not None
    assert found == around(formula, REGIONS, 1, LAST, either[[0, 2]])
    assert around(formula, REGIONS, 1, LAST, either[:0]) is None


def test_an_alternative_that_every_trace_satisfies_gives_no_windows() -> None:
    """Nothing is before the first sample, so H[2,4] holds there."""
    trace = np.array([_trace(a=(5, 5))])
    assert around(_parsed("H[2,4] A"), REGIONS, 1, LAST, trace) is None
    either = around(_parsed("F[0,20] A | H[2,4] B"), REGIONS, 1, LAST, trace)
    assert either == around(_parsed("F[0,20] A"), REGIONS, 1, LAST, trace)
    assert either is not None


@pytest.mark.parametrize("formula", [CHAIN, PATROL, RESPONSE, "(!B) U[10,30] A", "G[0,20] (A -> F[0,9] G[0,3] B)"])
def test_they_imply_the_formula(formula: str) -> None:
    """On walks between A and B: the schedule around each one that satisfies holds for it, and implies the formula."""
    generator = np.random.default_rng(0)
    steps = generator.choice([-1.0, 0.0, 1.0], size=(3000, LAST // 6 + 1, 1), p=[0.3, 0.4, 0.3])
    walks = np.repeat(steps, 6, axis=1)[:, : LAST + 1]
    satisfied = stl.satisfied(_parsed(formula), walks, ["x"])
    tried, implied = 0, 0
    for walk in walks[satisfied][:12]:
        found = around(_parsed(formula), REGIONS, 1, LAST, walk[None])
        if found is None:
            continue
        tried += 1
        scheduled = stl.satisfied(found.formula, walks, ["x"])
        assert stl.satisfied(found.formula, walk[None], ["x"]).all()
        assert satisfied[scheduled].all()
        implied += int(scheduled.sum())
    assert tried >= 6
    assert implied > tried
