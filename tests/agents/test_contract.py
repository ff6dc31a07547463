"""Every agent keeps the contract, spends its budget, and refuses what it cannot act on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.line_task import line

from stlbench.contract import Actions, Agent, Arrays, Policy, Training, Unsuitable
from stlbench.simulation.environment import BatchEnvironment
from stlbench.testing import check_agent
from stlbench.testing.agents import FORMS, Nearness, line_task
from stlbench_agents.dqn import DQN, DQNPerRobot
from stlbench_agents.sb3 import SB3DQN, SB3PPO, SB3SAC, SB3TD3
from stlbench_agents.td3 import TD3

GRID, BOX, ROBOTS = (line_task(form) for form in FORMS)
SMALL = "net_arch=8+6,batch_size=16"


@pytest.mark.parametrize(
    "agent",
    [
        f"dqn[{SMALL},gradient_steps=2]",
        f"dqn[{SMALL},head=additive]",
        f"dqn-per-robot[{SMALL}]",
        f"td3[{SMALL},random_steps=20]",
        f"sb3-dqn[{SMALL}]",
        f"sb3-td3[{SMALL}]",
        pytest.param(f"sb3-sac[{SMALL}]", marks=pytest.mark.slow),
        f"sb3-ppo[{SMALL},n_steps=50]",
    ],
)
def test_it_keeps_the_contract(agent: str) -> None:
    """The same seed gives the same bits; reports are frozen; a restored policy acts the same. See `check_agent`."""
    check_agent(agent)


def trained(agent: Agent, steps: int, seed: int = 2, form: Any = None) -> tuple[list[BatchEnvironment], list[Any]]:
    """The environments that an agent made, and its reports: policy and steps."""
    task = form or (GRID if isinstance(agent, DQN | SB3DQN) else BOX)
    made, reports = list[BatchEnvironment](), list[tuple[Policy, int]]()

    def make(count: int) -> BatchEnvironment:
        made.append(BatchEnvironment(task, Nearness(task.specification), count, 1))
        return made[-1]

    final = agent.train(Training(make, steps, seed, lambda *given: reports.append(given), checkpoints=4))
    assert reports[-1][0] is final
    return made, reports


TINY: dict[str, Any] = {"net_arch": (8,), "batch_size": 16}


@pytest.mark.parametrize(
    ("agent", "steps", "taken"),
    [
        (DQN(**TINY), 1610, [400, 800, 1200, 1600]),
        (DQN(**TINY), 48, [16, 32, 48]),  # as many reports as there are steps of all copies
        (DQN(**TINY), 1, [16]),
        (TD3(**TINY, copies=4, random_steps=10), 407, [100, 200, 304, 404]),
        (SB3DQN(**TINY, copies=4), 807, [200, 400, 604, 804]),
        (SB3DQN(**TINY, copies=4), 1, [4]),
        (SB3PPO(**TINY, copies=4, n_steps=16), 600, [128, 256, 448, 576]),
        # a budget of less than a rollout is one rollout: in batches of 16, while there are as many
        (SB3PPO(**TINY, copies=4, n_steps=16), 60, [48]),
        (SB3PPO(**TINY, copies=4, n_steps=16), 12, [12]),
    ],
)
def test_it_spends_the_budget_and_reports_evenly(agent: Agent, steps: int, taken: list[int]) -> None:
    (environment,), reports = trained(agent, steps)
    assert [at for _, at in reports] == taken
    assert environment.taken == taken[-1]


@pytest.mark.parametrize("agent", [DQN(**TINY, copies=4), SB3DQN(**TINY, copies=4)])
def test_an_action_that_is_held_takes_all_its_steps_from_the_budget(agent: Agent) -> None:
    (environment,), reports = trained(agent, 407, form=line(hold=2))
    assert environment.taken == reports[-1][1] == 400


@pytest.mark.parametrize("agent", [DQN(**TINY), DQNPerRobot(**TINY), TD3(**TINY, random_steps=5), SB3DQN(**TINY)])
def test_policies_change_in_training_and_with_the_seed(agent: Agent) -> None:
    """A seed may be any whole number, also one that is too large for SB3."""
    form = ROBOTS if isinstance(agent, DQNPerRobot) else None
    one, other = (trained(agent, 800, seed, form)[1] for seed in (2**62, 2**62 + 1))
    weights = [as_bytes(policy.arrays()) for policy, _ in (one[0], one[-1], other[-1])]
    assert len(set(weights)) == 3


def as_bytes(arrays: Arrays) -> bytes:
    return b"".join(np.asarray(array).tobytes() for array in arrays.values())


@pytest.mark.parametrize(
    ("agent", "form", "other", "message"),
    [
        (DQN(**TINY), GRID, ROBOTS.actions, "the policy chooses among 5 actions, the task has 3 x 3"),
        (DQN(**TINY), GRID, BOX.actions, "continuous, and this agent chooses from a grid"),
        (TD3(**TINY), BOX, GRID.actions, "are a grid, and this agent's are continuous"),
    ],
)
def test_a_policy_for_other_actions_is_refused(agent: Agent, form: Any, other: Actions, message: str) -> None:
    policy = trained(agent, 1, form=form)[1][0][0]
    with pytest.raises(Unsuitable, match=message):
        type(agent).restore(policy.arrays(), other)


@pytest.mark.parametrize("agent", [DQN(), TD3(), SB3DQN(), SB3TD3(), SB3SAC(), SB3PPO()])
def test_the_other_kind_of_actions_is_refused(agent: Agent) -> None:
    grid = isinstance(agent, DQN | SB3DQN)
    reason = "are continuous, and this agent chooses from a grid" if grid else "are a grid, and this agent's are cont"
    with pytest.raises(Unsuitable, match=f"the task's actions vx {reason}"):
        trained(agent, 100, form=BOX if grid else GRID)
