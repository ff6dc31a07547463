"""What agents say that training costs, against times that were measured, and by hand."""

from __future__ import annotations

import math

import pytest

from stlbench.contract import ActionBox, ActionGrid
from stlbench_agents.dqn import DQN, DQNPerRobot
from stlbench_agents.td3 import TD3
from stlbench_agents.training import cost_of

GRID = ActionGrid(("v", "w"), (tuple(range(21)), tuple(range(13))), (1, 1))
BOX = ActionBox(("a", "b"), (-1.0, -1.0), (1.0, 1.0))

MICROSECONDS = {
    ("dqn", 64): {16: 98, 64: 127, 256: 227, 603: 392, 1000: 565, 3000: 1360, 6000: 2913},
    ("dqn", 128): {16: 210, 64: 259, 256: 419, 603: 698, 1000: 992, 3000: 2563, 6000: 5967},
    ("td3", 64): {16: 115, 64: 163, 256: 354, 603: 637, 1000: 981, 3000: 2885},
    ("td3", 128): {16: 349, 64: 436, 256: 757, 603: 1288, 1000: 2150, 3000: 6839},
}
"""CPU time of an update, by agent, width of both layers and number of inputs."""


def test_by_hand() -> None:
    """3 x 4 + 4 x 5 + 5 x 2 products, 11 units; 100 transitions of 3 numbers twice, 4 bytes each."""
    assert cost_of(3, (4, 5), 2, 100) == (100 * 3 * 2 * 4, 42 + 40 * 11)


@pytest.mark.parametrize(("agent", "width"), MICROSECONDS)
def test_ratios_are_those_of_measured_times(agent: str, width: int) -> None:
    arch = (width, width)

    def work(size: int) -> float:
        made = DQN(net_arch=arch, head="additive") if agent == "dqn" else TD3(net_arch=arch)
        cost = made.cost(size, GRID if agent == "dqn" else BOX, 1)
        assert cost is not None
        return cost.update

    times = MICROSECONDS[agent, width]
    for size, time in times.items():
        assert math.log(work(size) / work(16)) == pytest.approx(math.log(time / times[16]), abs=math.log(1.45))


def test_the_replay_is_as_large_as_the_budget_needs_and_no_larger_than_its_rows() -> None:
    agent = DQN(buffer_size=1000)
    few, many = agent.cost(10, GRID, 300), agent.cost(10, GRID, 10**6)
    assert few is not None
    assert many is not None
    assert (few.replay, many.replay) == (300 * 80, 1000 * 80)
    assert TD3(buffer_size=500).cost(10, BOX, 10**6).replay == 500 * (10 + 2) * 8


def test_robots_cost_as_much_as_all_their_networks() -> None:
    each = [DQN().cost(10, part, 300) for part in GRID.parts]
    team = DQNPerRobot().cost(10, GRID, 300)
    assert team is not None
    assert team.replay == sum(cost.replay for cost in each if cost)
    assert team.update == sum(cost.update for cost in each if cost)


def test_actions_that_an_agent_cannot_train_have_no_cost() -> None:
    assert DQN().cost(10, BOX, 300) is None
