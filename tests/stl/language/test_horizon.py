"""Operators without an interval: no horizon, and intervals once the end is known."""

from __future__ import annotations

import pytest
from helpers.generated_formulas import NAMES, SEEDS, formulas, told, traces
from hypothesis import assume, given

from stlbench.stl import END, Always, Formula, FragmentError, UnboundedError, fragment, horizon, parse, resolve_end
from stlbench.stl import robustness as rho
from stlbench.stl.language.structure import lookahead


@pytest.mark.parametrize(
    ("text", "resolved"),
    [
        ("G x >= 0", "G[0,9] x >= 0"),
        ("G F[0,5] x >= 0", "G[0,4] F[0,5] x >= 0"),
        ("x >= 0 & !F G[2,3] x >= 1", "x >= 0 & !F[0,6] G[2,3] x >= 1"),
        ("x >= 0 -> (x >= 0 U F[0,2] x >= 1)", "x >= 0 -> x >= 0 U[0,7] F[0,2] x >= 1"),
        ("x >= 0 W x >= 1", "x >= 0 U[0,9] x >= 1 | G[0,9] x >= 0"),
        ("x >= 0 R x >= 1 | F[0,3] x >= 0", "x >= 0 R[0,9] x >= 1 | F[0,3] x >= 0"),
        ("G[0,3] x >= 0", "G[0,3] x >= 0"),
        ("x >= 0 | True", "x >= 0 | True"),
    ],
)
def test_intervals_for_an_episode_of_9_steps(text: str, resolved: str) -> None:
    assert resolve_end(parse(text), 9) == parse(resolved)


@given(formulas(endless=True), SEEDS)
def test_resolved_formulas_say_the_same_of_such_traces(formula: Formula, seed: int) -> None:
    last = max(0, -told(formula, 0)) + 4
    try:
        resolved = resolve_end(formula, last)
    except UnboundedError:
        assume(False)
    trace = traces(last + 1, seed)
    assert horizon(resolved) <= last
    assert rho(resolved, trace, NAMES) == rho(formula, trace, NAMES)


@given(formulas(endless=True))
def test_lookahead_is_what_must_follow(formula: Formula) -> None:
    assert lookahead(formula) == -told(formula, 0)


def test_there_is_no_horizon_and_no_fragment() -> None:
    formula = parse("x >= 0 & G x >= 1")
    message = "G without an interval at column 10 reaches to the end of the trace and has no horizon"
    with pytest.raises(UnboundedError, match=message):
        horizon(formula)
    with pytest.raises(FragmentError, match="G without an interval at column 10 is not in the funnel fragment: its"):
        fragment(formula)
    with pytest.raises(UnboundedError, match=r"^G without an interval reaches"):
        horizon(Always(0, END, parse("x >= 0")))


def test_inside_a_temporal_operator_there_is_no_fixed_interval() -> None:
    for text in ("G F x >= 0", "F[0,3] G x >= 0", "x >= 0 U[0,3] F x >= 1"):
        with pytest.raises(UnboundedError, match="stands inside another temporal operator"):
            resolve_end(parse(text), 9)


def test_a_trace_that_ends_before_the_operand() -> None:
    assert resolve_end(parse("G F[0,9] x >= 0"), 9) == parse("G[0,0] F[0,9] x >= 0")
    with pytest.raises(ValueError, match="G without an interval needs 10 samples, the trace has 9"):
        resolve_end(parse("G F[0,9] x >= 0"), 8)


@pytest.mark.parametrize("ends", [(1, END), (0, 2**53 + 1), (0, END + 1)])
def test_ends_beyond_all_intervals_are_refused(ends: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="ends at step 9007199254740992 or before"):
        Always(*ends, parse("x >= 0"))
