"""What a method's author tests: the contract's rules, and rewards computed by hand."""

import numpy as np
import pytest
from stlbench_example.verdict import Verdict

from stlbench import stl
from stlbench.contract import Specification, Unsuitable


def specification(text: str) -> Specification:
    """One signal x in [-5, 5], episodes of 3 steps."""
    return Specification(stl.parse(text), signals=("x",), low=(-5.0,), high=(5.0,), steps=3, dt=0.1)


TRACES = np.array([[1, 0, 1, -1], [0, 0, 1, -1], [1, -1, 2, -1]], dtype=float)
"""Both terms of the formula below are satisfied, the second alone, the first alone."""


@pytest.mark.parametrize(
    ("pay", "expected"),
    [
        ("deadline", [[0.5, 0.5, 0], [0, 0.5, 0], [0.5, 0, 0]]),
        ("end", [[0, 0, 1], [0, 0, 0.5], [0, 0, 0.5]]),
    ],
)
def test_each_term_is_paid_when_it_is_due(pay: str, expected: list[list[float]]) -> None:
    """Rewards of three traces at once, one column a transition."""
    method = Verdict(specification("F[0,1] x >= 1 & G[1,2] x >= 0"), pay=pay)
    start = np.zeros(3, dtype=np.int64)
    memory = method.initial_memory(TRACES[:, :1], start)
    rewards, _ = method.along(TRACES.T[..., None], np.zeros((3, 1)), start, memory)
    assert np.array_equal(rewards.T, expected)


def test_a_flag_is_not_enough_for_eventually_always() -> None:
    """The message names the term."""
    with pytest.raises(Unsuitable, match=r"got F\[0,1\] G\[0,2\] x >= 0"):
        Verdict(specification("F[0,1] G[0,2] x >= 0"))
