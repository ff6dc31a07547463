"""flag: counters against the meaning of the windows, and the rewards of the source by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from helpers.episodes import run, specification
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array, Unsuitable
from stlbench_methods.flag import Flag

BOX = {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}
P, Q = "x >= 0", "y >= 0"
Truth = NDArray[np.bool_]


def truths(count: int, samples: int, likely: float, seed: int) -> Array:
    """Traces (count, samples, 2) of -1 and 1, each 1 with probability `likely`."""
    return np.where(np.random.default_rng(seed).random((count, samples, 2)) < likely, 1.0, -1.0)


def window_verdicts(window: str, traces: Array) -> Truth:
    """Whether the last samples up to t satisfy `window`, (N, T + 1), by `stl.satisfied` on just those samples.

    Before a window is full, missing samples are as if the predicate had been false, the flag's start at 0.
    """
    formula = stl.parse(window)
    length = stl.horizon(formula) + 1
    padded = np.concatenate([np.full((len(traces), length - 1, 2), -1.0), traces], axis=1)
    columns = [stl.satisfied(formula, padded[:, t : t + length], ("x", "y")) for t in range(traces.shape[1])]
    return np.stack(columns, axis=1)


class TestWindows:
    """(F|G)[0,Te] of windows that end at the current sample."""

    @pytest.mark.parametrize("likely", [0.5, 0.85])
    @pytest.mark.parametrize("width", [0, 1, 2, 7])
    def test_counters_say_what_the_windows_say(self, width: int, likely: float) -> None:
        traces = truths(500, 30, likely, seed=width)
        for window in (f"F[0,{width}] {P}", f"G[0,{width}] {P}"):
            method = Flag(specification(f"G[0,9] {window}", BOX))
            _, flags = run(method, traces)
            expected = window_verdicts(window, traces)
            assert 0 < expected.mean() < 1  # both verdicts occur
            satisfied = flags[..., 0] > 0 if window[0] == "F" else flags[..., 0] == width + 1
            assert np.array_equal(satisfied, expected)
            assert np.array_equal(method.inputs(flags[0]), flags[0] / (width + 1))
            assert method.inputs(flags[:, -1]).min() >= 0
            assert method.inputs(flags[:, -1]).max() == 1

    def test_the_counters_one_by_one(self) -> None:
        """w = 2, so three samples: full at 3. p = 1 1 0 1 1 1 1 0 0 0 0."""
        trace = np.array([1, 1, -1, 1, 1, 1, 1, -1, -1, -1, -1], dtype=float)
        both = np.stack([trace, trace], axis=1)[None]
        _, flags = run(Flag(specification(f"G[0,8] (F[0,2] {P} & G[0,2] {P})", BOX)), both)
        assert flags[0, :, 0].tolist() == [3, 3, 2, 3, 3, 3, 3, 2, 1, 0, 0]
        assert flags[0, :, 1].tolist() == [1, 2, 0, 1, 2, 3, 3, 0, 0, 0, 0]

    @pytest.mark.parametrize(
        ("phi", "combine"),
        [
            ("F[0,3] x >= 0 & G[0,2] y >= 0", lambda f, g, h: f & g),
            ("F[0,3] x >= 0 | G[0,2] y >= 0", lambda f, g, h: f | g),
            ("(F[0,3] x >= 0 & G[0,2] y >= 0) | G[0,4] !(x >= 0)", lambda f, g, h: (f & g) | h),
            ("F[0,3] x >= 0 & (G[0,2] y >= 0 | G[0,4] !(x >= 0))", lambda f, g, h: f & (g | h)),
        ],
    )
    @pytest.mark.parametrize("outer", ["F", "G"])
    def test_sat_is_the_and_or_of_the_verdicts(
        self, phi: str, combine: Callable[[Truth, Truth, Truth], Truth], outer: str
    ) -> None:
        traces = truths(400, 20, 0.6, seed=1)
        leaves = [window_verdicts(text, traces) for text in ("F[0,3] x >= 0", "G[0,2] y >= 0", "G[0,4] x < 0")]
        # Where G[0,4] !p looks before the start, its flag counts nothing, so it is false there.
        leaves[2][:, :4] = False
        sat = combine(*leaves)[:, 1:]
        rewards, _ = run(Flag(specification(f"{outer}[0,9] ({phi})", BOX), beta=2), traces)
        # F: exp(beta sat) scaled by exp(-beta); G: -exp(-beta sat)
        true, false = (1.0, math.exp(-2)) if outer == "F" else (-math.exp(-2), -1.0)
        expected = np.where(sat, true, false)
        assert 0.02 < sat.mean() < 0.98
        assert rewards[:, 1:] == pytest.approx(expected)

    def test_the_flag_counts_the_first_sample(self) -> None:
        method = Flag(specification(f"G[0,4] (F[0,2] {P} & G[0,3] {P})", BOX))
        assert method.initial_memory(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.zeros(2, dtype=np.int64)).tolist() == [
            [3, 1],
            [0, 0],
        ]

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

    def test_at_the_end_the_flags_are_the_terms_satisfaction(self) -> None:
        traces = truths(500, 8, 0.6, seed=3)
        _, flags = run(Flag(self.spec), traces)
        for column, term in zip((0, 1, 2), self.spec.terms, strict=True):
            verdict = stl.satisfied(term.formula, traces, ("x", "y"))
            assert 0.1 < verdict.mean() < 0.95
            assert np.array_equal(flags[:, -1, column] == 1, verdict)

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
        assert method.initial_memory(np.array([[1.0, 1.0], [-1.0, -1.0]]), np.zeros(2, dtype=np.int64)).tolist() == [
            [1, 1],
            [0, 0],
        ]


@pytest.mark.parametrize(
    "formula", [f"{P} U[0,3] {Q}", f"F[0,3] {P} | G[0,3] {Q}", f"G[0,3] (F[0,2] {P} & F[1,2] {P})"]
)
def test_a_formula_of_neither_form_is_unsuitable(formula: str) -> None:
    with pytest.raises(Unsuitable, match="is not in the funnel fragment"):
        Flag(specification(formula, BOX))


def test_describe_says_which_form_was_taken() -> None:
    assert Flag(specification(f"G[0,4] G[0,2] {P}", BOX)).describe() == {
        "form": "outer operator over windows",
        "flags": [3],
    }
    assert Flag(specification(f"F[1,3] G[1,2] {P}", BOX)).describe() == {
        "form": "absolute intervals (extension)",
        "flags": [1, 2],
    }


def test_a_task_outside_the_sources_form_is_marked() -> None:
    assert Flag(specification(f"G[0,4] G[0,2] {P}", BOX)).extension == ""
    outside = Flag(specification(f"F[1,3] G[1,2] {P}", BOX))
    assert outside.extension == "absolute intervals; its source has windows in F or G[0,T]"
