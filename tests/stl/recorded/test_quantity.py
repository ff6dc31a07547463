"""Formulas under several semantics: `classic` is the robustness, signs are those of the verdict, limits, batches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, formulas, traces
from hypothesis import given

from stlbench import stl

NAMED = pytest.mark.parametrize("name", ["lse", "agm", "gmsr"])
plain = formulas(LIPSCHITZ, constants=False, past=False)
#: margins of these formulas on these traces are at most 6 in size
UNIT = 6.0


def values(formula: stl.Formula, samples: np.ndarray, name: str, sharpness: float = 10.0) -> np.ndarray:
    quantity = stl.Quantity(formula, NAMES, stl.semantics(name, sharpness))  # type: ignore[arg-type]
    return quantity.values(quantity.read(samples) / UNIT)


@given(formulas(LIPSCHITZ, past=False), SEEDS)
def test_classic_is_the_robustness(formula: stl.Formula, seed: int) -> None:
    samples = traces(stl.horizon(formula) + 3, seed, (3,))
    quantity = stl.Quantity(formula, NAMES, stl.semantics("classic"))
    leaves = quantity.read(samples)
    assert np.array_equal(quantity.values(leaves), stl.robustness_trace(formula, samples, NAMES))
    clipped = quantity.clipped(leaves, (-math.inf, math.inf))
    assert np.array_equal(clipped, stl.robustness_trace(formula, samples, NAMES, policy="clip"))


@pytest.mark.parametrize("name", ["agm", "gmsr"])
@given(formula=plain, seed=SEEDS)
def test_signs_are_sound(name: str, formula: stl.Formula, seed: int) -> None:
    samples = traces(stl.horizon(formula) + 1, seed, (4,))
    found = values(formula, samples, name)[:, 0]
    rho = stl.robustness(formula, samples, NAMES)
    assert (found * rho >= -1e-12).all()
    if name == "agm":
        assert np.array_equal(np.sign(found), np.sign(rho))


@given(formula=plain, seed=SEEDS)
def test_gilpins_value_is_never_above_the_robustness(formula: stl.Formula, seed: int) -> None:
    samples = traces(stl.horizon(formula) + 1, seed, (4,))
    rho = stl.robustness(formula, samples, NAMES)
    for sharpness in (1.0, 10.0):
        found = values(formula, samples, "gilpin", sharpness)[:, 0]
        assert (found <= rho / UNIT + 1e-12).all()
        assert stl.satisfied(formula, samples, NAMES)[found > 0].all()


@pytest.mark.parametrize("name", ["lse", "gilpin"])
@given(formula=plain, seed=SEEDS)
def test_the_robustness_is_the_limit(name: str, formula: stl.Formula, seed: int) -> None:
    """Each operator is within log(n) / b; there are at most 6 leaves, so few operators of at most 6 values each."""
    samples = traces(stl.horizon(formula) + 1, seed, (2,))
    rho = stl.robustness(formula, samples, NAMES) / UNIT
    for sharpness, near in ((20.0, 1.5), (500.0, 0.06)):
        assert values(formula, samples, name, sharpness)[:, 0] == pytest.approx(rho, abs=near)


@NAMED
@given(formula=plain, seed=SEEDS)
def test_the_opposite_has_the_opposite_value(name: str, formula: stl.Formula, seed: int) -> None:
    samples = traces(stl.horizon(formula) + 1, seed, (2,))
    assert values(stl.Not(formula), samples, name) == pytest.approx(-values(formula, samples, name), abs=1e-12)


@NAMED
@given(formula=plain, seed=SEEDS)
def test_a_batch_is_its_traces(name: str, formula: stl.Formula, seed: int) -> None:
    samples = traces(stl.horizon(formula) + 3, seed, (3,))
    one_by_one = np.concatenate([values(formula, trace[None], name) for trace in samples])
    assert values(formula, samples, name) == pytest.approx(one_by_one, abs=1e-12)


def test_nested_operators_by_hand() -> None:
    """F[0,1] G[0,1] x >= 0 of x = 1/8, 1, -1/2 (no unit): G is sqrt(9/8 * 2) - 1 = 1/2 and -1/4; F of the two 1/4.

    The or-like function of 1/2 and -1/4 is the mean of max(x, 0).
    """
    quantity = stl.Quantity(stl.parse("F[0,1] G[0,1] x >= 0"), ["x"], stl.semantics("agm"))
    found = quantity.values(quantity.read(np.array([[[0.125], [1.0], [-0.5]]])))
    assert found == pytest.approx(np.array([[0.25]]))


def test_leaves_are_predicates_or_whole_parts() -> None:
    formula = stl.parse("F[0,2] (x >= 1 & !(y <= 1)) & G[0,1] x >= 1")
    texts = {
        name: [str(leaf) for leaf in stl.Quantity(formula, ["x", "y"], stl.semantics(name)).leaves]  # type: ignore[arg-type]
        for name in ("classic", "agm")
    }
    assert texts == {"classic": ["x >= 1 & !y <= 1", "x >= 1"], "agm": ["x >= 1", "!y <= 1"]}


def test_a_trace_that_ends_leaves_windows_empty() -> None:
    """G[1,3] of two samples at step 1 has nothing to read: the second end."""
    quantity = stl.Quantity(stl.parse("G[1,3] x >= 0"), ["x"], stl.semantics("agm"))
    assert quantity.clipped(np.array([[[0.5], [0.25]]]), (-1.0, 1.0)) == pytest.approx(np.array([[0.25, 1.0]]))


@pytest.mark.parametrize("name", ["classic", "agm"])
def test_a_formula_without_end_is_refused(name: str) -> None:
    with pytest.raises(stl.UnboundedError, match="F without an interval at column 1"):
        stl.Quantity(stl.parse("F x >= 0"), ["x"], stl.semantics(name))  # type: ignore[arg-type]


def test_wrong_choices_are_told() -> None:
    with pytest.raises(ValueError, match="there are the semantics classic, lse, gilpin, agm, gmsr, not 'smooth'"):
        stl.semantics("smooth")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="number above 0, got 0"):
        stl.semantics("lse", 0.0)


@pytest.mark.parametrize("name", ["classic", "lse", "gilpin", "agm", "gmsr"])
@pytest.mark.parametrize("text", ["G[0,3] x > 0", "F[1,3] x > 0", "x > 0 U[1,3] x < 1"])
def test_a_trace_shorter_than_the_horizon_is_refused(name: str, text: str) -> None:
    quantity = stl.Quantity(stl.parse(text), ["x"], stl.semantics(name))  # type: ignore[arg-type]
    for count in range(4):
        with pytest.raises(stl.ShortTraceError, match=f"^needs 4 samples, got {count}$"):
            quantity.values(quantity.read(np.ones((2, count, 1))))
    assert quantity.values(quantity.read(np.ones((2, 4, 1)))).shape == (2, 1)


@pytest.mark.parametrize("name", ["classic", "lse", "gilpin", "agm", "gmsr"])
def test_a_huge_window_costs_no_memory(name: str) -> None:
    """10^12 steps of floats are no memory of today."""
    wide, narrow = (
        stl.Quantity(stl.parse(f"F[0,{end}] G[1,{end}] x > 0"), ["x"], stl.semantics(name))  # type: ignore[arg-type]
        for end in (10**12, 9)
    )
    leaves = np.array([[[0.5], [-0.25], [0.75]]])
    found = wide.clipped(leaves, (-1.0, 1.0))
    assert found == pytest.approx(narrow.clipped(leaves, (-1.0, 1.0)))
