"""Continuous actions by Stable-Baselines3: TD3, SAC and PPO."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from stlbench.contract import Environment, Policy
from stlbench_agents.actions import box_of
from stlbench_agents.actor import ActorPolicy, linear_layers
from stlbench_agents.parameters import Count, Positive, Share
from stlbench_agents.sb3_agent import SB3Agent, falling

if TYPE_CHECKING:
    from stable_baselines3 import PPO, SAC, TD3

__all__ = ["SB3PPO", "SB3SAC", "SB3TD3"]

Widths = Annotated[tuple[Count, ...], Field(min_length=1)]


class SB3TD3(SB3Agent):
    """TD3 (Fujimoto, van Hoof, Meger 2018) as SB3 implements it: a cross-check of `td3` by code that others wrote."""

    def __init__(
        self,
        *,
        net_arch: Widths = (64, 64),
        copies: Count = 8,
        batch_size: Count = 128,
        buffer_size: Count = 400_000,
        learning_starts: Annotated[int, Field(ge=0)] = 800,
        gradient_steps: Count = 1,
        learning_rate: Positive = 1e-3,
        learning_rate_final: Positive = 1e-4,
        gamma: Share = 0.95,
        n_steps: Count = 1,
        tau: Share = 0.01,
        policy_delay: Count = 2,
        target_policy_noise: Annotated[float, Field(ge=0)] = 0.1,
        target_noise_clip: Annotated[float, Field(ge=0)] = 0.25,
        exploration_noise: Annotated[float, Field(ge=0)] = 0.2,
    ) -> None:
        """Names and meanings are SB3's, counts of steps are transitions; `train_freq` is 1, one lock-step.

        Args:
            net_arch: widths of the hidden layers of actor and critics.
            copies: environments in lock-step.
            batch_size: transitions an update.
            buffer_size: transitions kept for replay, all copies together.
            learning_starts: transitions, with random actions, before the first update.
            gradient_steps: updates after each lock-step.
            learning_rate: of Adam at the start; falls geometrically to `learning_rate_final` at the end.
            gamma: discount a decision, that is, a span of `hold` steps.
            n_steps: rewards in a return before it bootstraps.
            tau: weight of the online networks in an update of the targets.
            policy_delay: updates of the critics for one of the actor.
            target_policy_noise: standard deviation of the noise on target actions, in [-1, 1] units.
            target_noise_clip: its limit.
            exploration_noise: standard deviation of the noise on actions in training, in [-1, 1] units.
        """
        self.net_arch, self.copies, self.noise = net_arch, copies, exploration_noise
        self.options: dict[str, Any] = {
            "batch_size": batch_size,
            "buffer_size": buffer_size,
            "learning_starts": learning_starts,
            "train_freq": 1,
            "gradient_steps": gradient_steps,
            "learning_rate": falling(learning_rate, learning_rate_final),
            "gamma": gamma,
            "n_steps": n_steps,
            "tau": tau,
            "policy_delay": policy_delay,
            "target_policy_noise": target_policy_noise,
            "target_noise_clip": target_noise_clip,
        }

    def model(self, environment: Environment, seed: int, most: int) -> TD3:
        """SB3's TD3, untrained."""
        from stable_baselines3 import TD3
        from stable_baselines3.common.noise import NormalActionNoise

        axes = len(box_of(environment).names)
        noise = NormalActionNoise(np.zeros(axes), np.full(axes, self.noise))
        policy = {"net_arch": list(self.net_arch)}
        made: TD3 = self.made(TD3, environment, seed, action_noise=noise, policy_kwargs=policy, **self.options)
        return made

    def exported(self, model: TD3, environment: Environment) -> Policy:
        """The actor."""
        return ActorPolicy(linear_layers(model.actor.mu.children()), box_of(environment), "relu", squashed=True)


class SB3SAC(SB3Agent):
    """Soft actor-critic (Haarnoja et al. 2018) as SB3 implements it, with its entropy coefficient learned."""

    def __init__(
        self,
        *,
        net_arch: Widths = (64, 64),
        copies: Count = 8,
        batch_size: Count = 128,
        buffer_size: Count = 400_000,
        learning_starts: Annotated[int, Field(ge=0)] = 800,
        gradient_steps: Count = 1,
        learning_rate: Positive = 1e-3,
        learning_rate_final: Positive = 1e-4,
        gamma: Share = 0.95,
        n_steps: Count = 1,
        tau: Share = 0.01,
        ent_coef_initial: Positive = 0.1,
    ) -> None:
        """Args: as for `sb3-td3`, and

        ent_coef_initial: the entropy coefficient at the start; SB3's own 1 is large beside rewards of at most 1.
        """
        self.net_arch, self.copies = net_arch, copies
        self.options: dict[str, Any] = {
            "batch_size": batch_size,
            "buffer_size": buffer_size,
            "learning_starts": learning_starts,
            "train_freq": 1,
            "gradient_steps": gradient_steps,
            "learning_rate": falling(learning_rate, learning_rate_final),
            "gamma": gamma,
            "n_steps": n_steps,
            "tau": tau,
            "ent_coef": f"auto_{ent_coef_initial}",
        }

    def model(self, environment: Environment, seed: int, most: int) -> SAC:
        """SB3's SAC, untrained."""
        from stable_baselines3 import SAC

        box_of(environment)
        made: SAC = self.made(SAC, environment, seed, policy_kwargs={"net_arch": list(self.net_arch)}, **self.options)
        return made

    def exported(self, model: SAC, environment: Environment) -> Policy:
        """The actor's mean."""
        layers = linear_layers([*model.actor.latent_pi.children(), model.actor.mu])
        return ActorPolicy(layers, box_of(environment), "relu", squashed=True)


class SB3PPO(SB3Agent):
    """Proximal policy optimisation (Schulman et al. 2017) as SB3 implements it."""

    def __init__(
        self,
        *,
        net_arch: Widths = (64, 64),
        copies: Count = 8,
        n_steps: Count = 256,
        batch_size: Count = 256,
        n_epochs: Count = 10,
        learning_rate: Positive = 1e-3,
        learning_rate_final: Positive = 1e-4,
        gamma: Share = 0.95,
        gae_lambda: Share = 0.95,
        clip_range: Positive = 0.2,
        ent_coef: Annotated[float, Field(ge=0)] = 0.0,
    ) -> None:
        """Names and meanings are SB3's. A budget is rounded down to whole rollouts; one of less has one, as long as
        there are steps for.

        Args:
            net_arch: widths of the hidden layers, tanh, of actor and critic each.
            copies: environments in lock-step.
            n_steps: lock-steps in a rollout.
            batch_size: transitions an update.
            n_epochs: passes over a rollout.
            learning_rate: of Adam at the start; falls geometrically to `learning_rate_final` at the end.
            gamma: discount a decision, that is, a span of `hold` steps.
            gae_lambda: of the generalised advantage estimate.
            clip_range: of the ratio of probabilities.
            ent_coef: weight of the entropy in the loss.
        """
        self.net_arch, self.copies, self.n_steps, self.batch_size = net_arch, copies, n_steps, batch_size
        self.options: dict[str, Any] = {
            "n_epochs": n_epochs,
            "learning_rate": falling(learning_rate, learning_rate_final),
            "gamma": gamma,
            "gae_lambda": gae_lambda,
            "clip_range": clip_range,
            "ent_coef": ent_coef,
        }

    def model(self, environment: Environment, seed: int, most: int) -> PPO:
        """SB3's PPO, untrained."""
        from stable_baselines3 import PPO

        box_of(environment)
        rollout = self.rollout(most)
        options = {"n_steps": rollout, "batch_size": min(self.batch_size, rollout * self.copies), **self.options}
        made: PPO = self.made(PPO, environment, seed, policy_kwargs={"net_arch": list(self.net_arch)}, **options)
        return made

    def rollout(self, most: int) -> int:
        """`n_steps`; where the budget has less, what it has, if possible in whole batches."""
        if most >= self.n_steps:
            return self.n_steps
        whole = self.batch_size // math.gcd(self.batch_size, self.copies)
        return most // whole * whole or most

    def exported(self, model: PPO, environment: Environment) -> Policy:
        """The mean of the policy's distribution, clipped to the box."""
        layers = linear_layers([*model.policy.mlp_extractor.policy_net.children(), model.policy.action_net])
        return ActorPolicy(layers, box_of(environment), "tanh", squashed=False)
