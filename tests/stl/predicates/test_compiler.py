"""Formulas compiled by way of Python source: equal to the definition to the bit, and safe whatever the names."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
import pytest
from helpers import plain_predicates
from helpers.generated_formulas import COMPARISONS, NAMES, NUMBERS, SIGNALS, pointwise
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench.stl.language.structure import walk
from stlbench.stl.predicates import compile_arrays, compile_sample
from stlbench.stl.predicates.writer import ARRAYS, FLOATS, Dialect, FormulaWriter, Reading


def _grow(inner: st.SearchStrategy[stl.Expression]) -> st.SearchStrategy[stl.Expression]:
    several = st.lists(inner, min_size=1, max_size=6).map(tuple)
    return st.one_of(
        st.builds(stl.Negative, inner),
        st.builds(stl.Binary, st.sampled_from("+-*/"), inner, inner),
        st.builds(stl.Binary, st.just("**"), inner, st.just(stl.Number(2))),
        st.builds(stl.Call, st.sampled_from(["min", "max", "norm", "norminf"]), several),
        st.builds(stl.Call, st.sampled_from(["abs", "sqrt"]), inner.map(lambda arg: (arg,))),
    )


#: of operations that IEEE 754 rounds in one way, so that floats and arrays are equal to the bit
EXACT = st.recursive(st.one_of(SIGNALS, SIGNALS, NUMBERS), _grow, max_leaves=6)
FORMULAS = pointwise(st.builds(stl.Predicate, COMPARISONS, EXACT, EXACT))
#: many ties and zeros, and all that floats can be
VALUES = st.one_of(
    st.integers(-8, 8).map(lambda i: i / 4),
    st.sampled_from([0.0, -0.0, math.inf, -math.inf, math.nan, 5e-324, -1e-310, 1e200, -1e200, 1.7e308]),
    st.floats(),
)
SAMPLES = st.tuples(VALUES, VALUES, VALUES)


def same(actual: float, expected: float) -> bool:
    """To the bit, but for the sign of a zero and what NaN it is."""
    return actual == expected or (math.isnan(actual) and math.isnan(expected))


def of_sample(psi: stl.Formula, sample: Sequence[float], negated: bool = False) -> float:
    """The compiled function of floats, NaN for an error."""
    try:
        return compile_sample(psi, NAMES, negated)(sample)
    except stl.UndefinedError:
        return math.nan


def overflows(psi: stl.Formula, named: dict[str, float]) -> bool:
    """Whether a predicate is infinite though its signals are finite."""
    finite = [
        node
        for node in walk(psi)
        if isinstance(node, stl.Predicate) and all(math.isfinite(named[name]) for name in stl.signals(node))
    ]
    return any(math.isinf(plain_predicates.margin(node, named)) for node in finite)


@given(FORMULAS, st.lists(SAMPLES, min_size=1, max_size=8), st.booleans())
def test_floats_and_arrays_are_the_definition_to_the_bit(
    psi: stl.Formula, samples: list[tuple[float, float, float]], negated: bool
) -> None:
    asked = stl.Not(psi) if negated else psi
    try:
        signed, margins = compile_arrays(asked, NAMES, "signed"), compile_arrays(asked, NAMES, "margin")
    except stl.UndefinedError as error:  # a constant without a value
        with pytest.raises(stl.UndefinedError, match=re.escape(str(error))):
            compile_sample(psi, NAMES, negated)
        return
    rows = np.array(samples)
    with np.errstate(all="ignore"):
        batch = signed(rows) if callable(signed) else np.full(len(rows), signed)
        plain = margins(rows) if callable(margins) else np.full(len(rows), margins)
        verdicts = stl.holds(asked, NAMES)(rows)
    for i, sample in enumerate(samples):
        named = dict(zip(NAMES, sample, strict=True))
        expected = plain_predicates.signed(asked, named)
        assert same(of_sample(psi, sample, negated), math.nan if overflows(psi, named) else expected)
        assert same(batch[i], expected)
        assert same(plain[i], plain_predicates.margin(asked, named))
        assert verdicts[i] == plain_predicates.satisfied(asked, named)
        if not math.isnan(expected):
            assert verdicts[i] == (expected > 0)


@pytest.mark.parametrize("text", ["exp(x)", "log(x)", "sin(x)", "cos(x)", "tan(x)", "tanh(x)", "atan2(x, y)", "x ** 3"])
@given(st.lists(st.tuples(VALUES, VALUES), min_size=1, max_size=8))
def test_the_other_functions_agree_within_rounding(text: str, samples: list[tuple[float, float]]) -> None:
    psi = stl.parse(f"{text} >= 0")
    with np.errstate(all="ignore"):
        batch = compile_arrays(psi, ("x", "y"), "signed")(np.array(samples))  # type: ignore[operator]
    for sample, expected in zip(samples, batch.tolist(), strict=True):
        try:
            actual = compile_sample(psi, ("x", "y"))(sample)
        except stl.UndefinedError:
            actual = math.nan
        if math.isfinite(expected):
            assert abs(actual - expected) <= 4 * math.ulp(expected)
        elif math.isinf(expected) and math.isfinite(sample[0]):
            assert math.isnan(actual)
        else:
            assert same(actual, expected)


# --- where there is no value


@pytest.mark.parametrize(
    ("text", "x"),
    [
        ("1 / x >= 0", 0.0),
        ("1 / x >= 0", -0.0),
        ("x / x >= 0", 0.0),
        ("1 / (x * x - 1) <= 0 | True", 1.0),
        ("sqrt(x) >= 0", -1e-300),
        ("log(x) >= -9", 0.0),
        ("log(x) <= 0", -1.0),
        ("sin(x) >= 0", math.inf),
        ("x - x >= 0", math.inf),
        ("min(x, 1) >= 0", math.nan),
    ],
)
def test_one_rule_for_what_has_no_value(text: str, x: float) -> None:
    psi = stl.parse(text)
    with np.errstate(all="ignore"):
        assert math.isnan(stl.margin(psi, ["x"])(np.array([x])))
        assert np.isnan(stl.margin(psi, ["x"])(np.array([[x], [2.0]]))).tolist() == [True, False]
    for evaluate in (
        lambda: stl.robustness(psi, [[x]], ["x"]),
        lambda: stl.satisfied(psi, [[x]], ["x"]),
        lambda: stl.Monitor(psi, ["x"]).update([x]),
        lambda: stl.BatchMonitor(psi, ["x"], 2).update([[2.0], [x]]),
        lambda: compile_sample(psi, ("x",))((x,)),
    ):
        with pytest.raises(stl.UndefinedError):
            evaluate()


@pytest.mark.parametrize("text", ["1 / 0 >= x", "x / 0 >= 1", "x >= 0 | 0 / 0 >= 1", "log(0) <= x", "sqrt(-1) >= x"])
def test_a_constant_without_a_value_is_the_same_error_before_any_sample(text: str) -> None:
    psi = stl.parse(text)
    for compile_ in (
        lambda: stl.margin(psi, ["x"]),
        lambda: stl.holds(psi, ["x"]),
        lambda: compile_sample(psi, ("x",)),
        lambda: stl.Monitor(psi, ["x"]),
        lambda: stl.robustness(psi, [[1.0]], ["x"]),
        lambda: stl.bounds(psi, {"x": (1, 2)}),
    ):
        with pytest.raises(stl.UndefinedError, match="a constant of the formula has no value"):
            compile_()


def test_what_overflows_is_infinite_in_margins_and_refused_by_all_others() -> None:
    for text in ("exp(100 * x) >= 0", "(x * 10000000000) ** 31 >= 0"):
        psi = stl.parse(text)
        assert stl.margin(psi, ["x"])(np.array([10.0])) == math.inf
        with pytest.raises(stl.UndefinedError):
            compile_sample(psi, ("x",))((10.0,))


def test_atan2_does_not_look_at_the_sign_of_zero() -> None:
    psi = stl.parse("atan2(y, x) >= 0")
    for y in (0.0, -0.0):
        for x, expected in ((-1.0, math.pi), (1.0, 2.0**-1022), (0.0, 2.0**-1022), (-0.0, 2.0**-1022)):
            assert compile_sample(psi, ("x", "y"))((x, y)) == expected
            assert compile_arrays(psi, ("x", "y"), "signed")(np.array([x, y])) == expected  # type: ignore[operator]


# --- what is compiled


READINGS: dict[str, tuple[Dialect, Reading]] = {
    "floats": (FLOATS, "signed"),
    "margin": (ARRAYS, "margin"),
    "signed": (ARRAYS, "signed"),
    "holds": (ARRAYS, "holds"),
}


def statements(psi: stl.Formula, names: Sequence[str], reading: str) -> str:
    """The source of the function's body."""
    dialect, asked = READINGS[reading]
    body = FormulaWriter({name: i for i, name in enumerate(names)}, dialect, asked).statements(psi, False)
    assert isinstance(body, list)
    return "\n".join(body)


HOSTILE = ["__import__", "sample", "x0", "t0", "nan", "quotient", "lambda", "exec", "µ", "ndarray", "in_arrays"]


def written_by_hand(name: str) -> stl.Signal:
    """A signal of any name at all: the checks of names are gone around."""
    signal = stl.Signal("harmless")
    object.__setattr__(signal, "name", name)
    return signal


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("name", [*HOSTILE, "0]; __import__('os').abort() #", "x\n import os", "'''", "{0}", "\\"])
def test_no_name_reaches_the_source(name: str, reading: str) -> None:
    def formula(signal: stl.Expression) -> stl.Formula:
        ratio = stl.Binary("/", stl.Call("min", (signal, stl.Signal("b"))), stl.Call("norm", (signal, stl.Number(2))))
        return stl.And(
            (stl.Predicate("<", ratio, stl.Call("sin", (signal,))), stl.Predicate(">=", stl.Signal("b"), stl.Number(1)))
        )

    hostile = statements(formula(written_by_hand(name)), ["b", name], reading)
    assert hostile == statements(formula(stl.Signal("a")), ["b", "a"], reading)


@pytest.mark.parametrize("reading", READINGS)
@given(FORMULAS)
def test_every_word_of_the_source_is_one_of_ours(reading: str, psi: stl.Formula) -> None:
    words = "sample not or if else is in return True False dtype kind f as_floats"
    ours = {*READINGS[reading][0].namespace, *words.split()}
    try:
        source = statements(psi, NAMES, reading)
    except (stl.UndefinedError, AssertionError):  # constants
        return
    source = re.sub(r"\b\d+\.\d+(e[+-]?\d+)?\b|\b\d+e[+-]?\d+\b", "", source)  # reprs of floats
    for word in re.findall(r"[^\W\d]\w*", source):
        assert word in ours or re.fullmatch(r"[xt]\d+", word), word


def test_a_thousand_conjuncts() -> None:
    psi = stl.parse(" & ".join(f"abs(x - {i}) + y >= {i % 7}" for i in range(1000)))
    sample = {"x": 0.25, "y": 6.5}
    expected = plain_predicates.signed(psi, sample)
    assert compile_sample(psi, ("x", "y"))((0.25, 6.5)) == expected
    assert stl.margin(psi, ["x", "y"])(np.array([[0.25, 6.5]])).tolist() == [expected]
    assert stl.holds(psi, ["x", "y"])(np.array([0.25, 6.5]))


@pytest.mark.parametrize(
    "text",
    [
        "(" * 110 + "x" + ")" * 110 + " >= 0",
        "x" + " - 0.5 * x" * 110 + " >= 0",
        "-" * 110 + "x >= 0",
        "!" * 110 + "x >= 1",
        "min(" * 110 + "x" + ", 3)" * 110 + " >= 0",
        "1 / (1 + " * 38 + "x" + ")" * 38 + " >= 0",
        "(x >= 0 -> " * 50 + "x >= 1" + ")" * 50,
        "norm(" + ", ".join(["x"] * 5000) + ") <= 9",
        "max(" + ", ".join(["x", "1"] * 2000) + ") <= 9",
    ],
)
def test_deep_and_wide_formulas(text: str) -> None:
    psi = stl.parse(text)
    expected = plain_predicates.signed(psi, {"x": 0.75})
    assert compile_sample(psi, ("x",))((0.75,)) == expected
    assert stl.margin(psi, ["x"])(np.array([[0.75]])).tolist() == [expected]


def test_few_arrays_are_alive_however_long_the_formula() -> None:
    psi = stl.parse(" & ".join(f"norm(x - {i}, y) <= {i}" for i in range(1, 200)))
    source = statements(psi, ["x", "y"], "margin")
    assert len(set(re.findall(r"\bt\d+\b", source))) <= 4


# --- what is no formula, and what is no sample


@pytest.mark.parametrize("text", ["x >= 0", "1 <= 2"])
def test_samples_without_a_mask(text: str) -> None:
    h = stl.margin(stl.parse(text), ["x"])
    with pytest.raises(TypeError, match="masked array"):
        h(np.ma.masked_array([[1.0], [2.0]], mask=[[False], [True]]))  # type: ignore[no-untyped-call]
    assert h([[1.0], [2.0]]).shape == (2,)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="names is a sequence"):
        stl.margin(stl.parse(text), "x")
