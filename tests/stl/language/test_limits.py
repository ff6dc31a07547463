"""Long, deep and large formulas: thousands of conjuncts work everywhere, and what is too much is refused."""

from __future__ import annotations

import time
from contextlib import suppress
from functools import reduce
from typing import Any

import numpy as np
import pytest

from stlbench.stl import (
    And,
    BatchMonitor,
    Formula,
    FormulaLimitError,
    FragmentError,
    Monitor,
    Not,
    Or,
    StlSyntaxError,
    UnknownSignalError,
    fragment,
    holds,
    holds_trace,
    horizon,
    iff,
    is_temporal,
    margin,
    margin_trace,
    parse,
    robustness,
    robustness_bounds,
    robustness_trace,
    satisfaction_bounds,
    satisfied,
    signals,
)
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


@pytest.mark.parametrize("text", LARGE.values(), ids=LARGE)
def test_what_is_accepted_works_everywhere(text: str) -> None:
    formula = parse(text)
    assert parse(str(formula)) == formula
    assert signals(formula) == ("x",)
    value, verdict = robustness(formula, TRACE, ["x"]).item(), satisfied(formula, TRACE, ["x"]).item()
    assert verdict == (value >= 0)
    assert robustness_trace(formula, TRACE, ["x"])[0] == value
    assert robustness_bounds(formula, TRACE, ["x"]) == (value, value)
    assert satisfaction_bounds(formula, TRACE, ["x"]) == (verdict, verdict)
    monitor, batch = Monitor(formula, ["x"]), BatchMonitor(formula, ["x"], 2)
    for sample in TRACE:
        now, both = monitor.update(sample), batch.update([sample, sample])
    assert (now.lower, now.upper, now.verdict) == (value, value, verdict)
    assert (both.lower.tolist(), both.certainly.tolist()) == ([value] * 2, [verdict] * 2)
    traces = np.array([TRACE])[:, : horizon(formula) + 1]
    assert margin_trace(formula, ["x"])(traces).tolist() == [[value]]
    assert holds_trace(formula, ["x"])(traces).tolist() == [[verdict]]
    with suppress(FragmentError):
        assert len(fragment(formula)) >= 1
    if not is_temporal(formula):
        assert margin(formula, ["x"])(np.array(TRACE[0])) == value
        assert holds(formula, ["x"])(np.array(TRACE[0])) == verdict


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
    with pytest.raises(StlSyntaxError, match=f"at most {MAX_DEPTH} levels of nesting|at most 100,000 parts") as caught:
        parse(text)
    assert max(map(len, str(caught.value).splitlines())) < 140


def test_short_text_that_means_much_is_a_syntax_error() -> None:
    text = "(x >= 0 <-> " * 20 + "x >= 0" + ")" * 20
    with pytest.raises(StlSyntaxError, match=r"at most 100,000 parts \('<->', 'xor' and 'W' repeat their operands\)"):
        parse(text)


def test_formulas_built_by_hand_have_the_same_limits() -> None:
    p: Formula = parse("x >= 0")
    with pytest.raises(FormulaLimitError, match="a formula has at most 120 levels of nesting, got more"):
        reduce(lambda inner, _: Not(inner), range(5000), p)
    with pytest.raises(FormulaLimitError, match="at most 100,000 parts"):
        reduce(lambda inner, _: iff(inner, inner), range(50), p)
    half = And((p,) * (MAX_SIZE // 6))
    with pytest.raises(FormulaLimitError):
        Or((half, Not(half), half))


def test_the_limit_on_length_comes_before_all_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stlbench.stl.language.tokens._token", None)  # not even one token is read
    for text in ("x >= 0 & " * 1_200_000, "x" * 10_000_000, "\n" * 10_000_000):
        begin = time.process_time()
        with pytest.raises(StlSyntaxError, match=r"at most 200,000 characters\) but found 10,\d00,000") as caught:
            parse(text)
        assert len(str(caught.value)) < 400
        assert time.process_time() - begin < 60


@pytest.mark.slow
def test_the_longest_text() -> None:
    text = "x >= 0 & " * (MAX_LENGTH // 9 - 1) + "x >= 0"
    assert len(signals(parse(text))) == 1
    parse(text + " " * (MAX_LENGTH - len(text)))
    with pytest.raises(StlSyntaxError) as caught:
        parse(text + " " * (MAX_LENGTH + 1 - len(text)))
    assert (caught.value.line, caught.value.column) == (1, MAX_LENGTH + 1)


LONG = "x" * 50_000


@pytest.mark.parametrize(
    "call",
    [
        lambda: parse(f"{LONG} {LONG} >= 0"),
        lambda: parse(f"x >= 0 & {LONG}(x) >= 0"),
        lambda: parse(f"G[0,1.{'5' * 50_000}] x >= 0"),
        lambda: parse(f"x >= 0 & ({LONG} >= 0"),
        lambda: fragment(parse(f"{LONG} >= 0 & True")),
        lambda: robustness(parse(f"{LONG} >= 0"), TRACE, ["x"]),
        lambda: robustness(parse("y >= 0"), np.zeros((1, 5000)), [f"x{i}" for i in range(5000)]),
        lambda: robustness(parse(f"sqrt({LONG} - 1) >= 0"), [[0.0]], [LONG]),
        lambda: Monitor(parse(f"sqrt({LONG} - 1) >= 0"), [LONG]).update([0.0]),
        lambda: BatchMonitor(parse(f"sqrt({LONG} - 1) >= 0"), [LONG], 1).update([[0.0]]),
        lambda: robustness(f"{LONG} >= 0", TRACE, ["x"]),  # type: ignore[arg-type]
        lambda: parse(b"x" * 50_000),  # type: ignore[arg-type]
        lambda: margin(parse(f"G[0,1] {LONG} >= 0"), [LONG]),
        lambda: Not(LONG),  # type: ignore[arg-type]
    ],
)
def test_messages_quote_a_line_at_most(call: Any) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    assert max(map(len, str(caught.value).splitlines())) < 500
    assert isinstance(caught.value, StlSyntaxError | FragmentError | UnknownSignalError | ValueError | TypeError)
