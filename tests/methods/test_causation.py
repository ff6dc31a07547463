"""causation: the closed form against the published recursion, and rewards by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from helpers.episodes import run, specification

from stlbench import stl
from stlbench.contract import Array, Unsuitable
from stlbench.task import load_task
from stlbench_methods.causation import Causation

BOX = {"x": (-3.0, 3.0), "y": (-3.0, 3.0)}
BONUS = 7.0
TRACES = 10_000


@dataclass(frozen=True)
class Recursion:
    """The online violation causation distance by its published recursion, word for word and slow.

    `up(phi, tau)` says how far the newest sample b of traces (N, T + 1, 2) is from causing a violation of phi at step
    tau; `upper` bounds the robustness of phi at tau over all continuations of the samples up to b. For the newest
    sample alone an atom has a distance. Values are arrays, one number per trace.
    """

    traces: Array
    b: int

    def up(self, phi: stl.Formula, tau: int) -> Array:
        match phi:
            case stl.And((p, q)):
                return np.minimum(self.up(p, tau), self.up(q, tau))
            case stl.Always(a, b, p):
                return self._least(p, tau, a, b)
            case stl.Eventually(a, b, p):
                return np.maximum(self._least(p, tau, a, b), self.upper(phi, tau))
            case _:
                return self._margin(phi, tau) if tau == self.b else self._infinite()

    def upper(self, phi: stl.Formula, tau: int) -> Array:
        match phi:
            case stl.And((p, q)):
                return np.minimum(self.upper(p, tau), self.upper(q, tau))
            case stl.Always(a, b, p):
                return np.min([self.upper(p, t) for t in range(tau + a, tau + b + 1)], axis=0)
            case stl.Eventually(a, b, p):
                return np.max([self.upper(p, t) for t in range(tau + a, tau + b + 1)], axis=0)
            case _:
                return self._margin(phi, tau) if tau <= self.b else self._infinite()

    def _least(self, phi: stl.Formula, tau: int, a: int, b: int) -> Array:
        """Over the steps of the interval that have been seen."""
        seen = range(tau + a, min(tau + b, self.b) + 1)
        return np.min([self._infinite(), *(self.up(phi, t) for t in seen)], axis=0)

    def _margin(self, phi: stl.Formula, tau: int) -> Array:
        return stl.margin(phi, ("x", "y"))(self.traces[:, tau])

    def _infinite(self) -> Array:
        return np.full(len(self.traces), math.inf)


def published(formula: stl.Formula, traces: Array) -> Array:
    """The reward of samples 1..T by the recursion: c where it is at most 0, else the bonus, (N, T)."""
    found = np.array([Recursion(traces, b).up(formula, 0) for b in range(1, traces.shape[1])]).T
    return np.where(found <= 0, found, BONUS)


@pytest.mark.parametrize(
    "formula",
    [
        "G[0,4] (F[0,2] x >= 1 & y <= 1)",
        "G[0,3] F[0,3] x >= 1",
        "G[0,5] y <= 1",
        "G[0,3] (F[0,1] x >= 1 & F[0,3] y >= 0)",
        "G[0,3] (F[0,2] x >= 1 & G[0,2] y <= 1)",
        "G[0,3] F[0,2] x >= 1 & G[0,5] y <= 1",
    ],
)
def test_the_closed_form_is_the_recursion(formula: str) -> None:
    spec = specification(formula, BOX, steps=8)
    traces = np.random.default_rng(0).integers(-12, 13, (TRACES, 9, 2)) / 4
    found, _ = run(Causation(spec, bonus=BONUS), traces)
    expected = published(spec.formula, traces)
    assert np.array_equal(found[:, 1:], expected)
    assert 0.1 < (expected == BONUS).mean() < 0.95


def test_by_hand() -> None:
    """G[0,2] (F[0,1] x >= 1 & y <= 1): F counts at steps 1 to 3, y at steps 0 to 2. (x, y) as below."""
    trace = np.array([[[0, 0], [0.5, 0], [2, 3], [0, 9], [-3, 9]]], dtype=float)
    rewards, memory = run(Causation(specification("G[0,2] (F[0,1] x >= 1 & y <= 1)", BOX, steps=4)), trace)
    # step 1: the better of -1 and -.5; 2: y is 2 above; 3: F is 1, and y asked for no more; 4: nothing is asked
    assert rewards[0, 1:].tolist() == [-0.5, -2, 1, 1]
    assert memory[0].tolist() == [[-1, -1], [-1, -0.5], [-0.5, 1], [1, -1], [-1, -4]]


def test_a_violation_is_paid_for_while_it_lasts() -> None:
    """Only samples that cause it are: the next one that satisfies again has the bonus."""
    found, _ = run(Causation(specification("G[0,4] x <= 1", {"x": (-3, 3)}), bonus=5), [0, 3, 1, 0, 2])
    assert found[0, 1:].tolist() == [-2, 0, 5, -1]


def test_inputs_scale_and_floor() -> None:
    method = Causation(specification("G[0,2] (F[0,1] x >= 1 & y <= 1)", BOX), bonus=1)
    assert (method.memory_size, method.scale, method.floor) == pytest.approx((2, 4, -4), abs=1e-5)
    assert method.inputs(np.array([[-4.0, 2.0], [-1.0, -1.0]])) == pytest.approx(np.array([[-1, 1], [0, 0]]), abs=1e-5)
    assert method.describe() == {"parts": ["F[0,1] x >= 1 at steps 0 to 2", "y <= 1 at steps 0 to 2"]}


@pytest.mark.parametrize(
    "formula", ["F[0,4] x >= 1", "G[1,4] x >= 1", "G[0,4] (F[0,2] x >= 1 | y <= 1)", "G[0,4] F[1,2] x >= 1", "x >= 1"]
)
def test_other_formulas_are_unsuitable(formula: str) -> None:
    with pytest.raises(Unsuitable, match=r"it takes G\[0,T\] phi, phi a conjunction of F\[0,w\] psi, "):
        Causation(specification(formula, BOX, steps=6))


def test_the_nested_form_of_a_task_is_read() -> None:
    assert Causation(specification("F[0,4] x >= 1", BOX, nested="G[0,2] F[0,2] x >= 1")).memory_size == 3


@pytest.mark.parametrize(("task", "windows"), [("patrol", 200), ("cartpole-steady", 11), ("hold-disc", 0)])
def test_tasks_of_that_form(task: str, windows: int) -> None:
    assert Causation(load_task(task).specification).memory_size == windows
