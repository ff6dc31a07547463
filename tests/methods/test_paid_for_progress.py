"""tltl, sparse and dense: when they pay, and what, by hand and against the robustness and the verdict of the trace."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.episodes import run, specification

from stlbench import stl
from stlbench.contract import RewardMethod, Specification
from stlbench.task import load_task
from stlbench_methods.dense import Dense
from stlbench_methods.sparse import Sparse
from stlbench_methods.tltl import Tltl

BOX = {"x": (-3.0, 3.0)}
SEQUENCE = specification("F[1,2] x >= 1 & G[2,3] x <= 2", BOX, steps=5)
"""rho of F in [-4, 2], of G in [-1, 5]."""
TRACE = [0.0, 0.5, 1.5, -1.0, 0.0, 3.0]


def paid(method: RewardMethod, trace: list[float]) -> list[float]:
    return [float(reward) for reward in run(method, trace)[0][0, 1:]]


class TestTltl:
    def test_once_at_the_end(self) -> None:
        assert paid(Tltl(SEQUENCE), TRACE) == pytest.approx([0, 0, 0, 0, 0.5])

    def test_agm_by_hand(self) -> None:
        """Predicates over 4 and 5: F of -1/8, 1/8 is the mean of max(x, 0), 1/16; G of 1/10, 3/5 sqrt(1.76) - 1."""
        both = math.sqrt((1 + 1 / 16) * math.sqrt(1.1 * 1.6)) - 1
        assert paid(Tltl(SEQUENCE, semantics="agm"), TRACE)[-1] == pytest.approx(both, abs=1e-5)

    def test_lse_by_hand(self) -> None:
        """b = 2, G[0,1] x <= 2 of x = 2 and -3 over 5: -log(exp(0) + exp(-2)) / 2."""
        spec = specification("G[0,1] x <= 2", BOX)
        found = paid(Tltl(spec, semantics="lse", sharpness=2), [2, -3])
        assert found == pytest.approx([-math.log(1 + math.exp(-2)) / 2], abs=1e-5)

    def test_the_policy_sees_the_running_extremes(self) -> None:
        """Each range is scaled to [-1, 1]: -.5 in [-4, 2] is 1/6 and .5 is 1/2; .5 in [-1, 5] is -1/2."""
        method = Tltl(SEQUENCE)
        _, memory = run(method, TRACE)
        expected = np.array([[-1, 1], [1 / 6, 1], *[[0.5, -0.5]] * 4])
        assert method.inputs(memory[0]) == pytest.approx(expected, abs=1e-5)

    def test_scale_and_floor(self) -> None:
        """The least of the two terms is in [-4, 2]."""
        method = Tltl(SEQUENCE)
        assert (method.scale, method.floor) == pytest.approx((4, -4), abs=1e-5)
        assert Tltl(specification("G[0,1] x <= 4", BOX)).floor == 0


class TestDense:
    def test_the_level_of_the_prefix(self) -> None:
        """F so far -.5, .5 from step 2 on; G unread before step 2, then .5."""
        assert paid(Dense(SEQUENCE), TRACE) == pytest.approx([-0.5, 0.5, 0.5, 0.5, 0.5])

    def test_the_growth_of_what_is_certain(self) -> None:
        """L: -4 at first; min(-.5, -1) = -1 at step 1, at step 2 min(.5, -1), then .5."""
        assert paid(Dense(SEQUENCE, mode="difference"), TRACE) == pytest.approx([3, 0, 1.5, 0, 0], abs=1e-5)

    def test_scale_and_floor(self) -> None:
        growth = Dense(SEQUENCE, mode="difference")
        assert (growth.scale, growth.floor) == pytest.approx((6, 0), abs=1e-5)
        assert (Dense(SEQUENCE).scale, Dense(SEQUENCE).floor) == pytest.approx((4, -4), abs=1e-5)

    def test_a_window_that_has_not_begun_does_not_count(self) -> None:
        """F[0,2] G[1,2] x >= 0: windows begin at steps 1 to 3; at step 1 the first has begun, of which x = 1 is known.

        So far: 1 at step 1; at 2 the better of min(1, -1) and -1; at 3 the better of -1, min(-1, 2) and 2.
        """
        found = paid(Dense(specification("F[0,2] G[1,2] x >= 0", BOX)), [0, 1, -1, 2, 0.5])
        assert found == pytest.approx([1, -1, 2, 0.5])


class TestSparse:
    def test_once_at_the_end(self) -> None:
        assert paid(Sparse(SEQUENCE), TRACE) == [0, 0, 0, 0, 1]
        assert paid(Sparse(SEQUENCE), [0.0] * 6) == [0, 0, 0, 0, 0]

    def test_failure(self) -> None:
        method = Sparse(SEQUENCE, pays="failure")
        assert paid(method, TRACE) == [0, 0, 0, 0, 0]
        assert paid(method, [0.0] * 6) == [0, 0, 0, 0, -1]
        assert (method.floor, Sparse(SEQUENCE).floor) == (-1, 0)

    @pytest.mark.parametrize(
        "formula", ["F[0,3] x >= 1 & F[1,4] G[2,5] x >= 0", "G[0,6] F[0,3] x >= 1", "F[0,3] x >= 1 | G[1,2] x < 0"]
    )
    def test_it_is_the_verdict(self, formula: str) -> None:
        spec = specification(formula, BOX, steps=10)
        traces = np.random.default_rng(2).integers(-3, 4, (400, 11, 1)) / 2
        verdict = stl.satisfied(spec.formula, traces, spec.signals)
        assert 0.02 < verdict.mean() < 0.98
        assert np.array_equal(run(Sparse(spec), traces)[0][:, -1], verdict)

    def test_robustness_0_is_told_by_the_comparison(self) -> None:
        assert paid(Sparse(specification("G[0,1] x >= 1", BOX)), [1, 1]) == [1]
        assert paid(Sparse(specification("G[0,1] x > 1", BOX)), [1, 1]) == [0]

    def test_what_the_policy_sees_of_f_g_is_a_flag_and_a_count(self) -> None:
        assert Sparse(specification("F[1,4] G[2,5] x >= 0", BOX)).input_size == 2


def test_a_task_outside_the_fragment() -> None:
    """either-or has a disjunction of F G: windows and their samples."""
    spec: Specification = load_task("either-or").specification
    generator = np.random.default_rng(0)
    traces = generator.uniform(spec.low, spec.high, (50, spec.steps + 1, len(spec.low)))
    traces[:, 0] = (2, 2, 0, 0)[: len(spec.low)]
    rho = stl.robustness(spec.formula, traces, spec.signals)
    assert run(Tltl(spec), traces)[0][:, -1] == pytest.approx(rho)
    growth = run(Dense(spec, mode="difference"), traces)[0][:, 1:]
    assert np.ptp(growth.sum(axis=1) - rho) < 1e-9  # less L_0, which depends on the first sample alone
