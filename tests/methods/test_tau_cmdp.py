"""tau-cmdp: the flags of its source, shown less 1/2, and the reward of the window before."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.episodes import run, specification

from stlbench_methods.flag import Flag
from stlbench_methods.tau_cmdp import TauCmdp

BOX = {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}
X = {"x": (-1.0, 1.0)}
LOW, HIGH = -1.0, -math.exp(-2)


def test_the_trace() -> None:
    """G[0,5] F[0,1] p: f is 1 where p holds and falls by 1/2. p = 0 1 0 0 1 0 0: f = 0 1 1/2 0 1 1/2 0.

    The transition from s_t is paid for f at s_t, 0 or not; that at s_6 is not paid for.
    """
    method = TauCmdp(specification("G[0,5] F[0,1] x >= 0", X), beta=2)
    rewards, memory = run(method, [-1.0, 1, -1, -1, 1, -1, -1])
    assert method.inputs(memory[0])[:, 0].tolist() == [-0.5, 0.5, 0, -0.5, 0.5, 0, -0.5]
    assert rewards[0, 1:] == pytest.approx([LOW, HIGH, HIGH, LOW, HIGH, HIGH])


def test_of_an_outer_f() -> None:
    """F[0,5] G[0,1] p: f rises by 1/2. exp(2 (sat - 1)) for the window that ends with s_t."""
    method = TauCmdp(specification("F[0,5] G[0,1] x >= 0", X), beta=2)
    rewards, memory = run(method, [1.0, 1, -1, 1, 1, 1, -1])
    assert method.inputs(memory[0])[:, 0].tolist() == [0, 0.5, -0.5, 0, 0.5, 0.5, -0.5]
    low, high = math.exp(-2), 1.0
    assert rewards[0, 1:] == pytest.approx([low, high, low, low, high, high])


@pytest.mark.parametrize(
    "formula", ["G[0,9] (F[0,2] x >= 0 & G[0,3] y >= 0)", "F[2,5] x >= 0 & G[4,9] y >= 0 & F[0,3] G[1,2] x >= 0"]
)
def test_the_window_after_is_that_of_flag_and_the_one_before_is_a_step_late(formula: str) -> None:
    spec = specification(formula, BOX, steps=12)
    traces = np.where(np.random.default_rng(0).random((100, 13, 2)) < 0.7, 1.0, -1.0)
    expected, flags = run(Flag(spec, beta=2), traces)
    after, memory = run(TauCmdp(spec, beta=2, window="after"), traces)
    before, _ = run(TauCmdp(spec, beta=2), traces)
    assert np.array_equal(after[:, 1:], expected[:, 1:])
    assert np.array_equal(memory[..., :-1], flags)
    assert np.array_equal(before[:, 2:], expected[:, 1:-1])
    assert np.array_equal(before[:, 1], memory[:, 0, -1])
