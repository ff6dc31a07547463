"""Deep Q-learning robot by robot: independent Q-learning (Tan, ICML 1993) with the learner of `dqn`.

All robots share observations and rewards, but each chooses and learns about its own actions alone. Three robots with 25
actions each have 75 outputs to learn, where their joint actions are 15,625.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stlbench.contract import ActionGrid, Actions, Array, Arrays, Cost, Environment, Integers, Policy, Transition
from stlbench_agents.dqn import DQN
from stlbench_agents.training import grid_of

if TYPE_CHECKING:
    from stlbench_agents.q_learner import GreedyPolicy, QLearner


@dataclass(frozen=True, kw_only=True)
class DQNPerRobot(DQN):
    """Deep Q-learning robot by robot, each of its own actions alone; on a task with one robot it is `dqn`."""

    def learner(self, environment: Environment, copies: int, seed: int, updates: int) -> QLearner | Team:
        grid = grid_of(environment.actions)
        if not grid.robots:
            return super().learner(environment, copies, seed, updates)
        from stlbench_agents.q_learner import QLearner  # imports Numba, which parameters do not need

        size = environment.observation_size
        return Team(
            [QLearner(self, size, copies, part, [seed, 2 + i], updates) for i, part in enumerate(grid.parts)],
            [part.size for part in grid.parts],
        )

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        grid = grid_of(actions)
        return TeamPolicy.of(arrays, grid) if grid.robots else super().restore(arrays, actions)

    def _cost(self, size: int, grid: ActionGrid, decisions: int) -> Cost:
        """The sum over the robots, each with its own network and replay."""
        each = [super(DQNPerRobot, self)._cost(size, part, decisions) for part in grid.parts]
        return Cost(sum(cost.replay for cost in each), sum(cost.update for cost in each))


class Team:
    """The learners of R robots, which act together."""

    def __init__(self, learners: Sequence[QLearner], sizes: Sequence[int]) -> None:
        self.learners, self.sizes = learners, tuple(sizes)

    def resume(self, policy: TeamPolicy) -> None:
        """Start each robot from its own network of an earlier policy."""
        for learner, own in zip(self.learners, policy.robots, strict=True):
            learner.resume(own)

    def act(self, observation: Array, epsilon: float, generator: np.random.Generator) -> Integers:
        """Joint actions (N,) at observations (N, D); each robot explores on its own, with probability `epsilon`."""
        own = [learner.act(observation, epsilon, generator) for learner in self.learners]
        return np.ravel_multi_index(own, self.sizes)

    def learn(
        self, observation: Array, action: Integers, transition: Transition, generator: np.random.Generator
    ) -> None:
        """Every robot stores the lock-step with its own part of the joint actions (N,), and updates."""
        for learner, own in zip(self.learners, np.unravel_index(action, self.sizes), strict=True):
            learner.learn(observation, own, transition, generator)

    def policy(self) -> TeamPolicy:
        return TeamPolicy([learner.policy() for learner in self.learners], self.sizes)


class TeamPolicy(Policy):
    def __init__(self, robots: Sequence[GreedyPolicy], sizes: Sequence[int]) -> None:
        self.robots, self.sizes = tuple(robots), tuple(sizes)

    def act(self, observation: Array) -> Integers:
        return np.ravel_multi_index([robot.act(observation) for robot in self.robots], self.sizes)

    def arrays(self) -> Arrays:
        return {f"{i}.{name}": part for i, robot in enumerate(self.robots) for name, part in robot.arrays().items()}

    def onnx(self) -> bytes:
        from stlbench_agents.policies import Graph

        graph = Graph()
        index = graph.joined([robot.index_in(graph) for robot in self.robots], self.sizes)
        return graph.model(self.robots[0].network.inputs, index, "index")

    @classmethod
    def of(cls, arrays: Arrays, grid: ActionGrid) -> TeamPolicy:
        from stlbench_agents.q_learner import GreedyPolicy

        own = [
            {name.removeprefix(f"{i}."): part for name, part in arrays.items() if name.startswith(f"{i}.")}
            for i in range(len(grid.parts))
        ]
        robots = [GreedyPolicy.of(part, each.shape) for part, each in zip(own, grid.parts, strict=True)]
        return cls(robots, [each.size for each in grid.parts])
