"""machine: its runs by hand, its verdict against the formula's, and which other memories there are."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from helpers.episodes import run, specification
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench.contract import Array
from stlbench_methods.machine import Machine

BOX = {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}
BOTH = "F[1,3] x >= 0 & G[4,5] x >= 0"


class TestByHand:
    def test_done(self) -> None:
        """F is done at 2, G holds at 4 and is done at 5: 1 is paid there, and nothing at 6."""
        method = Machine(specification(BOTH, {"x": (-1, 1)}, steps=6))
        rewards, runs = run(method, [-1, -1, 1, -1, 1, 1, -1])
        assert rewards[0, 1:].tolist() == [0, 0, 0, 0, 1, 0]
        assert runs[0].tolist() == [[0, 0], [0, 0], [1, 0], [1, 0], [1, 1], [1, 2], [1, 2]]
        assert method.over(runs[0]).tolist() == [False] * 5 + [True] * 2
        assert method.inputs(runs[0, 4:5]).tolist() == [[1, 0.5]]

    def test_failed(self) -> None:
        """G fails at 4. With shaping the phases that were left, two of three, are given back."""
        spec = specification(BOTH, {"x": (-1, 1)}, steps=6)
        trace = [-1, -1, 1, -1, -1, 1, 1]
        rewards, runs = run(Machine(spec), trace)
        assert rewards[0, 1:].tolist() == [0, 0, 0, -1, 0, 0]
        assert runs[0, -1].tolist() == [1, -1]
        shaped, _ = run(Machine(spec, shaping="phases"), trace)
        assert shaped[0, 1:] == pytest.approx([0, 1 / 3, 0, -1 / 3, 0, 0])

    def test_the_phases(self) -> None:
        """F G waits, holds at 1, has lost it at 2, holds from 3 on and is done at 5: 2 1 2 1 1 0 phases are left."""
        spec = specification("F[0,3] G[0,2] x >= 0", {"x": (-1, 1)})
        rewards, runs = run(Machine(spec, shaping="phases"), [-1, 1, -1, 1, 1, 1])
        assert runs[0, :, 0].tolist() == [0, 1, 0, 1, 2, 3]
        assert rewards[0, 1:].tolist() == [0.5, -0.5, 0.5, 0, 1.5]

    def test_it_fails_as_soon_as_too_few_samples_are_left(self) -> None:
        """Three in a row within 0..5: at 3 a run can begin at 4 at the earliest, and two are not enough."""
        rewards, runs = run(Machine(specification("F[0,3] G[0,2] x >= 0", {"x": (-1, 1)})), [1, 1, -1, -1, 1, 1])
        assert runs[0, :, 0].tolist() == [1, 2, 0, -1, -1, -1]
        assert rewards[0, 1:].tolist() == [0, 0, -1, 0, 0]

    def test_a_later_start(self) -> None:
        """Nothing is known of the steps before: G[1,3] may have held, F[0,2] is taken as done from 3 on."""
        method = Machine(specification("F[0,2] x >= 0 & G[1,3] y >= 0", BOX, steps=5))
        signals, t = np.tile([-1.0, 1.0], (5, 1)), np.arange(5)
        assert method.initial_memory(signals, t).tolist() == [[0, 0], [0, 1], [-1, 2], [1, 3], [1, 3]]


@st.composite
def conjunctions(draw: st.DrawFn) -> str:
    """One to three terms of eq. 2 within 12 steps, of x and of y."""
    terms = list[str]()
    for _ in range(draw(st.integers(1, 3))):
        a, b, c, d = (draw(st.integers(0, 3)) for _ in range(4))
        psi = draw(st.sampled_from(["x >= 0", "y >= 0", "(x >= 0 | y < 0)"]))
        kind = draw(st.sampled_from(["F", "G", "FG"]))
        terms.append(f"F[{a},{a + b}] G[{c},{c + d}] {psi}" if kind == "FG" else f"{kind}[{a},{a + b + d}] {psi}")
    return " & ".join(terms)


def traces(samples: int, seed: int) -> Array:
    """(200, samples, 2) of -1 and 1, the half of them mostly 1."""
    generator = np.random.default_rng(seed)
    likely = np.repeat([0.5, 0.85], 100)[:, None, None]
    return np.where(generator.random((200, samples, 2)) < likely, 1.0, -1.0)


@given(formula=conjunctions(), seed=st.integers(0, 2**32 - 1))
def test_its_verdict_is_that_of_the_formula_as_soon_as_there_is_one(formula: str, seed: int) -> None:
    spec = specification(formula, BOX, steps=13)
    found, x = Machine(spec), traces(14, seed)
    rewards, runs = run(found, x)
    for t in range(14):
        certain, possible = stl.satisfaction_bounds(spec.formula, x[:, : t + 1], ("x", "y"))
        assert np.array_equal(found.over(runs[:, t]), certain | ~possible)
        assert np.array_equal((runs[:, t] < 0).any(axis=1), ~possible)
    satisfied, early = stl.satisfied(spec.formula, x, ("x", "y")), found.over(runs[:, 0])
    assert np.array_equal(rewards[:, 1:].sum(axis=1), np.where(early, 0, np.where(satisfied, 1, -1)))


@given(formula=conjunctions(), seed=st.integers(0, 2**32 - 1))
def test_the_shaping_sums_up_to_the_phases_that_were_left_at_first(formula: str, seed: int) -> None:
    """Both sums differ by a function of the first sample alone: all policies are paid the same more."""
    spec, x = specification(formula, BOX, steps=13), traces(14, seed)
    plain, runs = run(Machine(spec), x)
    shaped, _ = run(Machine(spec, shaping="phases"), x)
    more = (shaped - plain)[:, 1:].sum(axis=1)
    first, index = np.unique(runs[:, 0], axis=0, return_inverse=True)
    for i in range(len(first)):
        assert np.ptp(more[index == i]) < 1e-12
    assert (more[Machine(spec).over(runs[:, 0])] == 0).all()


@pytest.mark.parametrize("formula", ["F[1,4] x >= 0", "G[1,4] x >= 0", "F[1,3] G[0,1] x >= 0", "F[0,4] G[1,2] x >= 0"])
def test_the_counterfactual_memories_are_those_that_some_past_leads_to(formula: str) -> None:
    """Every past of -1 and 1 is tried, at each step and for both samples there; what has failed is left out."""
    steps = 7
    method = Machine(specification(formula, {"x": (-1, 1)}, steps=steps))
    every = np.array(list(itertools.product([-1.0, 1.0], repeat=steps + 1)))[..., None]
    _, runs = run(method, every)
    chance = np.linspace(0, 1, 100, endpoint=False)[:, None]
    for t, x in itertools.product(range(steps), [-1.0, 1.0]):
        reached = set(runs[every[:, t, 0] == x, t, 0].tolist()) - {-1.0}
        own = np.full((100, 1), -1.0)
        drawn = method.counterfactual(np.full((100, 1), x), np.full(100, t), own, chance)[:, 0]
        assert set(drawn.tolist()) == (reached or {-1.0}), (t, x)
        counts = np.unique(drawn, return_counts=True)[1]
        assert np.ptp(counts) <= 1  # each as likely


def test_without_replay_there_are_none() -> None:
    spec = specification(BOTH, {"x": (-1, 1)})
    assert Machine(spec).counterfactuals == 1
    assert Machine(spec, counterfactuals=0).counterfactuals == 0
