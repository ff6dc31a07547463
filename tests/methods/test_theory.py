"""Which rewards ask for the same, and which do not: the planner's policies on a lattice where every plan can be tried.

Where two rewards differ in what is best, the test has the two traces.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers import lattice
from helpers.episodes import run, specification
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench.contract import Array, Integers, Model, RewardMethod, Specification
from stlbench_methods.dense import Dense
from stlbench_methods.flag import Flag
from stlbench_methods.funnel import Funnel
from stlbench_methods.raw import Raw
from stlbench_methods.sparse import Sparse
from stlbench_methods.tltl import Tltl
from stlbench_planning import sums
from stlbench_planning.sums import Limits

STEPS = 6
Make = Callable[[Specification], RewardMethod]
FORMULAS = pytest.mark.parametrize(
    "formula",
    [
        "F[2,5] abs(x) <= 1",
        "G[1,5] abs(x - 1) <= 1",
        "F[1,4] G[0,1] abs(x) <= 1",
        "F[1,3] abs(x - 1) <= 1 & G[4,6] abs(x + 1) <= 1",
        "G[3,6] abs(x) <= 1 | F[1,2] x >= 2",
    ],
)
STARTS = np.array([[-2.0], [0.0], [1.0]])


def certain_at(start: Array, spec: Specification) -> float:
    """L_0, what is certain of the formula at the first sample, by hand: the least over all traces in the box."""
    method = Dense(spec, mode="difference")
    memory = method.initial_memory(start[None], np.zeros(1, dtype=np.int64))
    return float(method._progress.at_least(memory, np.zeros(1, dtype=np.int64))[0])


def planned(method: RewardMethod, reach: int, gamma: float = 1.0) -> tuple[Model, sums.SumPolicy]:
    model = lattice.model(method)
    return model, sums.plan(model, *lattice.whole(model, reach), gamma)


@FORMULAS
def test_difference_telescopes_to_tltl_less_a_constant_of_the_start(formula: str) -> None:
    spec = lattice.specification(formula, STEPS)
    model = lattice.model(Tltl(spec))
    for start in STARTS:
        plans = lattice.every_plan(model, start)
        rho = lattice.robustness(model, plans.samples)
        assert lattice.returns(model, plans, 1.0) == pytest.approx(rho)
        growth = lattice.returns(lattice.model(Dense(spec, mode="difference")), plans, 1.0)
        assert growth == pytest.approx(rho - certain_at(start, spec), abs=1e-9)


@pytest.mark.parametrize(
    "formula",
    [
        pytest.param("G[1,5] abs(x - 1) <= 1", marks=pytest.mark.slow),
        "F[1,3] abs(x - 1) <= 1 & G[4,6] abs(x + 1) <= 1",
    ],
)
def test_tltl_and_difference_have_the_best_robustness_for_their_optimum(formula: str) -> None:
    """They have few margins in -2..2, so the planner can enumerate the memories."""
    spec = lattice.specification(formula, STEPS)
    tltl, difference = (planned(method, 2) for method in (Tltl(spec), Dense(spec, mode="difference")))
    for start in STARTS:
        best = lattice.robustness(tltl[0], lattice.every_plan(tltl[0], start).samples).max()
        assert tltl[1].value(start[None]) == pytest.approx([best], abs=1e-4)
        assert difference[1].value(start[None]) == pytest.approx([best - certain_at(start, spec)], abs=1e-4)
        for model, policy in (tltl, difference):
            assert lattice.robustness(model, lattice.followed(model, policy, start[None]).samples) == best


def test_a_memory_that_is_rounded_to_the_values_it_has_is_planned_for_alike() -> None:
    """The running minimum of margins 1 - |x - 1| on the lattice is a whole number, so evenly spaced values have it."""
    method = Tltl(lattice.specification("G[1,5] abs(x - 1) <= 1", STEPS))
    model, exact = planned(method, 2)
    values = np.ptp(exact.memories.values) + 1
    limits = Limits(values=1, rounded=int(values))
    rounded = sums.plan(model, *lattice.whole(model, 2), 1.0, limits)
    assert rounded.memories.values.shape == (values, 1)
    assert rounded.value(STARTS) == pytest.approx(exact.value(STARTS))


@FORMULAS
def test_sparse_has_satisfaction_for_its_optimum(formula: str) -> None:
    spec = lattice.specification(formula, STEPS)
    model, policy = planned(Sparse(spec), 2)
    for start in STARTS:
        every = lattice.every_plan(model, start).samples.transpose(1, 0, 2)
        possible = bool(stl.satisfied(spec.formula, every, spec.signals).any())
        reached = lattice.followed(model, policy, start[None]).samples.transpose(1, 0, 2)
        assert stl.satisfied(spec.formula, reached, spec.signals).tolist() == [possible]
        assert policy.value(start[None]) == pytest.approx([float(possible)], abs=1e-5)


def followed(make: Make, formula: str, start: float, reach: int = lattice.REACH) -> tuple[list[float], float]:
    """The trace of the policy that is best by a method's reward, and its robustness."""
    model, policy = planned(make(lattice.specification(formula, STEPS)), reach)
    samples = lattice.followed(model, policy, np.array([[start]])).samples
    return samples[:, 0, 0].tolist(), float(lattice.robustness(model, samples)[0])


def test_level_may_ask_for_less_than_what_is_best() -> None:
    """F[1,6] psi, psi true by 1 at x = -1 and by 3 at x = 6: the running maximum is 1 six times, or -1 -1 0 1 2 3.

    The first sum is greater, so `level` turns left for good; `difference` and `tltl` go all the way.
    """
    formula = "F[1,6] (abs(x + 1) <= 1 | abs(x - 6) <= 3)"
    trace, rho = followed(Dense, formula, 0.0)
    assert (trace[1], rho) == (-1, 1)
    for make in (Tltl, lambda spec: Dense(spec, mode="difference")):
        trace, rho = followed(make, formula, 0.0)
        assert (trace, rho) == ([0, 1, 2, 3, 4, 5, 6], 3)


class TestFunnelAndRaw:
    def test_without_overlap_they_choose_the_same(self) -> None:
        """One is the other plus a function of time, so the values differ by its sum."""
        spec = lattice.specification("F[1,3] abs(x - 2) <= 1 & G[5,6] abs(x + 1) <= 1", STEPS)
        raw, funnel = planned(Raw(spec), lattice.REACH), planned(Funnel(spec), lattice.REACH)
        states, none = np.arange(-3.0, 4.0)[:, None], np.empty((7, 0))
        for t in range(STEPS):
            now = np.full(7, t)
            assert np.array_equal(raw[1].episode()(states, now, none), funnel[1].episode()(states, now, none))
        apart = funnel[1].value(states) - raw[1].value(states)
        assert np.ptp(apart) < 1e-3

    def test_where_terms_overlap_they_differ(self) -> None:
        """F[0,6] x >= 2 & G[0,6] x <= 1. raw has the minimum of both margins, best between the two: x = 1 or 2.

        The funnel of G is narrow from the start, that of F is wide at first: the minimum is the reward of G, which asks
        for x as small as can be, until about the last step.
        """
        formula = "F[0,6] x >= 2 & G[0,6] x <= 1"
        by_raw, _ = followed(Raw, formula, 0.0)
        by_funnel, _ = followed(Funnel, formula, 0.0)
        assert all(x in (1, 2) for x in by_raw[1:])
        assert by_funnel[1:5] == [-1, -2, -3, -4]


def test_a_potential_of_the_memory_changes_nothing() -> None:
    """tltl plus Phi(m') - Phi(m), Phi any function of time and what is known, 0 at the end: the same plans are best."""

    class Shaped(Tltl):
        def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
            rewards, after = super().along(samples, action, t, memory)
            end = t + len(samples) - 1
            potential = np.where(end < STEPS, np.sin(3 * end + after.sum(axis=1)), 0.0)
            rewards[-1] += potential - np.sin(3 * t + memory.sum(axis=1))
            return rewards, after

    spec = lattice.specification("F[2,5] abs(x) <= 1", STEPS)
    plain, shaped = (lattice.model(method) for method in (Tltl(spec), Shaped(spec)))
    for start in STARTS:
        plans = lattice.every_plan(plain, start)
        apart = lattice.returns(shaped, plans, 1.0) - lattice.returns(plain, plans, 1.0)
        assert np.ptp(apart) < 1e-9


BOX = {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}
leaves = st.builds(
    "{}[0,{}] {}".format, st.sampled_from("FG"), st.integers(0, 4), st.sampled_from(["x >= 0", "y >= 0", "x < 0"])
)
windows = st.recursive(leaves, lambda inner: st.builds("({} {} {})".format, inner, st.sampled_from("&|"), inner))


def verdict(node: stl.Formula, traces: Array, t: int) -> Array:
    """Of windows that end at sample t, by `stl.satisfied`; before the start F sees nothing true, and G is false."""
    if isinstance(node, stl.And | stl.Or):
        combine = np.logical_and if isinstance(node, stl.And) else np.logical_or
        return np.asarray(combine.reduce([verdict(arg, traces, t) for arg in node.args]))
    begin = t - stl.horizon(node)
    if begin < 0 and isinstance(node, stl.Always):
        return np.zeros(len(traces), dtype=bool)
    return stl.satisfied(node, traces[:, max(begin, 0) : t + 1], ("x", "y"), policy="clip")


@given(phi=windows, outer=st.sampled_from("FG"), seed=st.integers(0, 2**32))
def test_flags_say_what_the_windows_say(phi: str, outer: str, seed: int) -> None:
    traces = np.random.default_rng(seed).choice([-1.0, 1.0], (20, 13, 2))
    rewards, _ = run(Flag(specification(f"{outer}[0,8] {phi}", BOX), beta=2), traces)
    held = rewards > (0.5 if outer == "F" else -0.5)
    node = stl.parse(phi)
    for t in range(1, 13):
        assert np.array_equal(held[:, t], verdict(node, traces, t)), t


intervals = st.tuples(st.integers(0, 4), st.integers(0, 4)).map(lambda ends: f"[{ends[0]},{sum(ends)}]")
terms = st.one_of(
    st.builds("{}{} {}".format, st.sampled_from("FG"), intervals, st.sampled_from(["x >= 0", "y < 0"])),
    st.builds("F{} G{} {}".format, intervals, intervals, st.sampled_from(["x >= 0", "y < 0"])),
)


@given(parts=st.lists(terms, min_size=1, max_size=3), seed=st.integers(0, 2**32))
def test_flags_by_absolute_intervals_say_what_the_formula_says(parts: list[str], seed: int) -> None:
    spec = specification(" & ".join(parts), BOX, steps=16)
    traces = np.random.default_rng(seed).choice([-1.0, 1.0], (20, 17, 2), p=[0.3, 0.7])
    rewards, _ = run(Sparse(spec), traces)
    assert np.array_equal(rewards[:, -1] == 1, stl.satisfied(spec.formula, traces, spec.signals))
