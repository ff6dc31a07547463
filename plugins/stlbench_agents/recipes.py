"""The parameters that agents share, and the types of parameters: ranges, which the harness checks.

Names are those of Stable-Baselines3 where it has the option.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from stlbench.contract import Actions, Agent, Arrays, Policy
from stlbench_agents.training import grid_of

Share = Annotated[float, Field(ge=0, le=1)]
ShareBelow1 = Annotated[float, Field(ge=0, lt=1)]
Count = Annotated[int, Field(ge=1)]
Whole = Annotated[int, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Widths = Annotated[tuple[Count, ...], Field(min_length=1)]
"""Widths of the hidden layers of a network."""
Head = Literal["joint", "additive"]
"""How the outputs of a Q-network stand for actions (see `stlbench_agents.q_learner`)."""


@dataclass(frozen=True, kw_only=True)
class Learner(Agent):
    """An agent that trains networks with Adam."""

    net_arch: Widths = (64, 64)
    """widths of the hidden layers of each network"""
    copies: Count = 8
    """environments in lock-step"""
    batch_size: Count = 128
    """transitions in an update"""
    learning_rate: Positive = 1e-3
    """of Adam at the first update"""
    learning_rate_final: Positive = 1e-4
    """at the last update; the rate falls geometrically"""
    gamma: Share = 0.95
    """discount of a decision, that is, of `hold` steps"""


@dataclass(frozen=True, kw_only=True)
class OffPolicy(Learner):
    """A learner with a replay. Counts of transitions are of all copies together."""

    buffer_size: Count = 400_000
    """transitions kept for replay"""
    gradient_steps: Count = 1
    """updates after each step of all copies"""
    n_steps: Count = 1
    """rewards in a return before it bootstraps"""
    tau: Share = 0.01
    """weight of the online networks in an update of the targets; 1 copies them"""


@dataclass(frozen=True, kw_only=True)
class DeepQ(OffPolicy):
    """Deep Q-learning on a grid of actions, by whatever code."""

    copies: Count = 16
    buffer_size: Count = 65536
    learning_rate_final: Positive = 3e-5
    n_steps: Count = 3
    tau: Share = 0.005
    target_update_interval: Count = 1
    """updates from one update of the target network to the next"""
    exploration_initial_eps: Share = 1.0
    """probability of a random action at the start"""
    exploration_final_eps: Share = 0.05
    """what it falls to, linearly"""
    exploration_fraction: Share = 0.3
    """over this share of the budget"""
    max_grad_norm: Positive = 10.0
    """the gradient's norm is clipped to this"""

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        from stlbench_agents.q_learner import GreedyPolicy  # imports Numba, which parameters do not need

        return GreedyPolicy.of(arrays, grid_of(actions).shape)
