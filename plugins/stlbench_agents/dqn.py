"""Time-aware deep Q-learning: Algorithm 2 of Saxena et al., with batched environments.

The observation contains the time, so Q(s, a, t) is an ordinary Q-function of it, and the time limit is no terminal
state. One lock-step of all copies is followed by `gradient_steps` updates, all in one compiled call.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stlbench.contract import (
    ActionGrid,
    Actions,
    Arrays,
    Cost,
    Environment,
    Policy,
    Training,
)
from stlbench_agents.compiled_code import CompiledAgent
from stlbench_agents.recipes import DQNRecipe
from stlbench_agents.training import Counterfactuals, cost_of, grid_of, report_rounds

if TYPE_CHECKING:
    from stlbench_agents.independent import Team
    from stlbench_agents.q_learner import QLearner


@dataclass(frozen=True, kw_only=True)
class DQN(DQNRecipe, CompiledAgent):
    """Deep Q-learning with a time-aware input, epsilon-greedy, replay and a target network (Algorithm 2).

    Names are those of Stable-Baselines3 where it has the option. The defaults are one recipe for all tasks that come
    with stlbench; a task file names the widths of the layers, the head and gamma, which depend on its actions and its
    time scale. The paper's Algorithm 2 to the letter is
    `dqn[double=false,n_steps=1,tau=1,target_update_interval=1000,averaging=0,copies=1]`.
    """

    search_space: ClassVar[Mapping[str, tuple[float, ...]]] = MappingProxyType(
        {
            "gamma": (0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995),
            "n_steps": (1, 3, 5, 10),
            "learning_rate": (0.0003, 0.001, 0.003),
            "hold": (5, 10, 20, 50),
        }
    )

    def train(self, training: Training) -> Policy:
        environment = training.make(self.copies)
        rounds = max(1, training.steps // (self.copies * environment.hold))
        counterfactuals = Counterfactuals(environment, self.counterfactuals, training.seed)
        learner = self.learner(environment, counterfactuals.copies, training.seed, rounds * self.gradient_steps)
        generator = np.random.default_rng([training.seed, 1])
        reports = report_rounds(rounds, training.checkpoints)
        observation = environment.reset()
        for done in range(1, rounds + 1):
            action = learner.act(observation, self._epsilon((done - 1) / rounds), generator)
            transition = environment.step(action)
            learner.learn(*counterfactuals.added(observation, action, transition), generator)
            observation = transition.observation
            if done in reports:
                final = learner.policy()
                if training.report(final, done * self.copies * environment.hold):
                    break
        return final

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        from stlbench_agents.q_learner import GreedyPolicy  # imports Numba, which parameters do not need

        return GreedyPolicy.of(arrays, grid_of(actions).shape)

    def learner(self, environment: Environment, copies: int, seed: int, updates: int) -> QLearner | Team:
        """A learner with fresh networks, for `copies` transitions a step and so many updates in all."""
        from stlbench_agents.q_learner import QLearner

        return QLearner(self, environment.observation_size, copies, grid_of(environment.actions), seed, updates)

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost | None:
        return self._cost(size, actions, decisions) if isinstance(actions, ActionGrid) else None

    def _cost(self, size: int, grid: ActionGrid, decisions: int) -> Cost:
        outputs = grid.size if self.head == "joint" else 1 + sum(grid.shape)
        return cost_of(size, self.net_arch, outputs, min(decisions, self.buffer_size))

    @property
    def compiled_part(self) -> str:
        return f"dqn-{self.head}"

    def compile(self) -> None:
        from stlbench_agents.q_learner import QLearner

        QLearner(self, 1, 1, ActionGrid(("a",), ((0.0, 1.0),)), 0, 1).compile()

    def _epsilon(self, progress: float) -> float:
        first, last, share = self.exploration_initial_eps, self.exploration_final_eps, self.exploration_fraction
        return last if progress >= share else first + (last - first) * progress / share
