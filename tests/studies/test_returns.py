"""`studies/returns.py`: the discounted return along a recorded trace, by the rules of training, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.line_task import Probe, line
from helpers.studies import load

returns = load("returns")

TRACE = np.array([[0, 0.5, 1, 1.5, 2, 2, 2, 2, 2.0]])[..., None]
"""Rewards 100 t + 10 x_{t+1} + x_t: 5, 110.5, 216, 321.5, and 100 t + 22 from t = 4 on."""


@pytest.mark.parametrize(
    ("training", "expected"),
    [
        ({}, (5 + 110.5 + 216 + 321.5) / 4 + 0.5 * 572),
        ({"cuts": [4]}, (5 + 110.5 + 216 + 321.5) / 4),
        ({"ends": [{"where": "x >= 2"}]}, -0.5 / (1 - 0.5)),  # the floor, as if for ever, in the first decision
    ],
)
def test_by_hand(training: dict[str, object], expected: float) -> None:
    task = line(hold=4, training=training)
    found = returns.discounted(task, Probe(task.specification), TRACE, 0.5)
    assert found.tolist() == pytest.approx([expected])
