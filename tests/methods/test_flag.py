"""flag: counters against the meaning of the windows, and the rewards of the source by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.episodes import run, specification
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench.contract import Array, Unsuitable
from stlbench_methods.flag import Flag

BOX = {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}
P, Q = "x >= 0", "y >= 0"
SOURCE = "its source has windows in F or G[0,T]"
Truth = NDArray[np.bool_]


def truths(count: int, samples: int, likely: float, seed: int) -> Array:
    """Traces (count, samples, 2) of -1 and 1, each 1 with probability `likely`."""
    return np.where(np.random.default_rng(seed).random((count, samples, 2)) < likely, 1.0, -1.0)


class TestWindows:
    """(F|G)[0,Te] of windows that end at the current sample."""

    def test_the_counters_one_by_one(self) -> None:
        """w = 2, so three samples: full at 3. p = 1 1 0 1 1 1 1 0 0 0 0."""
        trace = np.array([1, 1, -1, 1, 1, 1, 1, -1, -1, -1, -1], dtype=float)
        both = np.stack([trace, trace], axis=1)[None]
        _, flags = run(Flag(specification(f"G[0,8] (F[0,2] {P} & G[0,2] {P})", BOX)), both)
        assert flags[0, :, 0].tolist() == [3, 3, 2, 3, 3, 3, 3, 2, 1, 0, 0]
        assert flags[0, :, 1].tolist() == [1, 2, 0, 1, 2, 3, 3, 0, 0, 0, 0]

    def test_the_flag_counts_the_first_sample(self) -> None:
        method = Flag(specification(f"G[0,4] (F[0,2] {P} & G[0,3] {P})", BOX))
        begun = method.initial_memory(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.zeros(2, dtype=np.int64))
        assert begun.tolist() == [[3, 1], [0, 0]]

    def test_the_nested_form_of_a_task_is_read(self) -> None:
        """G[0,4] G[0,2] p: reward -exp(-beta) from the third p in a row, beta = 50; else -1."""
        method = Flag(specification(f"G[0,6] {P}", {"x": (-1, 1)}, nested=f"G[0,4] G[0,2] {P}"))
        rewards, _ = run(method, [1, 1, 1, 1, -1, 1, 1])
        almost_0 = -math.exp(-50)
        assert rewards[0, 1:].tolist() == [-1, almost_0, almost_0, -1, -1, -1]
        assert (method.memory_size, method.scale) == (1, 1)

    @pytest.mark.parametrize("outer", ["F", "G"])
    def test_windows_that_begin_late_count_and_pay_from_there_on(self, outer: str) -> None:
        """G[3,5] and F[4,8] at s are G[0,2] and F[1,5] at s + 3; with F[3,8], F[0,5]. Sample 3 is their first."""
        phi = "(G[{},{}] x >= 0 & F[{},{}] y >= 0)"
        late = Flag(specification(f"{outer}[0,4] {phi.format(3, 5, 3, 8)}", BOX))
        usual = Flag(specification(f"{outer}[0,4] {phi.format(0, 2, 0, 5)}", BOX))
        traces = truths(200, 13, 0.6, seed=5)
        rewards, flags = run(late, traces)
        expected, counted = run(usual, traces[:, 3:])
        assert np.all(rewards[:, 1:3] == 0)
        assert np.array_equal(rewards[:, 4:], expected[:, 1:])
        assert np.array_equal(flags[:, 3:], counted)
        assert (late.extension, usual.extension) == ("windows begin 3 steps late; its source has them from 0", "")


def brute_force(traces: Array) -> tuple[Truth, Truth, Truth]:
    """For F[2,4] p, G[1,3] q and F[1,3] G[1,2] p: what is known of each after sample t, (N, T + 1) each.

    F: psi held at a step of [2,4] up to t. G: psi did not fail at a step of [1,3] up to t. F G: there is a step t' in
    [1,3] with psi at t' + 1 and t' + 2, both up to t.
    """
    p, q = traces[..., 0] >= 0, traces[..., 1] >= 0
    samples = traces.shape[1]
    eventually = [p[:, 2 : min(t, 4) + 1].any(axis=1) for t in range(samples)]
    always = [q[:, 1 : min(t, 3) + 1].all(axis=1) for t in range(samples)]
    both = [
        np.any([p[:, s + 1] & p[:, s + 2] for s in (1, 2, 3) if s + 2 <= t] + [np.zeros(len(p), bool)], axis=0)
        for t in range(samples)
    ]
    return np.stack(eventually, axis=1), np.stack(always, axis=1), np.stack(both, axis=1)


class TestAbsoluteIntervals:
    """The extension to eq. 2: F[2,4] p & G[1,3] q & F[1,3] G[1,2] p, the last observed at steps 2..5."""

    formula = f"F[2,4] {P} & G[1,3] {Q} & F[1,3] G[1,2] {P}"
    spec = specification(formula, BOX, steps=7)

    @given(bits=st.lists(st.booleans(), min_size=16, max_size=16))
    def test_flags_against_the_definition(self, bits: list[bool]) -> None:
        traces = np.where(bits, 1.0, -1.0).reshape(1, 8, 2)
        _, flags = run(Flag(self.spec), traces)
        assert flags.shape == (1, 8, 4)  # one flag for F and G each, a latch and a counter for F G
        for column, expected in zip((0, 1, 2), brute_force(traces), strict=True):
            assert np.array_equal(flags[..., column], expected)

    def test_the_reward_is_the_sum_over_the_intervals_of_now(self) -> None:
        """beta = 1; p only at 3 and 4, q until 2. Paid: F e^(sat-1) at 2..4, G -e^(-sat) at 1..3, F G as F at 2..5."""
        p, q = [0, 0, 0, 1, 1, 0, 0, 0], [1, 1, 1, 0, 0, 0, 0, 0]
        rewards, _ = run(Flag(self.spec, beta=1), 2.0 * np.array([p, q]).T[None] - 1)
        e = math.exp(-1)
        expected = [
            -e,  # t = 1: G holds so far
            e - e + e,  # t = 2: F not yet, G holds, F G not yet
            1 - 1 + e,  # t = 3: F latched, G lost, F G has seen one p of two
            1 + 1,  # t = 4: F, F G latched
            1,  # t = 5: F G alone
            0,
            0,
        ]
        assert rewards[0, 1:] == pytest.approx(expected)

    def test_scale_inputs_and_start(self) -> None:
        method = Flag(self.spec)
        assert method.scale == 3  # at steps 2 and 3 all three intervals last
        _, flags = run(method, truths(200, 8, 0.7, seed=4))
        inputs = method.inputs(flags.reshape(-1, 4))
        assert inputs.min() == 0
        assert inputs.max(axis=0).tolist() == [1, 1, 1, 1]
        # no interval includes step 0, so the flags are as they were: G true until it fails
        assert method.initial_memory(np.array([[1.0, -1.0]]), np.zeros(1, dtype=np.int64)).tolist() == [[0, 1, 0, 0]]

    def test_the_first_sample_counts_where_an_interval_includes_it(self) -> None:
        method = Flag(specification(f"F[0,2] {P} & G[0,2] {Q}", BOX))
        begun = method.initial_memory(np.array([[1.0, 1.0], [-1.0, -1.0]]), np.zeros(2, dtype=np.int64))
        assert begun.tolist() == [[1, 1], [0, 0]]


@pytest.mark.parametrize(
    "formula", [f"{P} U[0,3] {Q}", f"F[0,3] {P} | G[0,3] {Q}", f"G[0,3] (F[0,2] {P} & F[1,2] {P})"]
)
def test_a_formula_of_neither_form_is_unsuitable(formula: str) -> None:
    with pytest.raises(Unsuitable, match="is not in the funnel fragment"):
        Flag(specification(formula, BOX))


@pytest.mark.parametrize(
    ("formula", "form", "flags", "extension"),
    [
        ("G[0,4] G[0,2]", "outer operator over windows", [3], ""),
        ("F[1,3] G[1,2]", "absolute intervals (extension)", [1, 2], f"absolute intervals; {SOURCE}"),
    ],
)
def test_it_says_which_form_was_taken(formula: str, form: str, flags: list[int], extension: str) -> None:
    method = Flag(specification(f"{formula} {P}", BOX))
    assert method.describe() == {"form": form, "flags": flags}
    assert method.extension == extension
