"""Time-aware deep Q-learning: Algorithm 2 of Saxena et al., with batched environments.

The observation contains the time, so Q(s, a, t) is an ordinary Q-function of it, and the time limit is no terminal
state. One lock-step of all copies is followed by `gradient_steps` updates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
import torch
from pydantic import Field

from stlbench.contract import Agent, Environment, Integers, Policy, Training
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
        net_arch: tuple[Count, ...] = (64, 64),
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
        torch.set_num_threads(1)
        torch.set_flush_denormal(True)  # dead ReLUs push Adam's moments into denormals
        try:
            return self._train(training)
        finally:
            torch.set_flush_denormal(False)

    def _train(self, training: Training) -> Policy:
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
    """The online and the target network, and one update of them."""

    def __init__(self, recipe: DQN, environment: Environment, seed: int, updates: int) -> None:
        grid = environment.actions.shape
        self.recipe = recipe
        self.network = QNetwork(environment.observation_size, recipe.net_arch, grid, recipe.head)
        self._flat = self.network.initial(torch.Generator().manual_seed(seed))
        self._flat_target = self._flat.clone()
        self._online = [weight.requires_grad_() for weight in self.network.views(self._flat)]
        self._target = self.network.views(self._flat_target)
        self.policy = GreedyPolicy(self.network, [weight.detach().numpy() for weight in self._online])
        self._flat_average = self._flat.clone() if recipe.averaging else self._flat
        average = self.network.views(self._flat_average)
        self.reported = GreedyPolicy(self.network, [weight.numpy() for weight in average])
        self._adam = Adam(self._flat, recipe.learning_rate, recipe.learning_rate_final, updates)
        self._weight = (1 - recipe.gamma) * recipe.reward_scale
        self._count = 0

    def update(self, batch: Batch) -> None:
        """One step of Adam on the mean squared difference to the targets, and of the target network."""
        gradient = self.gradient(batch)
        gradient *= min(1.0, self.recipe.max_grad_norm / (float(gradient.norm()) + 1e-6))
        self._adam.step(gradient)
        self._count += 1
        if self._count % self.recipe.target_update_interval == 0:
            self._flat_target.lerp_(self._flat, self.recipe.tau)
        if self.recipe.averaging:
            self._flat_average.lerp_(self._flat, max(1 - self.recipe.averaging, 1 / self._count))

    def gradient(self, batch: Batch) -> torch.Tensor:
        """The gradient of half the mean squared difference, as one flat vector."""
        hidden = self.network.hidden(self._online, torch.from_numpy(batch.observation))
        q = self.network.value(self._online, hidden, torch.from_numpy(batch.action))
        difference = q - self._targets(batch)
        loss = torch.dot(difference, difference) * (0.5 / len(q))
        return torch.cat([part.reshape(-1) for part in torch.autograd.grad(loss, self._online)])

    @torch.no_grad()
    def _targets(self, batch: Batch) -> torch.Tensor:
        """(1 - gamma) sum_i gamma^i r_{t+i} + gamma^n Q_target(s_{t+n}, argmax Q), shape (B,)."""
        arrived = torch.from_numpy(batch.arrived)
        later = self.network.hidden(self._target, arrived)
        if self.recipe.double:
            chosen = self.network.best(self._online, self.network.hidden(self._online, arrived))
        else:
            chosen = self.network.best(self._target, later)
        discount = batch.discount
        if self.recipe.time_limit == "terminal":
            discount = np.where(batch.ended, np.float32(0), discount)
        bootstrap = torch.from_numpy(discount) * self.network.value(self._target, later, chosen)
        return torch.from_numpy(batch.returns) * self._weight + bootstrap


class Adam:
    """Adam (Kingma, Ba 2015) on one flat vector; torch.optim's bookkeeping costs seven times the arithmetic here.

    The learning rate falls geometrically from `rate` at the first step to `final_rate` at the last.
    """

    def __init__(self, weights: torch.Tensor, rate: float, final_rate: float, steps: int) -> None:
        self._weights, self._rate = weights, rate
        self._decay = (final_rate / rate) ** (1 / max(1, steps - 1))
        self._mean, self._square = torch.zeros_like(weights), torch.zeros_like(weights)
        self._count = 0

    def step(self, gradient: torch.Tensor) -> None:
        """Change the weights in place."""
        self._count += 1
        self._mean.lerp_(gradient, 0.1)
        self._square.mul_(0.999).addcmul_(gradient, gradient, value=0.001)
        unbiased = math.sqrt(1 - 0.999**self._count)
        rate = self._rate * self._decay ** (self._count - 1) * unbiased / (1 - 0.9**self._count)
        self._weights.addcdiv_(self._mean, self._square.sqrt().add_(1e-8 * unbiased), value=-rate)


def _spread(rounds: int, checkpoints: int) -> set[int]:
    """The rounds after which a checkpoint is reported: evenly spaced, the last among them."""
    marks: Sequence[float] = np.linspace(0, rounds, min(checkpoints, rounds) + 1)[1:].tolist()
    return {round(mark) for mark in marks}
