"""The samples that a formula of windows leaves unread are taken away, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench import stl
from stlbench_methods.formula_parts import from_first_read


@pytest.mark.parametrize(
    ("text", "steps", "rest"),
    [
        ("G[3,5] x >= 0", 3, "G[0,2] x >= 0"),
        ("G[3,5] x >= 0 & (F[4,9] x <= 1 | G[5,5] x >= 1)", 3, "G[0,2] x >= 0 & (F[1,6] x <= 1 | G[2,2] x >= 1)"),
        ("G[2,5] F[1,3] x >= 0", 2, "G[0,3] F[1,3] x >= 0"),
        ("G[0,5] x >= 0 & F[3,4] x >= 0", 0, "G[0,5] x >= 0 & F[3,4] x >= 0"),
        ("G[3,5] x >= 0 & x <= 1", 0, "G[3,5] x >= 0 & x <= 1"),
        ("!G[3,5] x >= 0", 0, "!G[3,5] x >= 0"),
        ("x >= 0", 0, "x >= 0"),
    ],
)
def test_by_hand(text: str, steps: int, rest: str) -> None:
    phi = stl.parse(text)
    assert from_first_read(phi) == (steps, stl.parse(rest))
    traces = np.random.default_rng(0).uniform(-1, 2, (50, 20, 1))
    whole = stl.robustness(phi, traces, ["x"])
    assert np.array_equal(whole, stl.robustness(stl.parse(rest), traces[:, steps:], ["x"]))
