"""hprs: potentials of safety and target by hand, and what their sums are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.episodes import run, specification

from stlbench.contract import Unsuitable
from stlbench.task import load_task
from stlbench.testing import check_method
from stlbench_methods.hprs import Hprs

BOX = {"x": (-4.0, 4.0)}
SINGLE = "G[0,6] x <= 2 & F[2,5] x >= 1"
TRACE = [-4.0, -1.5, 1, 3, 1, 0, -4]
"""Of it: safe but at 3; n = (x + 4) / 5 is 0 .5 1 1 1 .8 0; so Phi_T is 0 .5 1 0 1 .8 0, and Phi 1 1.5 2 0 2 1.8 1."""


class TestOneTarget:
    def test_the_trace(self) -> None:
        """1[target] is 0 1 1 1 0 0 from the second sample on; the last transition is not shaped."""
        rewards, memory = run(Hprs(specification(SINGLE, BOX)), TRACE)
        assert rewards[0, 1:] == pytest.approx([0.5, 1.5, -1, 3, -0.2, 0])
        assert memory.shape == (1, 7, 0)

    def test_discounted(self) -> None:
        """.5 * 1.5 - 1, 1 + .5 * 2 - 1.5, 1 - 2, 1 + .5 * 2, .5 * 1.8 - 2, 0."""
        rewards, _ = run(Hprs(specification(SINGLE, BOX), gamma=0.5), TRACE)
        assert rewards[0, 1:] == pytest.approx([-0.25, 0.5, -1, 2, -1.1, 0])

    def test_what_auto_shaping_pays(self) -> None:
        """Phi is 1 1 1 0 1 1 1 there: no potential of the target."""
        rewards, _ = run(Hprs(specification(SINGLE, BOX), variant="auto-shaping"), TRACE)
        assert rewards[0, 1:] == pytest.approx([0, 1, 0, 2, 0, 0])

    def test_a_violation_that_ends_the_episode(self) -> None:
        """Up to 3, which is not safe, as above; there 1[target] alone is paid, and then nothing."""
        method = Hprs(specification(SINGLE, BOX), violation="ends")
        rewards, memory = run(method, TRACE)
        assert rewards[0, 1:] == pytest.approx([0.5, 1.5, 1, 0, 0, 0])
        assert method.over(memory[0]).tolist() == [False] * 3 + [True] * 4
        assert method.inputs(memory[0]).shape == (7, 0)

    def test_the_potentials_telescope(self) -> None:
        """The sum is how often the target held, and the difference of the potentials up to the last but one sample."""
        method = Hprs(specification(SINGLE, BOX))
        x = np.random.default_rng(0).uniform(-4, 4, (200, 7, 1))
        rewards, _ = run(method, x)
        potential = (x <= 2) * (1 + np.clip((x + 4) / 5, 0, 1))
        expected = (x[:, 1:] >= 1).sum(axis=1) + potential[:, -2] - potential[:, 0]
        assert rewards[:, 1:].sum(axis=1) == pytest.approx(expected[:, 0])

    def test_from_above(self) -> None:
        """n(x <= 2) = 1 - (x - 2) / (4 - 2): from 4, 3 and 2 it is 0, .5 and 1."""
        rewards, _ = run(Hprs(specification("F[0,3] x <= 2", BOX)), [4.0, 3, 2, 2])
        assert rewards[0, 1:] == pytest.approx([0.5, 1.5, 1])


class TestSeveralTargets:
    """F[2,9] G[0,1] x >= 2, by step 10, comes after F[0,3] x <= -2, in whatever order they are written."""

    formula = "F[2,9] G[0,1] x >= 2 & F[0,3] x <= -2 & G[0,10] x <= 3"

    def test_the_order_is_that_of_the_deadlines(self) -> None:
        method = Hprs(specification(self.formula, BOX))
        targets = ["F[0,3] x <= -2", "F[2,9] G[0,1] x >= 2"]
        assert method.describe() == {"safety": ["G[0,10] x <= 3"], "targets": targets}

    def test_the_trace(self) -> None:
        """x = 4 1 -2 -1 2 2 2 0 2 3.5 2; n of the first target (4 - x) / 6, of the second (x + 4) / 6.

        At -2 the first is done, and n of the second is 1/3 there. Phi: 0 (unsafe), 1 + .5, 1 + 1 + 1/3, 1 + 1 + .5,
        then 3 at 2; 2 + 2/3 at 0; 0 at 3.5. The last target stays, however long it holds.
        """
        trace = [4.0, 1, -2, -1, 2, 2, 2, 0, 2, 3.5, 2]
        rewards, memory = run(Hprs(specification(self.formula, BOX, steps=11)), [*trace, 2])
        third = 1 / 3
        expected = [1.5, 1 + 5 * third / 2, third / 2, 1.5, 1, 1, -third, 1 + third, 1 - 3, 1 + 3, 1]
        assert rewards[0, 1:] == pytest.approx(expected)
        assert memory[0, :, 0].tolist() == [0, 0, *[1] * 10]
        assert memory[0, :, 1].tolist() == [0, 0, 0, 0, 1, 2, 2, 0, 1, 2, 2, 2]

    def test_the_first_sample_counts(self) -> None:
        method = Hprs(specification(self.formula, BOX))
        zero = np.zeros(2, dtype=np.int64)
        memory = method.initial_memory(np.array([[-3.0], [0.0]]), zero)
        assert memory.tolist() == [[1, 0], [0, 0]]
        assert method.inputs(np.array([[1.0, 1.0], [0.0, 0.0]])).tolist() == [[1, 0.5], [0, 0]]


def test_a_later_g_as_a_target() -> None:
    """robot-nav: 401 samples in a row near one place, then near the other. Both G are safety otherwise."""
    task = load_task("robot-nav").specification
    with pytest.raises(Unsuitable, match=r"needs a target, F or F G.*hprs\[later=target\]"):
        Hprs(task)
    method = Hprs(task, later="target")
    assert (method.floor, method.scale, method.input_size) == (-2, 3, 2)
    here = np.tile([25.0, 25.0], (402, 1, 1))
    _, memory = method.along(here, np.zeros((1, 2)), np.zeros(1, dtype=np.int64), np.zeros((1, 2)))
    assert memory.tolist() == [[1, 0]]


@pytest.mark.parametrize("task", ["reach-stay", "either-or", "dwell"])
@pytest.mark.parametrize("options", [{}, {"variant": "auto-shaping"}, {"gamma": 0.9}, {"violation": "ends"}], ids=str)
def test_the_contract_is_kept(options: dict[str, Any], task: str) -> None:
    check_method(lambda specification: Hprs(specification, **options), task)  # type: ignore[arg-type]
