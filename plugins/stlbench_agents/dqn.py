"""Time-aware deep Q-learning: Algorithm 2 of Saxena et al., with batched environments; and robot by robot, as
independent Q-learning (Tan, ICML 1993).

The observation contains the time, so Q(s, a, t) is an ordinary Q-function of it, and the time limit is no terminal
state. One lock-step of all copies is followed by `gradient_steps` updates, all in one compiled call.

Robot by robot, all robots share observations and rewards, but each chooses and learns about its own actions alone.
Three robots with 25 actions each have 75 outputs to learn, where their joint actions are 15,625.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from stlbench.contract import ActionGrid, Actions, Array, Arrays, Cost, Environment, Integers, Policy, Transition
from stlbench_agents import training
from stlbench_agents.policies import Graph, Head

if TYPE_CHECKING:
    from stlbench_agents.q_learner import QLearner
    from stlbench_agents.q_policy import GreedyPolicy


_RESUMED = 0.2
"""The probability of a random action, at most, of a training that starts from an earlier policy: it knows already."""


@dataclass(frozen=True, kw_only=True)
class DQN(training.DeepQ, training.LockStepAgent):
    """Deep Q-learning with a time-aware input, epsilon-greedy, replay and a target network (Algorithm 2).

    The defaults are one recipe for all tasks that come with stlbench. A task file names the widths of the layers, the
    head and gamma, which depend on its actions and its time scale. The paper's Algorithm 2 to the letter is
    `dqn[double=false,n_steps=1,tau=1,target_update_interval=1000,averaging=0,copies=1]`.
    """

    head: Head = "joint"
    """`joint`: one output for each action. `additive`: V plus one term for each action axis, 35 outputs where joint
    has 273; of one axis, a dueling head (Wang et al. 2016)"""
    double: bool = True
    """the online network chooses the bootstrap action (van Hasselt et al. 2016); without it the target network does, as
    in the paper"""
    averaging: training.ShareBelow1 = 0.999
    reward_scale: training.Positive = 4.0
    bounded: bool = False
    """targets are kept within the rewards that were seen, as a value is a weighted mean of rewards. Without it, values
    of states far from all goals can grow without end"""
    time_limit: Literal["bootstrap", "terminal"] = "bootstrap"
    """`bootstrap`: what would follow the time limit has the network's value. `terminal`: it is 0"""

    recipe = MappingProxyType(
        {
            **training.SHARED,
            "gamma": 0.9,
            "head": "additive",
            "copies": 64,
            "gradient_steps": 4,
            "n_steps": 5,
            "buffer_size": 131072,
            "averaging": 0.9995,
            "exploration_final_eps": 0.02,
            "reward_scale": 10.0,
            "bounded": True,
        }
    )
    preference = MappingProxyType({"grid": 1})
    search_space: ClassVar[Mapping[str, tuple[float, ...]]] = MappingProxyType(
        {
            "gamma": (0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995),
            "n_steps": (1, 3, 5, 10),
            "learning_rate": (0.0003, 0.001, 0.003),
            "hold": (5, 10, 20, 50),
        }
    )

    def begin(self, environment: Environment, seed: int, rounds: int) -> training.LockStepLearner:
        return _Trainee(self, environment, seed, rounds)

    def learner(self, environment: Environment, copies: int, seed: int, updates: int) -> QLearner | Team:
        """A learner with fresh networks, for `copies` transitions a step and so many updates in all."""
        from stlbench_agents.q_learner import QLearner  # imports Numba, which parameters do not need

        return QLearner(
            self, environment.observation_size, copies, training.grid_of(environment.actions), seed, updates
        )

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost | None:
        return self._cost(size, actions, decisions) if isinstance(actions, ActionGrid) else None

    def _cost(self, size: int, grid: ActionGrid, decisions: int) -> Cost:
        outputs = grid.size if self.head == "joint" else 1 + sum(grid.shape)
        return training.cost_of(size, self.net_arch, outputs, min(decisions, self.buffer_size))

    @property
    def compiled_part(self) -> str:
        return f"dqn-{self.head}"

    def compile(self) -> None:
        from stlbench_agents.q_learner import QLearner

        QLearner(self, 1, 1, ActionGrid(("a",), ((0.0, 1.0),)), 0, 1).compile()

    def exploration(self, progress: float) -> float:
        """The probability of a random action after this share of the budget."""
        first, last, share = self.exploration_initial_eps, self.exploration_final_eps, self.exploration_fraction
        return last if progress >= share else first + (last - first) * progress / share


class _Trainee:
    """The learner of a recipe with its exploration, and with counterfactual transitions beside the real ones."""

    def __init__(self, recipe: DQN, environment: Environment, seed: int, rounds: int) -> None:
        self._recipe, self._rounds, self._done = recipe, rounds, 0
        self._counterfactuals = training.Counterfactuals(environment, seed)
        updates = rounds * recipe.gradient_steps
        self._learner = recipe.learner(environment, self._counterfactuals.copies, seed, updates)
        self._generator = np.random.default_rng([seed, 1])
        self._most = self._epsilon = 1.0

    def resume(self, policy: Any) -> None:
        self._learner.resume(policy)
        self._most = _RESUMED

    def go_on(self, earlier: Arrays) -> bool:
        if not self._learner.go_on(earlier):
            return False
        self._most = float(earlier["epsilon"])
        return True

    def kept(self) -> Arrays:
        return {**self._learner.kept(), "epsilon": np.array(self._epsilon)}

    def act(self, observation: Array) -> Integers:
        self._epsilon = min(self._most, self._recipe.exploration(self._done / self._rounds))
        self._done += 1
        return self._learner.act(observation, self._epsilon, self._generator)

    def learn(self, observation: Array, action: Integers, transition: Transition) -> None:
        self._learner.learn(*self._counterfactuals.added(observation, action, transition), self._generator)

    def policy(self) -> Policy:
        return self._learner.policy()


@dataclass(frozen=True, kw_only=True)
class DQNPerRobot(DQN):
    """Deep Q-learning robot by robot, each of its own actions alone; on a task with one robot it is `dqn`."""

    preference = MappingProxyType({"robots": 1})

    def learner(self, environment: Environment, copies: int, seed: int, updates: int) -> QLearner | Team:
        grid = training.grid_of(environment.actions)
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
        grid = training.grid_of(actions)
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

    def kept(self) -> Arrays:
        return {f"{i}.{name}": part for i, each in enumerate(self.learners) for name, part in each.kept().items()}

    def go_on(self, earlier: Arrays) -> bool:
        return all(
            learner.go_on(own) for learner, own in zip(self.learners, _parts(earlier, len(self.learners)), strict=True)
        )

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
        graph = Graph()
        index = graph.joined([robot.index_in(graph) for robot in self.robots], self.sizes)
        return graph.model(self.robots[0].network.inputs, index, "index")

    @classmethod
    def of(cls, arrays: Arrays, grid: ActionGrid) -> TeamPolicy:
        from stlbench_agents.q_policy import GreedyPolicy

        own = zip(_parts(arrays, len(grid.parts)), grid.parts, strict=True)
        robots = [GreedyPolicy.of(part, each.shape) for part, each in own]
        return cls(robots, [each.size for each in grid.parts])


def _parts(arrays: Arrays, robots: int) -> list[Arrays]:
    """Those of each robot, whose names begin with its number."""
    return [
        {name.removeprefix(f"{i}."): part for name, part in arrays.items() if name.startswith(f"{i}.")}
        for i in range(robots)
    ]
