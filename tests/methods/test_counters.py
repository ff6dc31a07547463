"""counters: counts by hand, its verdict against the formula's, which other counters there are, and what it refuses."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from helpers.episodes import run, specification
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench.contract import Array, Unsuitable
from stlbench.task import load_task
from stlbench_methods.counter_parts import DONE, FAILED
from stlbench_methods.counters import Counters

X, XY, XYZ = ({name: (-1.0, 1.0) for name in names} for names in ("x", "xy", "xyz"))


class TestByHand:
    """At 1 a predicate holds, at -1 not."""

    def test_again_and_again(self) -> None:
        """Within 2 steps of each of 0..3: at 1 and at 3 it holds. Ages 1 0 1, and it is done at 3."""
        method = Counters(specification("G[0,3] F[0,2] x >= 0", X))
        rewards, counts = run(method, [-1, 1, -1, 1, -1, -1])
        assert counts[0, :, 0].tolist() == [1, 0, 1, DONE, DONE, DONE]
        assert rewards[0, 1:].tolist() == [1, 0.5, 1, 1, 1]  # the time left over 2 steps
        assert method.inputs(counts[0])[:, 0].tolist() == [0.5, 1, 0.5, 1, 1, 1]
        assert not method.over(counts[0]).any()

    def test_a_broken_deadline(self) -> None:
        """Three samples without it: from 1 on, so at 3."""
        method = Counters(specification("G[0,3] F[0,2] x >= 0", X))
        rewards, counts = run(method, [1, -1, -1, -1, 1, 1])
        assert counts[0, :, 0].tolist() == [0, 1, 2, FAILED, FAILED, FAILED]
        assert rewards[0, 1:].tolist() == [0.5, 0, -1, 0, 0]
        assert method.over(counts[0]).tolist() == [False] * 3 + [True] * 3
        assert method.inputs(counts[0, 3:4]).tolist() == [[-1]]

    def test_a_response(self) -> None:
        """Asked at 1, answered at 3, asked again at 3: by the same sample, so none is open."""
        method = Counters(specification("G[0,3] (x >= 0 -> F[0,2] y >= 0)", XY))
        trace = np.array([[[-1, -1], [1, -1], [-1, -1], [1, 1], [-1, -1], [-1, -1]]])
        rewards, counts = run(method, trace)
        assert counts[0, :, 0].tolist() == [0, 1, 2, DONE, DONE, DONE]
        assert rewards[0, 1:].tolist() == [0.5, 0, 1, 1, 1]
        assert method.inputs(counts[0, :3])[:, 0].tolist() == [1, -0.5, -1]  # none is open, 1 of 2 steps, 2 of 2

    def test_a_chain(self) -> None:
        """x at 1, y at 3: within 2 steps. The time left is 2, then 1. Half of the stages, then all."""
        spec = specification("F[0,2] (x >= 0 & F[0,2] y >= 0)", XY)
        trace = np.array([[[-1, -1], [1, -1], [-1, -1], [-1, 1], [-1, -1]]])
        rewards, counts = run(Counters(spec), trace)
        assert counts[0].tolist() == [[0, 0], [2, 0], [1, 0], [0, DONE], [0, DONE]]
        assert rewards[0, 1:].tolist() == [0.5, 0.5, 1, 1]
        method = Counters(spec, pays="verdict")
        assert run(method, trace)[0][0, 1:].tolist() == [0, 0, 1, 0]
        assert method.over(counts[0]).tolist() == [False] * 3 + [True] * 2

    def test_a_chain_that_is_too_late(self) -> None:
        """Nothing is under way after 2, and x came at 0: y at 3 is too late."""
        spec = specification("F[0,2] (x >= 0 & F[0,2] y >= 0)", XY)
        rewards, counts = run(Counters(spec), np.array([[[1, -1], [-1, -1], [-1, -1], [-1, 1], [-1, -1]]]))
        assert counts[0].tolist() == [[2, 0], [1, 0], [0, FAILED], [0, FAILED], [0, FAILED]]
        assert rewards[0, 1:].tolist() == [0.5, -1, 0, 0]

    def test_a_stay_again_and_again(self) -> None:
        """Two in a row begin at 1, which is known at 2. The run in front, the age behind it, which counts from 1 on."""
        method = Counters(specification("G[0,3] F[0,2] G[0,1] x >= 0", X))
        _, counts = run(method, [-1, 1, 1, -1, 1, 1, -1])
        assert counts[0].tolist() == [[0, 0], [1, 1], [2, 0], [0, 1], [1, 2], [0, DONE], [0, DONE]]

    def test_an_until(self) -> None:
        """The guard held until 1, so the goal counts at 2 but not at 3: it has failed at 2."""
        method = Counters(specification("x >= 0 U[0,4] y >= 0", XY))
        late, soon = [[1, -1], [1, -1], [-1, -1], [-1, 1], [-1, -1]], [[1, -1], [1, -1], [-1, 1], [-1, -1], [-1, -1]]
        _, counts = run(method, np.array([late, soon]))
        assert counts[0].tolist() == [[1, 0], [1, 0], [0, FAILED], [0, FAILED], [0, FAILED]]
        assert counts[1].tolist() == [[1, 0], [1, 0], [0, DONE], [0, DONE], [0, DONE]]

    def test_a_later_start(self) -> None:
        """What is not known has as much time left as it can have: a request at 2 is open, until it is too late at 5."""
        method = Counters(specification("G[0,2] (x >= 0 -> F[0,2] y >= 0) & F[0,1] (x >= 0 & F[0,1] y >= 0)", XY))
        signals, t = np.tile([-1.0, -1.0], (6, 1)), np.arange(6)
        assert method.initial_memory(signals, t).tolist() == [
            [0, 0, 0],
            [0, 0, FAILED],  # no stage in 0..1
            [DONE, 0, FAILED],  # x may have held at 1, and y held neither then nor at 2
            [2, 0, DONE],
            [FAILED, 0, DONE],
            [DONE, 0, DONE],
        ]


@st.composite
def windows(draw: st.DrawFn, *, from_0: bool = False) -> str:
    a = 0 if from_0 else draw(st.integers(0, 3))
    return f"[{a},{a + draw(st.integers(0, 4))}]"


PSI = st.sampled_from(["x >= 0", "y >= 0", "z >= 0", "(x >= 0 | y < 0)", "!(z >= 0)", "(x >= 0 & z < 0)"])
SOON = windows(from_0=True)
STAGE = st.one_of(PSI, st.builds("G{} {}".format, SOON, PSI))
CHAIN = st.recursive(STAGE, lambda later: st.builds("({} & F{} {})".format, PSI, SOON, later), max_leaves=4)
FAMILIES = {
    "again": st.builds("G{} F{} {}".format, windows(), windows(), PSI),
    "stay again": st.builds("G{} F{} G{} {}".format, windows(), windows(), windows(), PSI),
    "patrol": st.builds("G{} (F{} {} & F{} G{} {})".format, windows(), windows(), PSI, windows(), SOON, PSI),
    "response": st.builds("G{} (({} & {}) -> (F{} {} & {}))".format, windows(), PSI, PSI, SOON, PSI, PSI),
    "response by until": st.builds("G{} ({} | {} U{} {})".format, windows(), PSI, PSI, SOON, PSI),
    "chain": st.builds("F{} {}".format, windows(), CHAIN),
    "visit and stay": st.builds("F{} ({} & G{} {})".format, windows(), PSI, SOON, PSI),
    "stay": st.builds("F{} G{} {}".format, windows(), windows(), PSI),
    "until again": st.builds("G{} ({} U{} {})".format, windows(), PSI, windows(), PSI),
    "until": st.builds("{} U{} {}".format, PSI, windows(), CHAIN),
}
FAMILIES["and"] = st.builds("{} & {}".format, st.one_of(*FAMILIES.values()), st.one_of(*FAMILIES.values()))


def traces(samples: int, seed: int) -> Array:
    """(60, samples, 3) of -1 and 1, each trace with a share of its own."""
    generator = np.random.default_rng(seed)
    likely = generator.uniform(0.1, 0.9, (60, 1, 1))
    return np.where(generator.random((60, samples, 3)) < likely, 1.0, -1.0)


@pytest.mark.parametrize("family", FAMILIES)
@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
def test_its_verdict_is_that_of_the_formula_and_never_late(family: str, data: st.DataObject, seed: int) -> None:
    """And an episode is paid once for it. Intervals of truth know some verdicts later than counters, never earlier."""
    spec = specification(data.draw(FAMILIES[family]), XYZ)
    method, x = Counters(spec, pays="verdict"), traces(spec.steps + 1, seed)
    rewards, counts = run(method, x)
    states = counts[:, :, method._tables.last]
    failed, done = (states == FAILED).any(axis=2), (states == DONE).all(axis=2)
    satisfied = stl.satisfied(spec.formula, x, ("x", "y", "z"))
    assert np.array_equal(done[:, -1], satisfied)
    assert np.array_equal(failed[:, -1], ~satisfied)
    for t in range(spec.steps):
        certain, possible = stl.satisfaction_bounds(spec.formula, x[:, : t + 1], ("x", "y", "z"))
        assert not (certain & ~done[:, t]).any()
        assert not (~possible & ~failed[:, t]).any()
    early = method.over(counts[:, 0])
    assert np.array_equal(rewards[:, 1:].sum(axis=1), np.where(early, 0, np.where(satisfied, 1, -1)))


@pytest.mark.parametrize(
    ("formula", "steps", "names", "all_of_them"),
    [
        ("G[2,4] F[0,3] x >= 0", 9, X, True),
        ("G[1,5] F[0,5] G[0,2] x >= 0", 13, X, True),
        ("G[0,8] F[0,2] G[0,2] x >= 0", 13, X, True),
        ("G[1,3] (x >= 0 -> F[0,2] y >= 0)", 6, XY, True),
        ("G[0,3] (x >= 0 U[0,2] y >= 0)", 6, XY, True),
        ("F[2,4] (x >= 0 & F[0,2] y >= 0)", 7, XY, True),
        ("F[1,3] (x >= 0 & G[0,2] y >= 0)", 7, XY, True),
        ("F[1,4] G[0,2] x >= 0", 9, X, True),
        ("x >= 0 U[1,4] y >= 0", 7, XY, True),
        ("x >= 0 U[1,2] G[0,2] y >= 0", 6, XY, True),
        ("F[0,3] (x >= 0 & F[0,2] G[0,2] y >= 0)", 7, XY, False),
        ("F[1,3] (x >= 0 & F[0,2] (y >= 0 & F[0,2] z >= 0))", 4, XYZ, False),
        ("x >= 0 U[0,2] (y >= 0 & F[0,2] z >= 0)", 4, XYZ, False),
    ],
)
def test_the_counterfactual_counters_are_those_that_some_past_leads_to(
    formula: str, steps: int, names: dict[str, tuple[float, float]], all_of_them: bool
) -> None:
    """Every past of -1 and 1 is tried, at each step and for all samples there; what has failed is left out."""
    method, k = Counters(specification(formula, names, steps=steps)), len(names)
    every = np.array(list(itertools.product([-1.0, 1.0], repeat=k * (steps + 1)))).reshape(-1, steps + 1, k)
    _, counts = run(method, every)
    chance = np.random.default_rng(0).random((2000, method.memory_size))
    for t, sample in itertools.product(range(steps), itertools.product([-1.0, 1.0], repeat=k)):
        there = counts[(every[:, t] == sample).all(axis=1), t]
        reached = set(map(tuple, there[there[:, -1] != FAILED].tolist()))
        if reached:
            own = np.tile(min(reached), (2000, 1))
            drawn = method.counterfactual(np.tile(sample, (2000, 1)), np.full(2000, t), own, chance)
            found = set(map(tuple, drawn.tolist()))
            assert found == reached if all_of_them else found <= reached, (t, sample)


def test_one_counter_is_evenly_drawn() -> None:
    """At 6 without x the last visit was 1 to 4 steps ago, or all is done since 5."""
    method = Counters(specification("G[0,5] F[0,4] x >= 0", X))
    chance = np.linspace(0, 1, 100, endpoint=False)[:, None]
    drawn = method.counterfactual(np.full((100, 1), -1.0), np.full(100, 6), np.full((100, 1), 2.0), chance)
    assert np.unique(drawn, return_counts=True)[0].tolist() == [DONE, 2, 3, 4]
    assert np.unique(drawn, return_counts=True)[1].tolist() == [25] * 4


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("G[0,9] (x >= 0 -> F[2,4] y >= 0)", r"F\[2,4\] at column 19: it begins later than the request"),
        ("F[0,9] (x >= 0 & F[2,4] y >= 0)", r"F\[2,4\] at column 18: it begins later than the stage before it"),
        ("F[0,9] (F[0,4] x >= 0 & F[0,4] y >= 0)", r"F\[0,4\] at column 25: inside of F or U it stands beside"),
        ("F[0,9] (x >= 0 | F[0,4] y >= 0)", r"or at column \d+: inside of F or U stand stages"),
        ("G[0,9] (F[0,4] x >= 0 | F[0,4] y >= 0)", r"F\[0,4\] at column 25: inside of G it stands beside"),
        ("G[0,9] F[0,3] (x >= 0 & F[0,4] y >= 0)", r"and at column \d+: inside of G F stands what has no"),
        ("G[0,9] (x >= 0 -> F[0,3] G[0,2] y >= 0)", r"G\[0,2\] at column 26: in the answer to a request"),
        ("G[0,9] (x >= 0 -> G[0,2] y >= 0)", r"G\[0,2\] at column 19: counters take F, G and U"),
        ("x >= 0 R[0,4] y >= 0", r"R\[0,4\] at column 8: counters take"),
        ("(F[0,2] x >= 0) U[0,4] y >= 0", r"F\[0,2\] at column 2: left of U stands what has no"),
        ("G x >= 0", "G"),
    ],
)
def test_what_needs_more_than_a_counter_is_refused_with_its_place(text: str, reason: str) -> None:
    with pytest.raises(Unsuitable, match=reason):
        Counters(specification(text, XY, steps=30))


def test_as_many_as_are_asked_for() -> None:
    assert Counters(specification("G[0,3] F[0,2] x >= 0", X), counterfactuals=16).counterfactuals == 16


def test_real_episodes_are_paid_by_their_verdict() -> None:
    """The robot of the task patrol, by its controller and, in half of the copies, standing still from step 500 on."""
    task = load_task("patrol")
    spec, system, rows = task.specification, task.system, 8
    method = Counters(spec, pays="verdict")
    state = task.starts.of_training(np.random.default_rng(0), rows)
    memory, paid = method.initial_memory(system.signals(state), np.zeros(rows, np.int64)), np.zeros(rows)
    trace = [system.signals(state)]
    for t in range(0, spec.steps, 5):
        action = system.controller(state, np.full(rows, t))
        assert action is not None
        action[rows // 2 :] *= t < 500
        for _ in range(5):
            state = system.step(state, action)
            trace.append(system.signals(state))
        rewards, memory = method.along(np.stack(trace[-6:]), action, np.full(rows, t), memory)
        paid += rewards.sum(axis=0)
    satisfied = stl.satisfied(spec.formula, np.stack(trace, axis=1), spec.signals)
    assert paid.tolist() == np.where(satisfied, 1.0, -1.0).tolist()
    assert satisfied.tolist() == [True] * 4 + [False] * 4
