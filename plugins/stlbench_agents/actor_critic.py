"""TD3's actor and critics, and one update of them, in PyTorch."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from stlbench.contract import ActionBox
from stlbench_agents.actor_policy import ActorPolicy, linear_layers
from stlbench_agents.replay import Batch

if TYPE_CHECKING:
    from stlbench_agents.td3 import TD3

__all__ = ["ActorCritic", "TwinCritic"]


class TwinCritic(nn.Module):
    """Two critics of the same shape, evaluated at once: a batched product does the work of two."""

    def __init__(self, widths: Sequence[int]) -> None:
        """Args: `widths` of all layers, the input's (observation and action) first and 1 last."""
        super().__init__()
        shapes = list(pairwise(widths))
        self.matrices = nn.ParameterList([nn.Parameter(torch.empty(2, rows, columns)) for rows, columns in shapes])
        self.biases = nn.ParameterList([nn.Parameter(torch.zeros(2, 1, columns)) for _, columns in shapes])

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """Both values of each pair: (B, D), (B, axes) -> (2, B)."""
        x: Tensor = torch.cat([observation, action], dim=1).expand(2, -1, -1)
        for i, (matrix, bias) in enumerate(zip(self.matrices, self.biases, strict=True)):
            x = torch.baddbmm(bias, x, matrix)
            if i + 1 < len(self.matrices):
                x = functional.relu(x)
        return x.squeeze(2)


class ActorCritic:
    """Actor and critics, their targets, and one update."""

    def __init__(self, recipe: TD3, inputs: int, box: ActionBox, generator: np.random.Generator, updates: int) -> None:
        """Args: `inputs` D; `generator` of the initial weights; `updates` in all, for the learning rate."""
        self.recipe, self.box, axes = recipe, box, len(box.names)
        hidden = recipe.net_arch
        layers = [nn.Linear(rows, columns) for rows, columns in pairwise((inputs, *hidden, axes))]
        self.actor = nn.Sequential(*[part for layer in layers[:-1] for part in (layer, nn.ReLU())], layers[-1])
        self.critic = TwinCritic((inputs + axes, *hidden, 1))
        _initialise(self.actor, self.critic, generator)
        self.target_actor, self.target_critic = copy.deepcopy(self.actor), copy.deepcopy(self.critic)
        self.average = copy.deepcopy(self.actor)
        self._adams = [
            torch.optim.Adam(module.parameters(), recipe.learning_rate, fused=True)
            for module in (self.actor, self.critic)
        ]
        self._followers: list[tuple[list[Tensor], list[Tensor], float]] = [
            ([*follower.parameters()], [*module.parameters()], weight)
            for follower, module, weight in (
                (self.target_actor, self.actor, recipe.tau),
                (self.target_critic, self.critic, recipe.tau),
                (self.average, self.actor, 1 - recipe.averaging),
            )
        ]
        self._decay = (recipe.learning_rate_final / recipe.learning_rate) ** (1 / max(1, updates - 1))
        bounded = recipe.gamma < 1  # otherwise values are sums of rewards, without bounds
        self._least, self._most = (math.inf, -math.inf) if bounded else (-math.inf, math.inf)
        self._count = 0

    def policy(self, averaged: bool = False) -> ActorPolicy:
        """The actor as it is now, or with the average of its weights."""
        actor = self.average if averaged else self.actor
        return ActorPolicy(linear_layers(actor), self.box, "relu", squashed=True)

    def saw(self, reward: np.ndarray) -> None:
        """Take note of rewards (N,): a value, a mean of rewards weighted by powers of gamma, lies among them."""
        self._least = min(self._least, self.recipe.reward_scale * float(reward.min()))
        self._most = max(self._most, self.recipe.reward_scale * float(reward.max()))

    def update(self, batch: Batch, noise: np.ndarray) -> None:
        """One step of Adam for the critics, and every `policy_delay` one for the actor; its followers move.

        Args:
            batch: B transitions, actions in [-1, 1].
            noise: standard normal, (B, axes), for the target actions.
        """
        for adam in self._adams:
            adam.param_groups[0]["lr"] = self.recipe.learning_rate * self._decay**self._count
        self._count += 1
        actor_adam, critic_adam = self._adams
        observation, action = torch.from_numpy(batch.observation), torch.from_numpy(batch.action)
        _descend(critic_adam, self.critic_loss(observation, action, self.targets(batch, noise)))
        if self._count % self.recipe.policy_delay == 0:
            _descend(actor_adam, self.actor_loss(observation))
            with torch.no_grad():
                for follower, module, weight in self._followers:
                    torch._foreach_lerp_(follower, module, weight)

    @torch.no_grad()
    def targets(self, batch: Batch, noise: np.ndarray) -> Tensor:
        """The return and, discounted, the lesser of the target critics at the noisy target action: (B,).

        Kept among the rewards that were seen, without which values of states that were never visited run away.
        """
        spread, limit = self.recipe.target_policy_noise, self.recipe.target_noise_clip
        arrived = torch.from_numpy(batch.arrived)
        shift = torch.from_numpy(np.clip(spread * noise, -limit, limit).astype(np.float32))
        action = (torch.tanh(self.target_actor(arrived)) + shift).clamp(-1, 1)
        value = self.target_critic(arrived, action).amin(0)
        goal: Tensor = torch.from_numpy(batch.returns) + torch.from_numpy(batch.discount) * value
        return goal.clamp(self._least, self._most)

    def critic_loss(self, observation: Tensor, action: Tensor, goal: Tensor) -> Tensor:
        """Huber's loss of both critics, the sum of their means over the batch."""
        values = self.critic(observation, action)
        loss: Tensor = functional.smooth_l1_loss(values, goal.expand_as(values), reduction="sum") / goal.shape[0]
        return loss

    def actor_loss(self, observation: Tensor) -> Tensor:
        """The first critic's value of the actor's action, negative, and the penalty on the output before the tanh."""
        output = self.actor(observation)
        value = self.critic(observation, torch.tanh(output))[0]
        loss: Tensor = self.recipe.action_penalty * (output**2).mean() - value.mean()
        return loss


def _descend(adam: torch.optim.Adam, loss: Tensor) -> None:
    adam.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]  # PyTorch leaves it untyped
    adam.step()


@torch.no_grad()
def _initialise(actor: nn.Sequential, critic: TwinCritic, generator: np.random.Generator) -> None:
    """Uniform in 1/sqrt(inputs), the actor's last layer a tenth of it, biases 0; from `generator` alone."""
    linear = [layer for layer in actor if isinstance(layer, nn.Linear)]
    for layer in linear:
        bound = (0.1 if layer is linear[-1] else 1) / math.sqrt(layer.in_features)
        layer.weight.copy_(torch.from_numpy(generator.uniform(-bound, bound, layer.weight.shape)))
        layer.bias.zero_()
    for matrix in critic.matrices:
        bound = 1 / math.sqrt(matrix.shape[1])
        matrix.copy_(torch.from_numpy(generator.uniform(-bound, bound, matrix.shape)))
