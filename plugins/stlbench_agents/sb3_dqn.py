"""Deep Q-learning by Stable-Baselines3, on the very same environment and reward as `stlbench_agents.dqn`."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

from stlbench.contract import Environment, Policy
from stlbench_agents.policies import linear_layers
from stlbench_agents.recipes import Count, DeepQ, Whole
from stlbench_agents.sb3_agent import SB3OffPolicy
from stlbench_agents.training import grid_of

if TYPE_CHECKING:
    from stable_baselines3 import DQN


@dataclass(frozen=True, kw_only=True)
class SB3DQN(DeepQ, SB3OffPolicy):
    """Deep Q-learning as Stable-Baselines3 implements it: a cross-check of `dqn` by code that others wrote.

    Where it differs from `dqn`: Huber loss; targets of plain rewards (not weighted by 1 - gamma), so that Q is about
    1 / (1 - gamma) as large; the target network chooses the bootstrap action (no double Q-learning); no averaged
    weights; a joint head alone; exploration draws one random number for all copies, so that in a lock-step all act at
    random or none does.
    """

    algorithm_name = "DQN"
    takes_grid = True

    learning_starts: Whole = 100
    target_update_interval: Count = 1
    """transitions from one update of the target to the next, at least one step of all copies"""

    def options(self, environment: Environment) -> dict[str, Any]:
        rounded_up = max(self.target_update_interval, self.copies)  # SB3 does so too, but with a warning
        return super().options(environment) | {"target_update_interval": rounded_up}

    def exported(self, model: DQN, environment: Environment) -> Policy:
        from stlbench_agents.q_learner import GreedyPolicy, QNetwork  # imports Numba, which parameters do not need

        *hidden, (matrix, bias) = linear_layers(model.q_net.q_net)
        size, grid = environment.observation_size, grid_of(environment.actions).shape
        network = QNetwork(size, [len(layer[1]) for layer in hidden], grid, "joint")
        return GreedyPolicy(network, [*chain.from_iterable(hidden), matrix.T, bias])
