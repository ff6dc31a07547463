"""What each method pays at least: over the box of the signals no reward is below `floor`, and some are there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from helpers.episodes import run, specification
from hypothesis import given
from hypothesis import strategies as st

from stlbench.contract import Array, RewardMethod, Specification
from stlbench_methods.flag import Flag
from stlbench_methods.funnel import Funnel
from stlbench_methods.raw import Raw
from stlbench_methods.tau_mdp import TauMdp

NEAR = 1e-5
"""`Specification.range` is within 1e-6 of the true extremes."""
BOX = {"x": (-2.0, 4.0), "y": (-1.0, 3.0)}


def resting(spec: Specification) -> Array:
    """Traces that rest in one corner of the box each, (corners, T + 1, k)."""
    corners = np.array(list(itertools.product(*zip(spec.low, spec.high, strict=True))))
    return np.repeat(corners[:, None], spec.steps + 1, axis=1)


def least(method: RewardMethod, traces: Array) -> float:
    rewards, _ = run(method, traces)
    return float(rewards[:, 1:].min())


bounds = st.integers(-8, 8).map(lambda quarter: quarter / 4)
predicates = st.builds("{} {} {}".format, st.sampled_from(["x", "y", "-x"]), st.sampled_from(["<=", ">="]), bounds)
intervals = st.tuples(st.integers(0, 6), st.integers(0, 4)).map(lambda ends: f"[{ends[0]},{sum(ends)}]")
terms = st.builds("{}{} ({})".format, st.sampled_from("FG"), intervals, predicates)
formulas = st.lists(terms, min_size=1, max_size=3).map(" & ".join)


@given(formula=formulas, activity=st.sampled_from(["last-deadline", "literal"]))
def test_that_of_raw_is_paid_in_a_corner(formula: str, activity: str) -> None:
    """One signal in each predicate: a corner of the box has the least robustness of each term, and rests there."""
    spec = specification(formula, BOX, steps=12)
    method = Raw(spec, activity=activity)  # type: ignore[arg-type]
    assert least(method, resting(spec)) == pytest.approx(method.floor, abs=NEAR)


def test_that_of_raw_by_hand() -> None:
    """x - 5 is -7 at x = -2. Where a term is active that is always satisfied, idle samples pay less: 0."""
    assert Raw(specification("F[2,5] x >= 5", BOX)).floor == pytest.approx(-7, abs=NEAR)
    always = specification("G[0,5] x >= -3", BOX, steps=8)
    assert Raw(always).floor == 0
    assert Raw(specification("G[0,5] x >= -3", BOX)).floor == pytest.approx(1, abs=NEAR)


@pytest.mark.parametrize("shape", ["linear", "clipped", "normalised"])
@pytest.mark.parametrize("formula", ["F[2,5] x >= 1 & G[6,9] y <= 2", "G[0,6] x <= 2", "F[0,3] G[1,4] y >= 0"])
def test_that_of_the_funnel_is_paid_in_a_corner(formula: str, shape: str) -> None:
    spec = specification(formula, BOX)
    method = Funnel(spec, shape=shape)  # type: ignore[arg-type]
    assert least(method, resting(spec)) == pytest.approx(method.floor, rel=1e-4)
    assert method.floor >= -method.scale - NEAR


def test_that_of_the_funnel_by_hand() -> None:
    """rho = 2 - x in [-2, 4], gamma = .01 throughout: -2 + .01 - 4, and as a logarithm -log(1 + 6 / .01)."""
    spec = specification("G[0,6] x <= 2", BOX)
    assert Funnel(spec).floor == pytest.approx(-5.99, abs=NEAR)
    assert Funnel(spec, shape="normalised").floor == pytest.approx(-math.log(601), abs=NEAR)


@pytest.mark.parametrize(
    ("formula", "steps", "expected"),
    [
        ("G[0,6] G[0,2] x <= 2", None, -1.0),
        ("F[0,6] G[0,2] x <= 2", None, math.exp(-2)),
        ("F[0,6] G[3,5] x <= 2", None, 0.0),  # nothing is paid before step 3
        ("F[1,6] x <= 2", None, math.exp(-2)),
        ("F[1,6] x <= 2", 7, 0.0),
        ("F[2,6] x <= 2 & G[3,6] y >= 0 & G[5,6] y >= 1", None, math.exp(-2) - 2),
    ],
)
def test_that_of_flag_by_hand(formula: str, steps: int | None, expected: float) -> None:
    spec = specification(formula, BOX, steps=steps)
    method = Flag(spec, beta=2)
    assert method.floor == pytest.approx(expected)
    assert least(method, np.concatenate([resting(spec), jumping(spec)])) == pytest.approx(expected)


def jumping(spec: Specification) -> Array:
    """Random traces in the box, (500, T + 1, k)."""
    generator = np.random.default_rng(0)
    return generator.uniform(spec.low, spec.high, (500, spec.steps + 1, len(spec.low)))


@pytest.mark.parametrize("make", [TauMdp, lambda spec: TauMdp(spec, form="probability", beta=2)])
@pytest.mark.parametrize(
    "formula", ["G[0,6] G[0,2] x <= 2", "F[0,6] G[0,2] x <= 2", "F[2,5] x >= 1 & G[6,9] y <= 2", "G[0,4] F[3,5] y >= 0"]
)
def test_that_of_tau_mdp_is_paid_in_a_corner(make: Callable[[Specification], TauMdp], formula: str) -> None:
    spec = specification(formula, BOX)
    method = make(spec)
    assert least(method, resting(spec)) == pytest.approx(method.floor, rel=1e-4)


@given(formula=formulas)
def test_none_is_paid_less(formula: str) -> None:
    spec = specification(formula, BOX, steps=12)
    for kind in (Raw, Flag):
        method = kind(spec)
        assert least(method, jumping(spec)) >= method.floor - 1e-9
