"""The function that a formula's monitor is: its words, its size, and that it is the batch monitor to the bit."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, formulas, intervals, pointwise
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench.stl.predicates.writer import FLOATS
from stlbench.stl.running import monitor as monitor_source
from stlbench.stl.running.monitor import source
from stlbench.stl.running.nested import one
from stlbench.stl.running.tree import Tree, last_step

#: ties, zeros of both signs, and what is next to them and to infinity
VALUES = st.one_of(
    st.integers(-2, 6).map(lambda i: i / 2),
    st.sampled_from([0.0, -0.0, 5e-324, -1e-310, 1e308, -1.7e308, math.inf, -math.inf]),
)
TRACES = st.lists(st.tuples(VALUES, VALUES, VALUES), min_size=1, max_size=14)
PSI = pointwise(LIPSCHITZ)
OPERATORS = st.one_of(
    st.builds(lambda ab, psi: stl.Always(*ab, psi), intervals(8), PSI),
    st.builds(lambda ab, psi: stl.Eventually(*ab, psi), intervals(8), PSI),
    st.builds(lambda ac, de, psi: stl.Eventually(*ac, stl.Always(*de, psi)), intervals(6), intervals(4), PSI),
    st.builds(lambda ac, de, psi: stl.Always(*ac, stl.Eventually(*de, psi)), intervals(6), intervals(4), PSI),
    st.builds(lambda ab, left, right: stl.Until(*ab, left, right), intervals(8), PSI, PSI),
)
SEVERAL = st.lists(st.one_of(OPERATORS, OPERATORS.map(stl.Not)), min_size=2, max_size=4).map(tuple)
JOINED = st.one_of(
    OPERATORS, st.builds(stl.And, SEVERAL), st.builds(stl.Or, SEVERAL), SEVERAL.map(lambda some: stl.Not(stl.And(some)))
)


def written(formula: stl.Formula, names: tuple[str, ...] = NAMES) -> str:
    return "\n".join(source(Tree(formula, names, one()), last_step(formula), len(names)))


def check(formula: stl.Formula, trace: list[tuple[float, ...]]) -> None:
    """Both monitors say the same at every sample, or both refuse it."""
    monitor, batch = stl.Monitor(formula, NAMES), stl.BatchMonitor(formula, NAMES, 1)
    for sample in trace:
        try:
            known = batch.update([sample])
        except stl.UndefinedError as error:
            with pytest.raises(stl.UndefinedError, match=re.escape(str(error).partition(" of trace")[0])):
                monitor.update(sample)
            continue
        now = monitor.update(sample)
        assert now[:2] == (known.lower[0], known.upper[0])
        assert now.verdict is (True if known.certainly[0] else None if known.possibly[0] else False)


@given(JOINED, TRACES)
def test_equals_the_batch_monitor_to_the_bit(formula: stl.Formula, trace: list[tuple[float, ...]]) -> None:
    check(formula, trace)


@pytest.fixture
def joined_spans(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(monitor_source, "PIECES", 4)
    monitor_source.program.cache_clear()


@pytest.mark.usefixtures("joined_spans")
def test_so_it_does_where_spans_are_joined() -> None:
    @given(JOINED, TRACES)
    def run(formula: stl.Formula, trace: list[tuple[float, ...]]) -> None:
        check(formula, trace)

    run()
    monitor_source.program.cache_clear()


def many(count: int) -> stl.Formula:
    texts = (f"G[{i},{2 * i + 5}] x >= {i % 7} & F[{i},{i + 3}] G[0,{i}] y <= {i % 5}" for i in range(count))
    return stl.parse(" & ".join(texts))


def test_the_source_grows_with_the_operators_and_not_with_their_square() -> None:
    assert len(written(many(400))) < 3 * len(written(many(200)))


def test_conjuncts_of_one_interval_are_one_operator() -> None:
    def same(count: int) -> stl.Formula:
        each = "G[{0},9] x >= {1} & (F[1,4] x >= {1} | F[1,4] y >= {1} | z >= 1)"
        return stl.parse(" & ".join(each.format(i % 3, i) for i in range(count)))

    trace = [tuple(row) for row in (4 * np.random.default_rng(0).standard_normal((12, 3))).tolist()]
    check(same(30), trace)
    globally = stl.parse(" & ".join(f"G[{i % 3},9] x >= {i}" for i in range(2000)))
    assert len(written(globally)) <= len(written(stl.parse("G[0,9] x >= 0 & G[1,9] x >= 1 & G[2,9] x >= 2")))


def test_many_operators() -> None:
    formula = many(60)
    trace = 4 * np.random.default_rng(0).standard_normal((stl.horizon(formula) + 2, 3))
    check(formula, [tuple(row) for row in trace.tolist()])


@given(formulas(LIPSCHITZ, 3, 4, endless=True))
def test_every_word_of_the_source_is_one_of_ours(formula: stl.Formula) -> None:
    words = "def begin step m now sample if elif else not and or is while try except return True False None"
    state = "to_numpy steps answer changed lower upper verdict queue first clear pop popleft append appendleft values"
    numbered = "x|t|v|w|s|whole_v|whole_w|l|u|lower|upper|best|open|queue|due|guard|samples|state|begin|read|take"
    numbered += "|line|so_far"
    ours = {
        *FLOATS.namespace,
        *monitor_source._NAMES,
        *words.split(),
        *state.split(),
        "checked",
        "state",
        "item",
        "_fields",
    }
    text = re.sub(r"\b\d+\.\d+(e[+-]?\d+)?\b|\b\d+e[+-]?\d+\b", "", written(formula))  # reprs of floats
    for word in re.findall(r"[^\W\d]\w*", text):
        assert word in ours or re.fullmatch(rf"({numbered})\d+(_\d+)?", word), word


@pytest.mark.parametrize("name", ["__import__", "sample", "x0", "m", "now", "checked", "lambda", "µ"])
def test_hostile_names_are_signals_like_others(name: str) -> None:
    signal = stl.Signal("harmless")
    object.__setattr__(signal, "name", name)  # the checks of names are gone around
    until = stl.parse("b >= 0 U[0,2] b >= 1")
    formula = stl.And((stl.Always(0, 3, stl.Predicate(">=", signal, stl.Signal("b"))), until))
    plain = stl.And((stl.parse("G[0,3] a >= b"), until))
    assert written(formula, (name, "b")) == written(plain, ("a", "b"))


def test_what_is_not_read_may_be_anything_but_the_length_counts() -> None:
    monitor = stl.Monitor(stl.parse("G[1,2] x >= 0"), ["x", "y"])
    assert monitor.update((math.nan, "nothing is read at 0")).verdict is None  # type: ignore[arg-type]
    assert monitor.update((2.0, None)).upper == 2.0  # type: ignore[arg-type]
    for sample in ((1.0,), (1.0, 2.0, 3.0), 1.0):
        with pytest.raises(ValueError, match=r"shape \(2,\) for x, y"):
            monitor.update(sample)
    assert monitor.steps == 2
    assert monitor.update([1, 2]) == monitor.update("after the end") == (1.0, 1.0, True)  # type: ignore[arg-type]


def test_integers_are_counted_as_floats() -> None:
    huge = 2**53  # above it not all are floats, and those that are none are refused
    assert stl.Monitor(stl.parse("x - y >= 0"), ["x", "y"]).update((huge, huge - 1)).lower == 1.0
