"""A formula that no episode can satisfy stops `solve` before any training, and says why."""

from __future__ import annotations

import pytest

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.solver.problem import Problem, content_of, why_impossible

BOX = {"x": (-1.0, 1.0), "y": (-8.0, 8.0)}

IMPOSSIBLE = {
    "F[0,9] x >= 2": "'x >= 2' never holds: x is from -1 to 1",
    "F[0,9] x >= 0 & G[0,9] F[0,3] x + y <= -10": "'x + y <= -10' never holds: x is from -1 to 1, y is from -8 to 8",
    "F[0,9] (x > 0.5 & x < -0.5)": "'x > 0.5 & x < -0.5' never holds: x is from -1 to 1",
    "F[0,9] x >= 2 | G[0,9] x >= 3": "'x >= 2' never holds: x is from -1 to 1; 'x >= 3' never holds: x is from -1 to 1",
    "y > 0 U[0,9] x > 2": "'x > 2' never holds: x is from -1 to 1",
    "!G[0,9] x <= 1.5": "'!x <= 1.5' never holds: x is from -1 to 1",
    "G[0,9] x > 0.1 & F[3,6] x < 0": "'x < 0' at one of samples 3 to 6 contradicts 'x > 0.1' at samples 0 to 9",
    "G[0,4] x > 0.1 & G[3,6] x < 0": "'x > 0.1' at samples 0 to 4 contradicts 'x < 0' at samples 3 to 6",
    "F[0,3] G[0,9] x > 0.1 & F[4,6] x < 0": "'x < 0' at one of samples 4 to 6 contradicts 'x > 0.1' at samples 3 to 9",
    "(x > 0.1 U[5,9] y > 7) & F[1,4] x < 0": "'x < 0' at one of samples 1 to 4 contradicts 'x > 0.1' at samples 0 to 4",
    "G[0,3] x > 0.1 & G[4,9] y < 0 & F[0,9] (x < 0 & y > 1)": (
        "'x < 0 & y > 1' at one of samples 0 to 9 contradicts 'x > 0.1' at samples 0 to 3 and 'y < 0' at samples 4 to 9"
    ),
    "G[0,9] F[0,2] x > 0.1 & G[8,12] x < 0": (
        "'x > 0.1' at one of samples 9 to 11 contradicts 'x < 0' at samples 8 to 12"
    ),
}

POSSIBLE = [
    "F[0,9] x >= 1",
    "F[0,9] x >= 2 | F[0,9] y >= 2",
    "F[0,9] x > 0.5 & F[0,9] x < -0.5",
    "G[0,3] x > 0.1 & F[0,9] x < 0",
    "F[0,4] G[0,3] x > 0.1 & F[0,9] x < 0",
    "(x > 0.1 U[5,9] y > 7) & F[1,5] x < 0",
    "G[0,9] (x > 0.1 | y > 0) & F[0,9] x < 0",
    "H[2,3] x > 2",  # nothing is before the first sample
    "x > 2 R[0,9] y > 0",
    "G[0,9] (x > 0.1 U[0,3] y > 0) & F[0,5] x < 0",
    "G[0,9] F[0,4] x > 0.1 & F[0,9] G[0,3] x < 0",
    "G[0,9] sqrt(x) > 9",  # not defined all over the box: nothing is shown
]


@pytest.mark.parametrize("text", IMPOSSIBLE)
def test_a_reason_is_said(text: str) -> None:
    assert why_impossible(stl.parse(text), BOX) == IMPOSSIBLE[text]


@pytest.mark.parametrize("text", POSSIBLE)
def test_nothing_is_said_of_a_formula_that_may_be_satisfied(text: str) -> None:
    assert why_impossible(stl.parse(text), BOX) is None


def test_a_range_that_random_actions_showed_proves_nothing() -> None:
    with pytest.raises(
        UsageError, match=r"^formula: it is impossible: 'omega >= 9' never holds: omega is from -8 to 8$"
    ):
        content_of(Problem("Pendulum-v1", "F[0,5] omega >= 9"))
    velocity = content_of(Problem("CartPole-v1", "F[0,5] v >= 1000"))["signals"]["v"]
    assert velocity["high"] < 1000
    with pytest.raises(UsageError, match="'v > 1000' at one of samples 0 to 5 contradicts 'v < -1000'"):
        content_of(Problem("CartPole-v1", "F[0,5] v > 1000 & G[0,5] v < -1000"))


@pytest.mark.parametrize(
    ("formula", "problem"),
    [
        ("x >= 0.5", "the first sample of an episode decides it, and no action changes it; say when, as in F"),
        ("O[0,5] x >= 0.5", "the first sample of an episode decides it"),
        ("G[0,9] F x >= 0.5", "F without an interval at column 8 stands inside another temporal operator"),
    ],
)
def test_a_formula_that_no_training_serves(formula: str, problem: str) -> None:
    with pytest.raises(UsageError, match=f"^formula: {problem}"):
        content_of(Problem("Pendulum-v1", formula))
