"""Deep Q-learning by Stable-Baselines3, on the very same environment and reward as `stlbench_agents.dqn`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from stlbench.contract import Environment, Policy
from stlbench_agents.actions import grid_of
from stlbench_agents.parameters import Count, Positive, Share
from stlbench_agents.sb3_agent import SB3Agent, falling

if TYPE_CHECKING:
    from stable_baselines3 import DQN

__all__ = ["SB3DQN"]


class SB3DQN(SB3Agent):
    """Deep Q-learning as Stable-Baselines3 implements it: a cross-check of `dqn` by code that others wrote."""

    def __init__(
        self,
        *,
        net_arch: Annotated[tuple[Count, ...], Field(min_length=1)] = (64, 64),
        copies: Count = 16,
        batch_size: Count = 128,
        buffer_size: Count = 65536,
        learning_starts: Annotated[int, Field(ge=0)] = 100,
        gradient_steps: Count = 1,
        learning_rate: Positive = 1e-3,
        learning_rate_final: Positive = 3e-5,
        gamma: Share = 0.95,
        n_steps: Count = 3,
        tau: Share = 0.005,
        target_update_interval: Count = 1,
        exploration_initial_eps: Share = 1.0,
        exploration_final_eps: Share = 0.05,
        exploration_fraction: Share = 0.3,
        max_grad_norm: Positive = 10.0,
    ) -> None:
        """Names and meanings are SB3's, counts of steps are transitions; `train_freq` is 1, one lock-step.

        Where it differs from `dqn`: Huber loss; targets of plain rewards (not weighted by 1 - gamma), so that Q is
        about 1 / (1 - gamma) as large; the target network chooses the bootstrap action (no double Q-learning); no
        averaged weights; a joint head alone; exploration draws one coin for all copies, so that in a lock-step all
        act at random or none does.

        Args:
            net_arch: widths of the hidden layers.
            copies: environments in lock-step.
            batch_size: transitions an update.
            buffer_size: transitions kept for replay, all copies together.
            learning_starts: transitions, with random actions, before the first update.
            gradient_steps: updates after each lock-step.
            learning_rate: of Adam at the start; falls geometrically to `learning_rate_final` at the end.
            gamma: discount a decision, that is, a span of `hold` steps.
            n_steps: rewards in a return before it bootstraps.
            tau: weight of the online network in an update of the target; 1 copies it.
            target_update_interval: transitions from one such update to the next, at least one lock-step.
            exploration_initial_eps: probability of random actions at the start, falling linearly over the first
                `exploration_fraction` of the budget to `exploration_final_eps`.
            max_grad_norm: the gradient's norm is clipped to this.
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
            "target_update_interval": max(target_update_interval, copies),  # SB3 rounds up too, but with a warning
            "exploration_initial_eps": exploration_initial_eps,
            "exploration_final_eps": exploration_final_eps,
            "exploration_fraction": exploration_fraction,
            "max_grad_norm": max_grad_norm,
        }

    def model(self, environment: Environment, seed: int, most: int) -> DQN:
        """SB3's DQN, untrained."""
        from stable_baselines3 import DQN

        grid_of(environment)
        made: DQN = self.made(DQN, environment, seed, policy_kwargs={"net_arch": list(self.net_arch)}, **self.options)
        return made

    def exported(self, model: DQN, environment: Environment) -> Policy:
        """The greedy policy of the Q-network."""
        from stlbench_agents.sb3_bridge import exported

        return exported(model.q_net.q_net, environment.observation_size, grid_of(environment).shape)
