"""What a method ends, and a step once more with another memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.latch import Latch
from helpers.line_task import line

from stlbench.contract import Event
from stlbench.simulation.environment import BatchEnvironment

UP, STAY, DOWN = 2, 1, 0
VIOLATED = {"where": "violation"}


def latched(at: list[float], **training: Any) -> BatchEnvironment:
    """Two steps of 0.5 m a decision, T = 8; the next episodes begin at 0."""
    task = line(hold=2, training={"starts": {"box": {"x": 0}}, **training})
    environment = BatchEnvironment(task, Latch(task.specification), len(at), seed=0)
    environment.reset()
    environment.simulator.reset(np.array(at)[:, None])
    environment._seen = environment.simulator.observe()
    return environment


class TestOver:
    def test_an_episode_ends_there_and_is_paid_once(self) -> None:
        """From 0: .5 and 1, so .05 and 1, their mean over 2. From -1: -.5 and 0. Observed: x, t, the time, memory."""
        transition = latched([0.0, -1.0]).step(np.array([UP, UP]))
        assert transition.reward == pytest.approx([1.05 / 4, -0.05 / 4])
        assert transition.discount.tolist() == [0, 1]
        assert transition.ended.tolist() == transition.cut.tolist() == [True, False]
        assert transition.event.tolist() == [Event.OVER, Event.GOES_ON]
        assert transition.arrived.tolist() == [[1, 2, -0.5, 1], [0, 2, -0.5, 0]]
        assert transition.observation.tolist() == [[0, 0, -1, 0], [0, 2, -0.5, 0]]

    def test_an_end_by_the_task_pays_the_floor_once(self) -> None:
        """G[0,4] x <= 1 is violated at 1.5: the floor, -1 over 2. It counts, and not that the latch closed."""
        transition = latched([0.5, 0.0], ends=[VIOLATED]).step(np.array([UP, UP]))
        assert transition.reward == pytest.approx([-0.5, 1.05 / 4])
        assert transition.event.tolist() == [Event.OVER, Event.OVER]


class Chance(np.random.Generator):
    """Gives numbers that were chosen."""

    def __init__(self, *numbers: float) -> None:
        super().__init__(np.random.PCG64(0))
        self.numbers = np.array(numbers)

    def random(self, size: Any = None, *_: Any, **__: Any) -> Any:
        return self.numbers.reshape(size)


class TestCounterfactual:
    def test_a_step_with_the_other_memory(self) -> None:
        """Closed before, nothing is paid and all is over; open, as it was. Only the last column differs."""
        environment = latched([0.0, -1.0, -1.0])
        real = environment.step(np.array([UP, UP, UP]))
        seen, other = environment.counterfactual(Chance(0.2, 0.3, 0.7))
        assert seen.tolist() == [[0, 0, -1, 0], [-1, 0, -1, 0], [-1, 0, -1, 1]]
        assert other.reward == pytest.approx([1.05 / 4, -0.05 / 4, 0])
        assert other.reward[:2].tolist() == real.reward[:2].tolist()
        assert other.arrived.tolist() == [[1, 2, -0.5, 1], [0, 2, -0.5, 0], [0, 2, -0.5, 1]]
        assert other.event.tolist() == [Event.OVER, Event.CUT, Event.OVER]

    def test_an_open_latch_where_it_had_closed(self) -> None:
        """At 1, closed from the start: nothing follows. Open, the step down to 0 is paid .05 and 0, and goes on."""
        environment = latched([1.0])
        assert environment.step(np.array([DOWN])).discount.tolist() == [0]
        seen, other = environment.counterfactual(Chance(0.1))
        assert seen.tolist() == [[1, 0, -1, 0]]
        assert other.reward == pytest.approx([0.05 / 4])
        assert (other.discount.tolist(), other.ended.tolist()) == ([1], [False])
        assert other.arrived.tolist() == [[0, 2, -0.5, 0]]

    def test_it_costs_no_step_and_changes_no_episode(self) -> None:
        first, second = latched([0.0, -1.0]), latched([0.0, -1.0])
        for action in (UP, STAY, DOWN, UP, UP):
            one, other = first.step(np.array([action] * 2)), second.step(np.array([action] * 2))
            first.counterfactual(np.random.default_rng(1))
            assert one.observation.tolist() == other.observation.tolist()
            assert one.reward.tolist() == other.reward.tolist()
        assert first.taken == second.taken == 20

    def test_the_time_limit_is_one_for_every_memory(self) -> None:
        environment = latched([-1.0])
        for _ in range(4):
            environment.step(np.array([STAY]))
        _, other = environment.counterfactual(Chance(0.1))
        assert (other.ended.tolist(), other.discount.tolist()) == ([True], [1])

    def test_what_the_task_ends_is_the_same_step_again(self) -> None:
        environment = latched([0.5, -1.0], ends=[VIOLATED])
        real = environment.step(np.array([UP, UP]))
        seen, other = environment.counterfactual(Chance(0.9, 0.9))
        assert seen.tolist() == [[0.5, 0, -1, 0], [-1, 0, -1, 1]]
        assert other.reward[0] == real.reward[0] == -0.5
        assert (other.discount.tolist(), other.ended.tolist()) == ([0, 0], [True, True])
