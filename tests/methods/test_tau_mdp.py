"""tau-mdp: the history as state, and the robustness or the truth of phi on it as reward."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.episodes import run, specification
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stlbench import stl
from stlbench.contract import Array, Unsuitable
from stlbench.task import load_task
from stlbench_methods.tau_mdp import TauMdp

BOX = {"x": (-2.0, 4.0), "y": (-1.0, 1.0)}
ALWAYS = "G[0,6] G[0,2] x <= 1"
"""rho = 1 - x in [-3, 3] over the box; tau = 3 samples."""


def traces(seed: int, count: int = 20, samples: int = 9) -> Array:
    return np.random.default_rng(seed).uniform((-2, -1), (4, 1), (count, samples, 2))


def histories(trace: Array, tau: int) -> Array:
    """(N, T + 1, tau, k): the last tau samples up to t, the first one standing for those before it."""
    padded = np.concatenate([np.repeat(trace[:, :1], tau - 1, axis=1), trace], axis=1)
    return np.stack([padded[:, t : t + tau] for t in range(trace.shape[1])], axis=1)


class TestHistory:
    def test_it_starts_with_copies_of_the_first_sample(self) -> None:
        method = TauMdp(specification(ALWAYS, BOX))
        assert method.tau == 3
        assert method.memory_size == 6
        begun = method.initial_memory(np.array([[2.0, 0.5], [1.0, 0.0]]), np.zeros(2, dtype=np.int64))
        assert begun.tolist() == [[2, 0.5] * 3, [1, 0] * 3]

    def test_it_is_ordered_oldest_first(self) -> None:
        trace = np.array([[[1.0, 0.1], [2.0, 0.2], [3.0, 0.3], [4.0, 0.4]]])
        _, memory = run(TauMdp(specification(ALWAYS, BOX)), trace)
        one, two, three, four = trace[0].tolist()
        assert memory[0].tolist() == [one * 3, one * 2 + two, one + two + three, two + three + four]

    def test_inputs_are_scaled_by_the_box(self) -> None:
        method = TauMdp(specification(ALWAYS, BOX))
        memory = np.array([[-2.0, -1.0, 4.0, 1.0, 1.0, 0.5]])
        assert method.inputs(memory).tolist() == [[-1, -1, 1, 1, 0, 0.5]]

    def test_every_so_many_th_sample_is_shown_and_all_are_rewarded(self) -> None:
        spec = specification("G[0,6] G[0,4] x <= 1", {"x": (-1, 1)}, steps=8)  # tau = 5
        whole, thinned = TauMdp(spec), TauMdp(spec, every=2)
        memory = np.array([[0.1, 0.2, 0.3, 0.4, 0.5]])
        assert (thinned.memory_size, thinned.input_size) == (5, 3)
        assert thinned.inputs(memory) == pytest.approx(np.array([[0.1, 0.3, 0.5]]))
        assert TauMdp(spec, every=3).inputs(memory) == pytest.approx(np.array([[0.2, 0.5]]))
        trace = np.random.default_rng(0).uniform(-1, 1, (20, 9, 1))
        assert np.array_equal(run(whole, trace)[0], run(thinned, trace)[0], equal_nan=True)


class TestReward:
    @pytest.mark.parametrize(
        ("formula", "phi", "highest"),
        [
            (ALWAYS, "G[0,2] x <= 1", 3.0),
            ("G[0,5] (F[0,3] x >= 1 & G[1,2] y >= -0.5)", "F[0,3] x >= 1 & G[1,2] y >= -0.5", 1.5),
            ("F[0,5] G[0,2] (x >= 1 | y >= 0)", "G[0,2] (x >= 1 | y >= 0)", 3.0),
        ],
    )
    def test_is_the_exponential_of_the_robustness_of_the_history(self, formula: str, phi: str, highest: float) -> None:
        """Outer G: -exp(-beta rho / rho_max), outer F: exp(beta rho / rho_max), beta = 2; highest is rho_max."""
        trace, parsed = traces(1), stl.parse(phi)
        rewards, _ = run(TauMdp(specification(formula, BOX, steps=8), beta=2), trace)
        history = histories(trace, stl.horizon(parsed) + 1)
        sign = 1 if formula[0] == "F" else -1
        for t in range(1, 9):
            rho = stl.robustness(parsed, history[:, t], ("x", "y"))
            assert rewards[:, t] == pytest.approx(sign * np.exp(sign * 2 * rho / highest), rel=1e-5)

    def test_by_hand(self) -> None:
        # x = 0 0 3 0 0 0: the least of 1 - x over the last three samples is 1, -2, -2, -2, 1; rho_max = 3.
        rewards, _ = run(TauMdp(specification(ALWAYS, {"x": (-2, 4)}), beta=3), [0, 0, 3, 0, 0, 0])
        assert rewards[0, 1:] == pytest.approx([-math.exp(-1), *[-math.exp(2)] * 3, -math.exp(-1)], rel=1e-5)

    @pytest.mark.parametrize(("outer", "true", "false"), [("G", -math.exp(-2), -1.0), ("F", math.exp(2), 1.0)])
    def test_the_probability_form_has_the_indicator(self, outer: str, true: float, false: float) -> None:
        # of x <= 1 at each of the last three samples: 1 1 0 0 0 1; 1 <= 1 counts
        spec = specification(f"{outer}[0,6] G[0,2] x <= 1", {"x": (-2, 4)})
        rewards, _ = run(TauMdp(spec, form="probability", beta=2), [0, 0, 1, 3, 1, 0, 0])
        assert rewards[0, 1:] == pytest.approx([true, true, false, false, false, true])

    def test_what_phi_does_not_read_is_neither_remembered_nor_paid_for(self) -> None:
        # G[0,4] G[2,4] is G[0,4] G[0,2] two steps later: from sample 4 on, when three samples of 2 and later are there
        box = {"x": (-2.0, 4.0)}
        late = TauMdp(specification("G[0,4] G[2,4] x <= 1", box), beta=3)
        usual = TauMdp(specification("G[0,4] G[0,2] x <= 1", box), beta=3)
        assert (late.tau, late.memory_size, late.extension) == (3, 3, "")
        trace = np.random.default_rng(0).uniform(-2, 4, (50, 9, 1))
        rewards, memory = run(late, trace)
        expected, histories = run(usual, trace[:, 2:])
        assert np.all(rewards[:, 1:4] == 0)
        assert np.array_equal(rewards[:, 4:], expected[:, 2:])
        assert np.array_equal(memory[:, 4:], histories[:, 2:])

    @given(trace=arrays(float, (2, 9, 2), elements=st.floats(-1, 1)))
    def test_the_sum_orders_traces_as_the_least_robustness_does(self, trace: Array) -> None:
        """log-sum-exp: min rho - ln(n) rho_max / beta <= -rho_max / beta ln(sum of exp) <= min rho, n rewards.

        So of two traces whose least robustness differs by more than ln(n) rho_max / beta the better has the larger
        sum; n = 8, beta = 60, rho_max = 3: more than .104.
        """
        rewards, _ = run(TauMdp(specification(ALWAYS, BOX, steps=8), beta=60), trace)
        sums = rewards[:, 1:].sum(axis=1)
        windows = histories(trace, 3)[:, 1:, :, 0]
        least = (1 - windows).min(axis=(1, 2))
        soft = -3 / 60 * np.log(-sums)
        assert np.all(soft <= least + 1e-6)
        assert np.all(soft >= least - math.log(8) * 3 / 60 - 1e-6)
        if abs(least[0] - least[1]) > math.log(8) * 3 / 60 + 1e-3:
            assert (sums[0] > sums[1]) == (least[0] > least[1])

    @pytest.mark.parametrize(
        "formula",
        [
            ALWAYS,
            "F[0,5] G[0,2] (x >= 1 | y >= 0)",
            "G[0,5] !(F[0,3] x >= 1)",
            "F[0,5] (F[0,2] x >= 1 -> G[0,2] y >= 0)",
            # rho_1 U rho_2 at t' = t is rho_2 alone: up to 1, though rho_1 = y - .9 is at most .1
            "F[0,5] (y >= 0.9 U[0,2] y >= 0)",
        ],
    )
    def test_the_scale_is_a_bound(self, formula: str) -> None:
        method = TauMdp(specification(formula, BOX, steps=8), beta=2)
        corners = np.array(np.meshgrid([-2, 4], [-1, 1])).T.reshape(-1, 2).astype(float)
        constant = np.repeat(corners[:, None], 9, axis=1)
        rewards, _ = run(method, np.concatenate([traces(2, count=300), constant]))
        assert np.abs(rewards[:, 1:]).max() <= method.scale * (1 + 1e-5)


def test_a_formula_that_cannot_be_satisfied_is_unsuitable() -> None:
    # rho = x - 5 in [-7, -1]: rho_max is no unit to measure rho in
    with pytest.raises(Unsuitable, match=r"cannot be satisfied robustly, its rho_max is -1$"):
        TauMdp(specification("G[0,5] G[0,2] x >= 5", {"x": (-2, 4)}))


class TestSize:
    def test_the_nested_form_keeps_the_history_short(self) -> None:
        method = TauMdp(load_task("hold-disc").specification)
        assert (method.tau, method.memory_size) == (11, 22)  # G[0,10], signals x and y

    def test_absolute_intervals_need_the_whole_horizon(self) -> None:
        method = TauMdp(load_task("robot-nav").specification)
        assert (method.tau, method.input_size) == (2001, 4002)  # samples of x and y
        assert method.extension == "absolute intervals; its source has windows in F or G[0,T]"


@pytest.mark.parametrize("formula", ["G[2,9] x >= 1", "G[0,9] abs(x) <= 0.003"])
def test_a_reward_that_overflows_is_unsuitable(formula: str) -> None:
    """In the unit of a rho_max that is 0 but for rounding, or far less than rho_min."""
    with pytest.raises(Unsuitable, match="its exp overflows"):
        TauMdp(specification(formula, {"x": (-3.0, 1.0)}))
