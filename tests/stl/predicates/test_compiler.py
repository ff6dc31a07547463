"""Formulas compiled by way of Python source: equal to the definition to the bit, and safe whatever the names."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from helpers import plain_predicates
from helpers.generated_formulas import COMPARISONS, NAMES, NUMBERS, SIGNALS, pointwise
from hypothesis import given
from hypothesis import strategies as st

from stlbench.stl import (
    And,
    BatchMonitor,
    Binary,
    Call,
    Expression,
    Formula,
    Monitor,
    Negative,
    Not,
    Number,
    Predicate,
    Signal,
    UndefinedError,
    bounds,
    holds,
    margin,
    parse,
    robustness,
    satisfied,
)
from stlbench.stl.predicates import compile_arrays, compile_sample
from stlbench.stl.predicates.dialect import ARRAYS, FLOATS, Dialect
from stlbench.stl.predicates.writer import FormulaWriter, Reading


def _grow(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
    several = st.lists(inner, min_size=1, max_size=6).map(tuple)
    return st.one_of(
        st.builds(Negative, inner),
        st.builds(Binary, st.sampled_from("+-*/"), inner, inner),
        st.builds(Binary, st.just("**"), inner, st.just(Number(2))),
        st.builds(Call, st.sampled_from(["min", "max", "norm", "norminf"]), several),
        st.builds(Call, st.sampled_from(["abs", "sqrt"]), inner.map(lambda arg: (arg,))),
    )


#: of operations that IEEE 754 rounds in one way, so that floats and arrays are equal to the bit
EXACT = st.recursive(st.one_of(SIGNALS, SIGNALS, NUMBERS), _grow, max_leaves=6)
FORMULAS = pointwise(st.builds(Predicate, COMPARISONS, EXACT, EXACT))
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


def of_sample(psi: Formula, sample: Sequence[float], negated: bool = False) -> float:
    """The compiled function of floats, NaN for an error."""
    try:
        return compile_sample(psi, NAMES, negated)(sample)
    except UndefinedError:
        return math.nan


@given(FORMULAS, st.lists(SAMPLES, min_size=1, max_size=8), st.booleans())
def test_floats_and_arrays_are_the_definition_to_the_bit(
    psi: Formula, samples: list[tuple[float, float, float]], negated: bool
) -> None:
    asked = Not(psi) if negated else psi
    try:
        signed, margins = compile_arrays(asked, NAMES, "signed"), compile_arrays(asked, NAMES, "margin")
    except UndefinedError as error:  # a constant without a value
        with pytest.raises(UndefinedError, match=re.escape(str(error))):
            compile_sample(psi, NAMES, negated)
        return
    rows = np.array(samples)
    with np.errstate(all="ignore"):
        batch = signed(rows) if callable(signed) else np.full(len(rows), signed)
        plain = margins(rows) if callable(margins) else np.full(len(rows), margins)
        verdicts = holds(asked, NAMES)(rows)
    for i, sample in enumerate(samples):
        named = dict(zip(NAMES, sample, strict=True))
        expected = plain_predicates.signed(asked, named)
        assert same(of_sample(psi, sample, negated), expected)
        assert same(batch[i], expected)
        assert same(plain[i], plain_predicates.margin(asked, named))
        assert verdicts[i] == plain_predicates.satisfied(asked, named)
        if not math.isnan(expected):
            assert verdicts[i] == (expected > 0)


@pytest.mark.parametrize("text", ["exp(x)", "log(x)", "sin(x)", "cos(x)", "tan(x)", "tanh(x)", "atan2(x, y)", "x ** 3"])
@given(st.lists(st.tuples(VALUES, VALUES), min_size=1, max_size=8))
def test_the_other_functions_agree_within_rounding(text: str, samples: list[tuple[float, float]]) -> None:
    psi = parse(f"{text} >= 0")
    with np.errstate(all="ignore"):
        batch = compile_arrays(psi, ("x", "y"), "signed")(np.array(samples))  # type: ignore[operator]
    for sample, expected in zip(samples, batch.tolist(), strict=True):
        try:
            actual = compile_sample(psi, ("x", "y"))(sample)
        except UndefinedError:
            actual = math.nan
        if math.isfinite(expected):
            assert abs(actual - expected) <= 4 * math.ulp(expected)
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
    psi = parse(text)
    with np.errstate(all="ignore"):
        assert math.isnan(margin(psi, ["x"])(np.array([x])))
        assert np.isnan(margin(psi, ["x"])(np.array([[x], [2.0]]))).tolist() == [True, False]
    for evaluate in (
        lambda: robustness(psi, [[x]], ["x"]),
        lambda: satisfied(psi, [[x]], ["x"]),
        lambda: Monitor(psi, ["x"]).update([x]),
        lambda: BatchMonitor(psi, ["x"], 2).update([[2.0], [x]]),
        lambda: compile_sample(psi, ("x",))((x,)),
    ):
        with pytest.raises(UndefinedError):
            evaluate()


@pytest.mark.parametrize("text", ["1 / 0 >= x", "x / 0 >= 1", "x >= 0 | 0 / 0 >= 1", "log(0) <= x", "sqrt(-1) >= x"])
def test_a_constant_without_a_value_is_the_same_error_before_any_sample(text: str) -> None:
    psi = parse(text)
    for compile_ in (
        lambda: margin(psi, ["x"]),
        lambda: holds(psi, ["x"]),
        lambda: compile_sample(psi, ("x",)),
        lambda: Monitor(psi, ["x"]),
        lambda: robustness(psi, [[1.0]], ["x"]),
        lambda: bounds(psi, {"x": (1, 2)}),
    ):
        with pytest.raises(UndefinedError, match="a constant of the formula has no value"):
            compile_()


def test_what_overflows_is_infinite_in_constants_and_signals() -> None:
    for text in ("exp(1000) >= x", "10000000000 ** 40 >= x", "exp(100 * x) >= 0", "(x * 10000000000) ** 31 >= 0"):
        psi = parse(text)
        with np.errstate(over="ignore"):
            assert compile_sample(psi, ("x",))((10.0,)) == margin(psi, ["x"])(np.array([10.0])) == math.inf


def test_atan2_does_not_look_at_the_sign_of_zero() -> None:
    psi = parse("atan2(y, x) >= 0")
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


def statements(psi: Formula, names: Sequence[str], reading: str) -> str:
    """The source of the function's body."""
    dialect, asked = READINGS[reading]
    body = FormulaWriter({name: i for i, name in enumerate(names)}, dialect, asked).statements(psi, False)
    assert isinstance(body, list)
    return "\n".join(body)


HOSTILE = ["__import__", "sample", "x0", "t0", "nan", "quotient", "lambda", "exec", "µ", "ndarray", "in_arrays"]


def written_by_hand(name: str) -> Signal:
    """A signal of any name at all: the checks of names are gone around."""
    signal = Signal("harmless")
    object.__setattr__(signal, "name", name)
    return signal


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("name", [*HOSTILE, "0]; __import__('os').abort() #", "x\n import os", "'''", "{0}", "\\"])
def test_no_name_reaches_the_source(name: str, reading: str) -> None:
    def formula(signal: Expression) -> Formula:
        ratio = Binary("/", Call("min", (signal, Signal("b"))), Call("norm", (signal, Number(2))))
        return And((Predicate("<", ratio, Call("sin", (signal,))), Predicate(">=", Signal("b"), Number(1))))

    hostile = statements(formula(written_by_hand(name)), ["b", name], reading)
    assert hostile == statements(formula(Signal("a")), ["b", "a"], reading)


@pytest.mark.parametrize("reading", READINGS)
@given(FORMULAS)
def test_every_word_of_the_source_is_one_of_ours(reading: str, psi: Formula) -> None:
    words = "sample not or if else is return True False"
    ours = {*READINGS[reading][0].namespace, *words.split()}
    try:
        source = statements(psi, NAMES, reading)
    except (UndefinedError, AssertionError):  # constants
        return
    source = re.sub(r"\b\d+\.\d+(e[+-]?\d+)?\b|\b\d+e[+-]?\d+\b", "", source)  # reprs of floats
    for word in re.findall(r"[^\W\d]\w*", source):
        assert word in ours or re.fullmatch(r"[xt]\d+", word), word


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_are_signals_like_others(name: str) -> None:
    psi = parse("a / 2 >= b & norm(a, b) <= 5")
    renamed = And(
        (
            Predicate(">=", Binary("/", Signal(name), Number(2)), Signal("b")),
            Predicate("<=", Call("norm", (Signal(name), Signal("b"))), Number(5)),
        )
    )
    sample = (3.0, 1.0)
    assert compile_sample(renamed, (name, "b"))(sample) == compile_sample(psi, ("a", "b"))(sample) == 0.5
    assert margin(renamed, (name, "b"))(np.array(sample)) == 0.5


def test_a_thousand_conjuncts() -> None:
    psi = parse(" & ".join(f"abs(x - {i}) + y >= {i % 7}" for i in range(1000)))
    sample = {"x": 0.25, "y": 6.5}
    expected = plain_predicates.signed(psi, sample)
    assert compile_sample(psi, ("x", "y"))((0.25, 6.5)) == expected
    assert margin(psi, ["x", "y"])(np.array([[0.25, 6.5]])).tolist() == [expected]
    assert holds(psi, ["x", "y"])(np.array([0.25, 6.5]))


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
    psi = parse(text)
    expected = plain_predicates.signed(psi, {"x": 0.75})
    assert compile_sample(psi, ("x",))((0.75,)) == expected
    assert margin(psi, ["x"])(np.array([[0.75]])).tolist() == [expected]


def test_few_arrays_are_alive_however_long_the_formula() -> None:
    psi = parse(" & ".join(f"norm(x - {i}, y) <= {i}" for i in range(1, 200)))
    source = statements(psi, ["x", "y"], "margin")
    assert len(set(re.findall(r"\bt\d+\b", source))) <= 4


# --- what is no formula, and what is no sample


@pytest.mark.parametrize("compile_", [margin, holds])
@pytest.mark.parametrize("psi", ["x >= 0", b"x >= 0", None, Signal("x")])
def test_text_is_no_formula(compile_: Any, psi: Any) -> None:
    with pytest.raises(TypeError, match="expected a formula, got"):
        compile_(psi, ["x"])


@pytest.mark.parametrize("text", ["x >= 0", "1 <= 2"])
def test_samples_without_a_mask(text: str) -> None:
    h = margin(parse(text), ["x"])
    with pytest.raises(TypeError, match="masked array"):
        h(np.ma.masked_array([[1.0], [2.0]], mask=[[False], [True]]))  # type: ignore[no-untyped-call]
    assert h([[1.0], [2.0]]).shape == (2,)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="names is a sequence"):
        margin(parse(text), "x")
