"""Long, deep and large formulas: thousands of conjuncts work everywhere, and what is too much is refused."""

from __future__ import annotations

import time
from contextlib import suppress
from functools import reduce
from typing import Any

import numpy as np
import pytest

from stlbench import stl
from stlbench.stl.language.expressions import MAX_DEPTH, MAX_SIZE
from stlbench.stl.language.tokens import MAX_LENGTH

TRACE = [[0.5], [2.0], [-1.0]]
MANY = 1200
DEEP = MAX_DEPTH - 2
LARGE = {
    "conjuncts": " & ".join(["x >= -3", *["G[0,1] x >= 0"] * MANY]),
    "disjuncts": " | ".join(["x >= -3", *["F[0,1] x >= 0"] * MANY]),
    "pointwise conjuncts": " & ".join(f"x >= -{i}" for i in range(MANY)),
    "pointwise disjuncts": "G[0,1] (" + " | ".join(f"x <= -{i}" for i in range(MANY)) + ")",
    "negations": "!" * DEEP + "x >= 0",
    "negations of G": "!" * (DEEP - 1) + "G[0,1] x >= 0",
    "implications": " -> ".join(["x >= 0"] * DEEP),
    "nested G": "G[0,0] " * DEEP + "x >= 0",
    "alternating": "G[0,0] (x >= 0 | " * (DEEP // 4) + "x >= 0" + ")" * (DEEP // 4),
    "parentheses": "(" * (DEEP - 1) + "x >= 0" + ")" * (DEEP - 1),
    "a sum": " + ".join(["x"] * (MAX_DEPTH - 2)) + " >= 0",
    "calls": "abs(" * (DEEP - 1) + "x" + ")" * (DEEP - 1) + " >= 1",
}
#: what takes seconds, and as long as its dual, which a change is tried on
DUALS = ("disjuncts", "pointwise conjuncts")


@pytest.mark.parametrize(
    "text",
    [pytest.param(text, id=name, marks=pytest.mark.slow if name in DUALS else []) for name, text in LARGE.items()],
)
def test_what_is_accepted_works_everywhere(text: str) -> None:
    formula = stl.parse(text)
    assert stl.parse(str(formula)) == formula
    assert stl.signals(formula) == ("x",)
    value, verdict = stl.robustness(formula, TRACE, ["x"]).item(), stl.satisfied(formula, TRACE, ["x"]).item()
    assert verdict == (value >= 0)
    assert stl.robustness_trace(formula, TRACE, ["x"])[0] == value
    assert stl.robustness_bounds(formula, TRACE, ["x"]) == (value, value)
    assert stl.satisfaction_bounds(formula, TRACE, ["x"]) == (verdict, verdict)
    monitor, batch = stl.Monitor(formula, ["x"]), stl.BatchMonitor(formula, ["x"], 2)
    for sample in TRACE:
        now, both = monitor.update(sample), batch.update([sample, sample])
    assert (now.lower, now.upper, now.verdict) == (value, value, verdict)
    assert (both.lower.tolist(), both.certainly.tolist()) == ([value] * 2, [verdict] * 2)
    traces = np.array([TRACE])[:, : stl.horizon(formula) + 1]
    assert stl.margin_trace(formula, ["x"])(traces).tolist() == [[value]]
    assert stl.holds_trace(formula, ["x"])(traces).tolist() == [[verdict]]
    with suppress(stl.FragmentError):
        assert len(stl.fragment(formula)) >= 1
    if not stl.is_temporal(formula):
        assert stl.margin(formula, ["x"])(np.array(TRACE[0])) == value
        assert stl.holds(formula, ["x"])(np.array(TRACE[0])) == verdict


@pytest.mark.parametrize(
    "text",
    [
        "(" * 5000 + "x >= 1" + ")" * 5000,
        "!" * 5000 + "x >= 1",
        "-" * 5000 + "x >= 1",
        "G[0,1] " * 5000 + "x >= 1",
        "G " * 5000 + "x >= 1",
        " -> ".join(["x >= 1"] * 5000),
        " <-> ".join(["x >= 1"] * 5000),
        " xor ".join(["x >= 1"] * 5000),
        " U ".join(["x >= 1"] * 5000),
        " + ".join(["x"] * 5000) + " >= 1",
        "abs(" * 5000 + "x" + ")" * 5000 + ">= 1",
    ],
)
def test_deep_nesting_is_a_syntax_error(text: str) -> None:
    said = f"at most {MAX_DEPTH} levels of nesting|at most 100,000 parts"
    with pytest.raises(stl.StlSyntaxError, match=said) as caught:
        stl.parse(text)
    assert max(map(len, str(caught.value).splitlines())) < 140


def test_short_text_that_means_much_is_a_syntax_error() -> None:
    text = "(x >= 0 <-> " * 20 + "x >= 0" + ")" * 20
    with pytest.raises(stl.StlSyntaxError, match=r"at most 100,000 parts \('<->', 'xor' and 'W' repeat their op"):
        stl.parse(text)


def test_formulas_built_by_hand_have_the_same_limits() -> None:
    p: stl.Formula = stl.parse("x >= 0")
    with pytest.raises(stl.FormulaLimitError, match="a formula has at most 120 levels of nesting, got more"):
        reduce(lambda inner, _: stl.Not(inner), range(5000), p)
    with pytest.raises(stl.FormulaLimitError, match="at most 100,000 parts"):
        reduce(lambda inner, _: stl.iff(inner, inner), range(50), p)
    half = stl.And((p,) * (MAX_SIZE // 6))
    with pytest.raises(stl.FormulaLimitError):
        stl.Or((half, stl.Not(half), half))


def test_the_limit_on_length_comes_before_all_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stlbench.stl.language.tokens._token", None)  # not even one token is read
    for text in ("x >= 0 & " * 1_200_000, "x" * 10_000_000, "\n" * 10_000_000):
        begin = time.process_time()
        with pytest.raises(stl.StlSyntaxError, match=r"at most 200,000 characters\) but found 10,\d00,000") as caught:
            stl.parse(text)
        assert len(str(caught.value)) < 400
        assert time.process_time() - begin < 60


@pytest.mark.slow
def test_the_longest_text() -> None:
    text = "x >= 0 & " * (MAX_LENGTH // 9 - 1) + "x >= 0"
    assert len(stl.signals(stl.parse(text))) == 1
    stl.parse(text + " " * (MAX_LENGTH - len(text)))
    with pytest.raises(stl.StlSyntaxError) as caught:
        stl.parse(text + " " * (MAX_LENGTH + 1 - len(text)))
    assert (caught.value.line, caught.value.column) == (1, MAX_LENGTH + 1)


LONG = "x" * 50_000


@pytest.mark.parametrize(
    "call",
    [
        lambda: stl.parse(f"{LONG} {LONG} >= 0"),
        lambda: stl.parse(f"x >= 0 & {LONG}(x) >= 0"),
        lambda: stl.parse(f"G[0,1.{'5' * 50_000}] x >= 0"),
        lambda: stl.parse(f"x >= 0 & ({LONG} >= 0"),
        lambda: stl.fragment(stl.parse(f"{LONG} >= 0 & True")),
        lambda: stl.robustness(stl.parse(f"{LONG} >= 0"), TRACE, ["x"]),
        lambda: stl.robustness(stl.parse("y >= 0"), np.zeros((1, 5000)), [f"x{i}" for i in range(5000)]),
        lambda: stl.robustness(stl.parse(f"sqrt({LONG} - 1) >= 0"), [[0.0]], [LONG]),
        lambda: stl.Monitor(stl.parse(f"sqrt({LONG} - 1) >= 0"), [LONG]).update([0.0]),
        lambda: stl.BatchMonitor(stl.parse(f"sqrt({LONG} - 1) >= 0"), [LONG], 1).update([[0.0]]),
        lambda: stl.robustness(f"{LONG} >= 0", TRACE, ["x"]),  # type: ignore[arg-type]
        lambda: stl.parse(b"x" * 50_000),  # type: ignore[arg-type]
        lambda: stl.margin(stl.parse(f"G[0,1] {LONG} >= 0"), [LONG]),
        lambda: stl.Not(LONG),  # type: ignore[arg-type]
    ],
)
def test_messages_quote_a_line_at_most(call: Any) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    assert max(map(len, str(caught.value).splitlines())) < 500
