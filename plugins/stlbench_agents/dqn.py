"""Time-aware deep Q-learning: Algorithm 2 of Saxena et al., with batched environments.

The observation contains the time, so Q(s, a, t) is an ordinary Q-function of it, and the time limit is no terminal
state. One lock-step of all copies is followed by `gradient_steps` updates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from stlbench.contract import Agent, Environment, Integers, Policy, Training
from stlbench_agents.engine import Workspace, adam, blend, gradient
from stlbench_agents.network import GreedyPolicy, Head, QNetwork
from stlbench_agents.replay import Batch, Replay

__all__ = ["DQN"]

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0)]


class DQN(Agent):
    """Deep Q-learning with a time-aware input, epsilon-greedy, replay and a target network (Algorithm 2)."""

    def __init__(
        self,
        *,
        net_arch: Annotated[tuple[Count, ...], Field(min_length=1)] = (64, 64),
        head: Head = "joint",
        copies: Count = 16,
        batch_size: Count = 128,
        buffer_size: Count = 65536,
        gradient_steps: Count = 1,
        learning_rate: Positive = 1e-3,
        learning_rate_final: Positive = 3e-5,
        gamma: Share = 0.95,
        n_steps: Count = 3,
        double: bool = True,
        tau: Share = 0.005,
        target_update_interval: Count = 1,
        averaging: Annotated[float, Field(ge=0, lt=1)] = 0.999,
        exploration_initial_eps: Share = 1.0,
        exploration_final_eps: Share = 0.05,
        exploration_fraction: Share = 0.3,
        max_grad_norm: Positive = 10.0,
        reward_scale: Positive = 4.0,
        time_limit: Literal["bootstrap", "terminal"] = "bootstrap",
    ) -> None:
        """Names are those of Stable-Baselines3 where it has the option.

        The defaults are one recipe for all tasks that come with stlbench; a task file names the widths of the
        layers, the head and gamma, which depend on its actions and its time scale. The paper's Algorithm 2 literally
        is `double=False, n_steps=1, tau=1, target_update_interval=1000, averaging=0, copies=1`.

        Args:
            net_arch: widths of the hidden layers.
            head: `joint`, one output an action, or `additive`, V + one term an action axis.
            copies: environments in lock-step.
            batch_size: transitions an update.
            buffer_size: transitions kept for replay.
            gradient_steps: updates after each lock-step.
            learning_rate: of Adam at the first update; falls geometrically to `learning_rate_final` at the last.
            gamma: discount a decision, that is, a span of `hold` steps. Rewards are weighted by 1 - gamma in the
                targets, so that Q keeps the scale of the reward whatever gamma is.
            n_steps: rewards in a return before it bootstraps.
            double: choose the bootstrap action with the online network (van Hasselt et al. 2016); False is the paper.
            tau: weight of the online network in an update of the target; 1 copies it, as the paper does.
            target_update_interval: updates from one such update to the next.
            averaging: the policy that is reported has an exponential average of the weights, this close to 1 a step;
                0 takes the weights as they are. Actions in training are those of the current weights.
            exploration_initial_eps: share of random actions at the start, falling linearly over the first
                `exploration_fraction` of the budget to `exploration_final_eps`.
            max_grad_norm: the gradient's norm is clipped to this.
            reward_scale: factor on rewards, which arrive divided by the method's `scale`.
            time_limit: whether the value at the time limit is bootstrapped or taken as 0.
        """
        self.net_arch, self.head, self.copies = net_arch, head, copies
        self.batch_size, self.buffer_size, self.gradient_steps = batch_size, buffer_size, gradient_steps
        self.learning_rate, self.learning_rate_final = learning_rate, learning_rate_final
        self.gamma, self.n_steps, self.double = gamma, n_steps, double
        self.tau, self.target_update_interval = tau, target_update_interval
        self.eps = (exploration_initial_eps, exploration_final_eps, exploration_fraction)
        self.max_grad_norm, self.time_limit = max_grad_norm, time_limit
        self.reward_scale, self.averaging = reward_scale, averaging

    def train(self, training: Training) -> Policy:
        """Spend the budget; return the greedy policy at its end."""
        environment = training.make(self.copies)
        rounds = max(1, training.steps // (self.copies * environment.hold))
        learner = Learner(self, environment, training.seed, rounds * self.gradient_steps)
        generator = np.random.default_rng([training.seed, 1])
        rows = max(self.n_steps + 1, self.buffer_size // self.copies)
        replay = Replay(rows, self.copies, environment.observation_size, self.n_steps, self.gamma)
        reports = _spread(rounds, training.checkpoints)
        observation = environment.reset()
        for done in range(1, rounds + 1):
            action = self._explore(learner.policy.act(observation), environment, generator, (done - 1) / rounds)
            transition = environment.step(action)
            replay.add(observation, action, transition)
            observation = transition.observation
            if replay.ready:
                for _ in range(self.gradient_steps):
                    learner.update(replay.sample(generator, self.batch_size))
            if done in reports:
                final = learner.reported.frozen()
                training.report(final, done * self.copies * environment.hold)
        return final

    def _explore(
        self, greedy: Integers, environment: Environment, generator: np.random.Generator, progress: float
    ) -> Integers:
        first, last, share = self.eps
        epsilon = last if progress >= share else first + (last - first) * progress / share
        anything = generator.integers(environment.actions.size, size=len(greedy))
        return np.where(generator.random(len(greedy)) < epsilon, anything, greedy)


class Learner:
    """The online, the target and the averaged network, and one update of them."""

    def __init__(self, recipe: DQN, environment: Environment, seed: int, updates: int) -> None:
        self.recipe = recipe
        self.network = QNetwork(environment.observation_size, recipe.net_arch, environment.actions.shape, recipe.head)
        self.online = self.network.initial(np.random.default_rng(seed))
        self.target = self.online.copy()
        self.average = self.online.copy() if recipe.averaging else self.online
        self.policy = GreedyPolicy(self.network, self.network.views(self.online))
        self.reported = GreedyPolicy(self.network, self.network.views(self.average))
        self._gradient, self._mean, self._square = (np.zeros_like(self.online) for _ in range(3))
        self._space = Workspace.of(self.network.engine, recipe.batch_size)
        self._decay = (recipe.learning_rate_final / recipe.learning_rate) ** (1 / max(1, updates - 1))
        self._weight = np.float32((1 - recipe.gamma) * recipe.reward_scale)
        self._count = 0

    def update(self, batch: Batch) -> None:
        """One step of Adam on the mean squared difference to the targets, and of the other two networks.

        The batch has the recipe's `batch_size` rows.
        """
        recipe = self.recipe
        rate = recipe.learning_rate * self._decay**self._count
        self._count += 1
        adam(self.online, self.gradient(batch), self._mean, self._square, rate, self._count, recipe.max_grad_norm)
        if self._count % recipe.target_update_interval == 0:
            blend(self.target, self.online, recipe.tau)
        if recipe.averaging:
            blend(self.average, self.online, max(1 - recipe.averaging, 1 / self._count))

    def gradient(self, batch: Batch) -> NDArray[np.float32]:
        """The gradient of half the mean squared difference between Q(s_t, a_t) and the target, a flat vector.

        The target is (1 - gamma) sum_i gamma^i r_{t+i} + gamma^n Q_target(s_{t+n}, best action there).
        """
        discount = batch.discount
        if self.recipe.time_limit == "terminal":
            discount = np.where(batch.ended, np.float32(0), discount)
        gradient(
            self.online,
            self.target,
            self.network.engine,
            batch.observation,
            batch.action,
            batch.returns * self._weight,
            batch.arrived,
            discount,
            self.recipe.double,
            self._space,
            self._gradient,
        )
        return self._gradient


def _spread(rounds: int, checkpoints: int) -> set[int]:
    """The rounds after which a checkpoint is reported: evenly spaced, the last among them."""
    marks: Sequence[float] = np.linspace(0, rounds, min(checkpoints, rounds) + 1)[1:].tolist()
    return {round(mark) for mark in marks}
