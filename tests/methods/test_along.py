"""`along` is step after step, for every method, formula, hold and time; and what a start at a later time knows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers.episodes import specification
from helpers.stepwise import one_step
from hypothesis import given, reject
from hypothesis import strategies as st

from stlbench.contract import Array, Integers, RewardMethod, Specification, Unsuitable
from stlbench_methods.bhnr import Bhnr
from stlbench_methods.causation import Causation
from stlbench_methods.counters import Counters
from stlbench_methods.dense import Dense
from stlbench_methods.flag import Flag
from stlbench_methods.funnel import Funnel
from stlbench_methods.hprs import Hprs
from stlbench_methods.machine import Machine
from stlbench_methods.raw import Raw
from stlbench_methods.sparse import Sparse
from stlbench_methods.tau_cmdp import TauCmdp
from stlbench_methods.tau_mdp import TauMdp
from stlbench_methods.tltl import Tltl

BOX = {"x": (-2.0, 2.0), "y": (-2.0, 2.0)}
STEPS, ROWS = 18, 5
METHODS: dict[str, Callable[[Specification], RewardMethod]] = {
    "raw": Raw,
    "raw, literal": lambda spec: Raw(spec, activity="literal"),
    "funnel": lambda spec: Funnel(spec, ginf=0.3),
    "funnel, clipped": lambda spec: Funnel(spec, ginf=0.3, shape="clipped"),
    "funnel, normalised": lambda spec: Funnel(spec, ginf=0.3, shape="normalised"),
    "bhnr": lambda spec: Bhnr(spec, window=4),
    "bhnr, block": lambda spec: Bhnr(spec, window=4, mode="block", semantics="filtering"),
    "causation": Causation,
    "counters, margin": Counters,
    "counters, verdict": lambda spec: Counters(spec, pays="verdict"),
    "dense, level": Dense,
    "dense, difference": lambda spec: Dense(spec, mode="difference", semantics="agm"),
    "flag": lambda spec: Flag(spec, beta=2),
    "hprs": lambda spec: Hprs(spec, later="target"),
    "hprs, ends": lambda spec: Hprs(spec, violation="ends"),
    "machine": lambda spec: Machine(spec, shaping="phases"),
    "tau-cmdp": lambda spec: TauCmdp(spec, beta=2),
    "sparse": Sparse,
    "tau-mdp": TauMdp,
    "tau-mdp, probability": lambda spec: TauMdp(spec, form="probability"),
    "tltl": Tltl,
    "tltl, lse": lambda spec: Tltl(spec, semantics="lse"),
}
PSIS = st.sampled_from(["x >= 0", "abs(y) <= 1", "norm(x, y) < 1.5", "(x >= 1 | y <= 0)"])


@st.composite
def windows(draw: st.DrawFn) -> str:
    """An and/or of F[0,w] psi and G[0,w] psi, under F[0,6] or G[0,6]."""
    leaf = st.builds("{}[0,{}] {}".format, st.sampled_from("FG"), st.integers(0, 6), PSIS)
    pair = st.builds("({} {} {})".format, leaf, st.sampled_from("&|"), leaf)
    outer, phi = draw(st.sampled_from("FG")), draw(leaf | pair | st.builds("({} & {})".format, pair, leaf))
    return f"{outer}[0,6] {phi}"


@st.composite
def sequences(draw: st.DrawFn) -> str:
    """One to three terms of eq. 2 within STEPS steps."""
    terms = list[str]()
    for _ in range(draw(st.integers(1, 3))):
        a, b, c, d = sorted(draw(st.tuples(*[st.integers(0, 7)] * 4)))
        kind, psi = draw(st.sampled_from(["F", "G", "FG"])), draw(PSIS)
        terms.append(f"F[{a},{c}] G[{b},{d}] {psi}" if kind == "FG" else f"{kind}[{a},{b + d}] {psi}")
    return " & ".join(terms)


def step_after_step(
    method: RewardMethod, samples: Array, action: Array, t: Integers, memory: Array
) -> tuple[Array, Array]:
    """What `along` must say."""
    rewards = list[Array]()
    for i in range(len(samples) - 1):
        reward, memory = one_step(method, samples[i], action, samples[i + 1], t + i, memory)
        rewards.append(reward)
    return np.array(rewards), memory


def check_along(name: str, formula: str, hold: int, seed: int) -> None:
    """An episode from random times on, `hold` steps at once and one by one."""
    try:
        method = METHODS[name](specification(formula, BOX, steps=STEPS))
    except Unsuitable:
        reject()
    generator = np.random.default_rng(seed)
    t, action = generator.integers(0, STEPS - 2 * hold + 1, ROWS), np.zeros((ROWS, 1))  # two spans at least
    # halves, so that predicates lie on their boundary, and strict ones differ from the others
    before = generator.integers(-4, 5, (ROWS, 2)) / 2
    memory = method.initial_memory(before, t)
    while t.max() + hold <= STEPS:
        samples = np.concatenate([before[None], generator.integers(-4, 5, (hold, ROWS, 2)) / 2])
        given = samples.copy(), t.copy(), memory.copy()
        rewards, after = method.along(samples, action, t, memory)
        expected, last = step_after_step(method, samples, action, t, memory)
        assert np.array_equal(rewards, expected)
        assert np.array_equal(after, last)
        assert all(map(np.array_equal, given, (samples, t, memory)))
        before, memory, t = samples[-1], after, t + hold


NAMES = ["bhnr", "bhnr, block", "dense, level", "dense, difference", "flag", "sparse", "tau-mdp", "tltl"]


@pytest.mark.parametrize("name", [*NAMES, "tau-mdp, probability"])
@given(formula=windows(), hold=st.integers(1, 9), seed=st.integers(0, 2**32))
def test_windows(name: str, formula: str, hold: int, seed: int) -> None:
    check_along(name, formula, hold, seed)


@given(
    formula=st.builds("G[0,{}] (F[0,{}] {} & {})".format, st.integers(0, 9), st.integers(0, 6), PSIS, PSIS),
    hold=st.integers(1, 9),
    seed=st.integers(0, 2**32),
)
def test_again_and_again(formula: str, hold: int, seed: int) -> None:
    check_along("causation", formula, hold, seed)


@pytest.mark.parametrize("name", sorted(set(METHODS) - {"causation"}))
@given(formula=sequences(), hold=st.integers(1, 9), seed=st.integers(0, 2**32))
def test_terms(name: str, formula: str, hold: int, seed: int) -> None:
    check_along(name, formula, hold, seed)


class TestLaterStart:
    """`initial_memory` at t > 0: the flags' initial values, and then the sample at t."""

    at = np.array([0, 2, 3, 5])

    def test_absolute_flags(self) -> None:
        # F[2,4] p, G[1,3] q, F[1,3] G[1,2] p, observed at 2..4, 1..3 and 2..5; at 0, 2, 3 and 5 p holds, q does not
        method = Flag(specification("F[2,4] x >= 0 & G[1,3] y >= 0 & F[1,3] G[1,2] x >= 0", BOX, steps=7))
        expected = [[0, 1, 0, 0], [1, 0, 0, 1], [1, 0, 0, 1], [0, 1, 0, 1]]
        assert method.initial_memory(np.tile([1.0, -1.0], (4, 1)), self.at).tolist() == expected
        untouched = [[0, 1, 0, 0]] * 4
        assert method.initial_memory(np.tile([-1.0, 1.0], (4, 1)), self.at).tolist() == untouched

    def test_windows_do_not_depend_on_the_time(self) -> None:
        method = Flag(specification("G[0,4] (F[0,2] x >= 0 & G[0,2] x >= 0)", BOX))
        signals = np.array([[1.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [-1.0, 0.0]])
        assert method.initial_memory(signals, self.at).tolist() == [[3, 1], [3, 1], [0, 0], [0, 0]]

    def test_a_history_is_copies_of_the_sample(self) -> None:
        method = TauMdp(specification("G[0,4] G[0,1] x >= 0", BOX))
        assert method.initial_memory(np.array([[1.0, 0.5]] * 4), self.at).tolist() == [[1, 0.5, 1, 0.5]] * 4


def test_what_is_paid_while_an_action_is_held() -> None:
    """G[0,9] G[0,1] p with p = 1 | 1 1 0 1 1: full from the second p in a row on. F[2,3] p latches at 3."""
    x = np.array([1.0, 1, 1, -1, 1, 1]).reshape(6, 1, 1)
    nothing, zero = np.zeros((1, 1)), np.zeros(1, dtype=np.int64)
    low = -np.exp(-2.0)
    windows = Flag(specification("G[0,9] G[0,1] x >= 0", {"x": (-1, 1)}), beta=2)
    rewards, counter = windows.along(x, nothing, zero, windows.initial_memory(x[0], zero))
    assert rewards[:, 0] == pytest.approx([low, low, -1, -1, low])
    assert counter.tolist() == [[2]]
    latch = Flag(specification("F[2,3] x >= 0", {"x": (-1, 1)}, steps=9), beta=2)
    rewards, flag = latch.along(-x, nothing, zero, latch.initial_memory(-x[0], zero))
    assert rewards[:, 0] == pytest.approx([0, np.exp(-2.0), 1, 0, 0])
    assert flag.tolist() == [[1]]
