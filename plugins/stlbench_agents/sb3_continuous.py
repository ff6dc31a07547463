"""Continuous actions by Stable-Baselines3: TD3, SAC and PPO."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from stlbench.contract import Environment, Policy
from stlbench_agents.policies import ActorPolicy, linear_layers
from stlbench_agents.recipes import Count, NotNegative, Positive, Share
from stlbench_agents.sb3_agent import SB3Agent, SB3OffPolicy
from stlbench_agents.training import box_of

if TYPE_CHECKING:
    from stable_baselines3 import PPO, SAC, TD3


@dataclass(frozen=True, kw_only=True)
class SB3TD3(SB3OffPolicy):
    """TD3 (Fujimoto, van Hoof, Meger 2018) as SB3 implements it: a cross-check of `td3` by code that others wrote."""

    algorithm_name = "TD3"

    policy_delay: Count = 2
    """updates of the critics for one of the actor"""
    target_policy_noise: NotNegative = 0.1
    """standard deviation of the noise on target actions, which lie in [-1, 1]"""
    target_noise_clip: NotNegative = 0.25
    """the most that this noise may be"""
    exploration_noise: NotNegative = 0.2
    """standard deviation of the noise on actions in training, which lie in [-1, 1]"""

    def options(self, environment: Environment) -> dict[str, Any]:
        from stable_baselines3.common.noise import NormalActionNoise

        axes, options = len(box_of(environment.actions).names), super().options(environment)
        noise = NormalActionNoise(np.zeros(axes), np.full(axes, options.pop("exploration_noise")))
        return options | {"action_noise": noise}

    def exported(self, model: TD3, environment: Environment) -> Policy:
        return ActorPolicy(linear_layers(model.actor.mu.children()), box_of(environment.actions), "relu", squashed=True)


@dataclass(frozen=True, kw_only=True)
class SB3SAC(SB3OffPolicy):
    """Soft actor-critic (Haarnoja et al. 2018) as SB3 implements it, with its entropy coefficient learned."""

    algorithm_name = "SAC"

    ent_coef_initial: Positive = 0.1
    """the entropy coefficient at the start; SB3's own 1 is large beside rewards of at most 1"""

    def options(self, environment: Environment) -> dict[str, Any]:
        options = super().options(environment)
        return options | {"ent_coef": f"auto_{options.pop('ent_coef_initial')}"}

    def exported(self, model: SAC, environment: Environment) -> Policy:
        layers = linear_layers([*model.actor.latent_pi.children(), model.actor.mu])
        return ActorPolicy(layers, box_of(environment.actions), "relu", squashed=True)


@dataclass(frozen=True, kw_only=True)
class SB3PPO(SB3Agent):
    """Proximal policy optimisation (Schulman et al. 2017) as SB3 implements it, with tanh between layers.

    A budget is rounded down to whole rollouts; one of less than a rollout is one rollout, in whole batches as far as
    its steps allow.
    """

    algorithm_name = "PPO"

    n_steps: Count = 256
    """steps of all copies in a rollout"""
    batch_size: Count = 256
    n_epochs: Count = 10
    """passes over a rollout"""
    gae_lambda: Share = 0.95
    """of the generalised advantage estimate"""
    clip_range: Positive = 0.2
    """of the ratio of probabilities"""
    ent_coef: NotNegative = 0.0
    """weight of the entropy in the loss"""

    @property
    def stored(self) -> int:
        return self.n_steps * self.copies

    @property
    def rollout(self) -> int:
        return self.n_steps

    def fitted(self, lock_steps: int) -> Self:
        """With a rollout that the budget has, if possible in whole batches, and batches no larger than it."""
        rollout = self.n_steps
        if lock_steps < rollout:
            whole = self.batch_size // math.gcd(self.batch_size, self.copies)
            rollout = lock_steps // whole * whole or lock_steps
        return replace(self, n_steps=rollout, batch_size=min(self.batch_size, rollout * self.copies))

    def exported(self, model: PPO, environment: Environment) -> Policy:
        layers = linear_layers([*model.policy.mlp_extractor.policy_net.children(), model.policy.action_net])
        return ActorPolicy(layers, box_of(environment.actions), "tanh", squashed=False)
