"""Time-aware deep Q-learning: Algorithm 2 of Saxena et al., with batched environments.

The observation contains the time, so Q(s, a, t) is an ordinary Q-function of it, and the time limit is no terminal
state. One lock-step of all copies is followed by `gradient_steps` updates, all in one compiled call.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, Literal

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
from stlbench_agents.recipes import Count, Head, Positive, Share, ShareBelow1, Whole, Widths
from stlbench_agents.training import Counterfactuals, cost_of, grid_of, report_rounds

if TYPE_CHECKING:
    from stlbench_agents.independent import Team
    from stlbench_agents.q_learner import QLearner


@dataclass(frozen=True, kw_only=True)
class DQN(CompiledAgent):
    """Deep Q-learning with a time-aware input, epsilon-greedy, replay and a target network (Algorithm 2).

    Names are those of Stable-Baselines3 where it has the option. The defaults are one recipe for all tasks that come
    with stlbench; a task file names the widths of the layers, the head and gamma, which depend on its actions and its
    time scale. The paper's Algorithm 2 to the letter is
    `dqn[double=false,n_steps=1,tau=1,target_update_interval=1000,averaging=0,copies=1]`.
    """

    net_arch: Widths = (64, 64)
    """widths of the hidden layers"""
    head: Head = "joint"
    """`joint`: one output for each action. `additive`: V plus one term for each action axis, 35 outputs where joint
    has 273; of one axis, a dueling head (Wang et al. 2016)"""
    copies: Count = 16
    """environments in lock-step"""
    batch_size: Count = 128
    """transitions in an update"""
    buffer_size: Count = 65536
    """transitions kept for replay"""
    gradient_steps: Count = 1
    """updates after each step of all copies"""
    learning_rate: Positive = 1e-3
    """of Adam at the first update"""
    learning_rate_final: Positive = 3e-5
    """at the last update; the rate falls geometrically"""
    gamma: Share = 0.95
    """discount of a decision, that is, of `hold` steps. Rewards are weighted by 1 - gamma, so that Q keeps the scale of
    the reward; with gamma = 1 they are not"""
    n_steps: Count = 3
    """rewards in a return before it bootstraps"""
    double: bool = True
    """the online network chooses the bootstrap action (van Hasselt et al. 2016); without it the target network does, as
    in the paper"""
    tau: Share = 0.005
    """weight of the online network in an update of the target; 1 copies it, as the paper does"""
    target_update_interval: Count = 1
    """updates from one such update to the next"""
    averaging: ShareBelow1 = 0.999
    """reported policies have an exponential average of the weights, with this weight on the past at each update; 0: the
    weights themselves. Actions in training are those of the current weights"""
    exploration_initial_eps: Share = 1.0
    """probability of a random action at the start"""
    exploration_final_eps: Share = 0.05
    """what it falls to, linearly"""
    exploration_fraction: Share = 0.3
    """over this share of the budget"""
    max_grad_norm: Positive = 10.0
    """the gradient's norm is clipped to this"""
    reward_scale: Positive = 4.0
    """factor on rewards, which arrive divided by the method's `scale`"""
    time_limit: Literal["bootstrap", "terminal"] = "bootstrap"
    """`bootstrap`: what would follow the time limit has the network's value. `terminal`: it is 0"""
    counterfactuals: Whole = 1
    """so many times each transition is stored again with another memory of the method, where the method says which ones
    there are. They stand alone, as returns of one reward, and take places in the same replay"""

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
