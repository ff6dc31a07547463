"""bhnr: the value of the newest samples, by hand and against the robustness of the samples cut out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.episodes import run, specification

from stlbench import stl
from stlbench.contract import RewardMethod
from stlbench_methods.bhnr import Bhnr

BOX = {"x": (-3.0, 3.0)}


def paid(method: RewardMethod, trace: list[float]) -> list[float]:
    return [float(reward) for reward in run(method, trace)[0][0, 1:]]


def test_sliding_by_hand() -> None:
    """H = 2: F of steps 1 to 3, margins x - 1; G of steps 3 to 5, margins 2 - x. Both count at step 3."""
    spec = specification("F[1,3] x >= 1 & G[3,5] x <= 2", BOX, steps=6)
    trace = [3.0, 0.0, 0.5, 1.5, -1.0, 2.5, 0.0]
    # -1 alone, since the sample 3.0 is before the first step; -.5; min(.5, .5); min(.5, 3); min(3, -.5); nothing
    assert paid(Bhnr(spec, window=2), trace) == pytest.approx([-1, -0.5, 0.5, 0.5, -0.5, 0])


def test_blocks_by_hand() -> None:
    """G[0,7] x <= 2 in blocks of 3: samples 1-3, 4-6, and 7, which is too short. Least 2 - x: .5 and -1, 3 times."""
    spec = specification("G[0,7] x <= 2", BOX)
    trace = [3.0, 0.0, 1.5, 1.0, 3.0, 0.0, 0.0, 3.0]
    assert paid(Bhnr(spec, mode="block", window=3), trace) == pytest.approx([0, 0, 1.5, 0, 0, -3, 0])


def test_an_operator_of_one_sample_counts_in_its_block() -> None:
    """Blocks of 3: samples 1-3, 4-6, 7-9. The margin 2 - x is .75 at 4 and .5 at 5 and 9; 3 - x is at most 2."""
    trace = [0, 1, 1, 1, 1.25, 1.5, 1, 1, 1, 1.5]
    for text, expected in [
        ("F[5,5] x <= 2", [0, 0, 0, 0, 0, 1.5, 0, 0, 0]),
        ("G[5,5] x <= 2 & F[4,4] G[0,0] x <= 2", [0, 0, 0, 0, 0, 1.5, 0, 0, 0]),
        ("G[4,4] x <= 2 | G[9,9] x <= 2", [0, 0, 0, 0, 0, 2.25, 0, 0, 1.5]),
        ("G[5,5] x <= 2 & F[0,9] x <= 3", [0, 0, 6, 0, 0, 1.5, 0, 0, 6]),
        ("G[0,0] x <= 2", [0] * 9),
    ]:
        method = Bhnr(specification(text, BOX, steps=9), mode="block", window=3)
        assert paid(method, trace) == pytest.approx(expected), text


def test_the_last_block_may_be_short() -> None:
    """Blocks of 4 in 7 steps: 4 samples, and 3 samples, worth 2 - x = 1 each."""
    spec = specification("G[0,7] x <= 2", BOX)
    assert paid(Bhnr(spec, mode="block", window=4), [1.0] * 8) == pytest.approx([0, 0, 0, 4, 0, 0, 3])


@pytest.mark.parametrize(("semantics", "expected"), [("filtering", 1 / 3), ("filtering-sum", 1.0)])
def test_filtering_by_hand(semantics: str, expected: float) -> None:
    """H = 3. F x >= 1 is true of one of the last three samples at steps 3 and 4: a third, or one. G holds: 1."""
    spec = specification("F[0,4] x >= 1 & G[0,4] x <= 2", BOX)
    method = Bhnr(spec, window=3, semantics=semantics)  # type: ignore[arg-type]
    assert paid(method, [0, 0, 0, 1.5, 0]) == pytest.approx([0, 0, expected, expected])
    assert paid(method, [0, 0, 0, 3, 0]) == [0, 0, 0, 0]  # G fails at step 3


def test_agm_by_hand() -> None:
    """G x <= 2 over 5, H = 2: of .4 and .2 sqrt(1.4 * 1.2) - 1; of .2 and -.2 the mean of min(x, 0)."""
    found = paid(Bhnr(specification("G[0,2] x <= 2", BOX), window=2, semantics="agm"), [0, 1, 3])
    assert found == pytest.approx([math.sqrt(1.4 * 1.2) - 1, -0.1], abs=1e-5)


@pytest.mark.parametrize("formula", ["G[0,12] F[0,3] x >= 1", "F[0,12] (G[0,2] x >= 0 | F[0,3] x <= -1)"])
@pytest.mark.parametrize("window", [1, 4, 7])
def test_an_operator_from_the_start_is_that_of_the_samples_cut_out(formula: str, window: int) -> None:
    spec = specification(formula, BOX)
    traces = np.random.default_rng(3).integers(-12, 13, (60, spec.steps + 1, 1)) / 4
    found, _ = run(Bhnr(spec, window=window), traces)
    for t in range(1, spec.steps + 1):
        cut = traces[:, max(0, t - window + 1) : t + 1]
        expected = stl.robustness(spec.formula, cut, spec.signals, policy="clip")
        assert found[:, t] == pytest.approx(expected, abs=1e-5)


def test_a_known_trap_g_f_of_two_places() -> None:
    """At the newest sample F[0,9] A & F[0,9] B is A & B there: whoever goes back and forth is paid a violation."""
    spec = specification("G[0,20] (F[0,9] x >= 1 & F[0,9] x <= -1)", BOX)
    trace = [(-1.0) ** i * 2 for i in range(spec.steps + 1)]
    assert stl.robustness(spec.formula, np.array(trace)[:, None], ["x"]) > 0
    assert max(paid(Bhnr(spec), trace)) < 0


def test_what_the_policy_sees_and_the_scale() -> None:
    """Margins x - 1 in [-4, 2] and 2 - x in [-1, 5], each of four samples; x = -3 is their least and greatest."""
    method = Bhnr(specification("F[1,3] x >= 1 & G[3,5] x <= 2", BOX, steps=6), window=4)
    assert (method.memory_size, method.input_size) == (8, 8)
    assert (method.scale, method.floor) == pytest.approx((5, -4), abs=1e-5)
    _, memory = run(method, [-3.0, 0, 0, 0, 3, 3, 3])
    assert method.inputs(memory[0, :1])[0] == pytest.approx([-1] * 4 + [1] * 4, abs=1e-5)
    assert method.inputs(memory[0, 4:5])[0, :4] == pytest.approx([0, 0, 0, 1], abs=1e-5)
    assert Bhnr(specification("G[0,5] x <= 2", BOX), mode="block", window=4).scale == pytest.approx(20, abs=1e-4)
