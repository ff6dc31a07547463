"""Parameters of agents with their ranges, which the harness checks, and the recipes of `dqn` and `td3`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

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
class DQNRecipe:
    """Parameters of `dqn` and `dqn-per-robot`."""

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


@dataclass(frozen=True, kw_only=True)
class TD3Recipe:
    """Parameters of `td3`."""

    net_arch: Widths = (64, 64)
    """widths of the hidden layers of actor and critics"""
    copies: Count = 8
    """environments in lock-step"""
    batch_size: Count = 128
    """transitions in an update"""
    buffer_size: Count = 400_000
    """transitions kept for replay"""
    gradient_steps: Count = 1
    """updates after each step of all copies"""
    learning_rate: Positive = 1e-3
    """of Adam at the first update"""
    learning_rate_final: Positive = 1e-4
    """at the last update; the rate falls geometrically"""
    gamma: Share = 0.95
    """discount of a decision, that is, of `hold` steps. Rewards are weighted by 1 - gamma, so that values keep the
    scale of the reward; with gamma = 1 they are not"""
    n_steps: Count = 1
    """rewards in a return before it bootstraps"""
    tau: Share = 0.01
    """weight of the online networks in an update of the targets, one for each `policy_delay` updates"""
    policy_delay: Count = 2
    """updates of the critics for one of the actor"""
    averaging: ShareBelow1 = 0.995
    """reported policies have an exponential average of the actor's weights, with this weight on the past at each update
    of the actor; 0: the weights themselves. Actions in training are those of the current weights"""
    target_policy_noise: NotNegative = 0.1
    """standard deviation of the noise on target actions, which lie in [-1, 1]"""
    target_noise_clip: NotNegative = 0.25
    """the most that this noise may be"""
    exploration_noise: NotNegative = 0.2
    """standard deviation of the noise on actions in training, which lie in [-1, 1]; it rises from a quarter of this in
    the first copy to one and three quarters in the last"""
    exploration_noise_final: NotNegative | None = None
    """what that falls to, linearly over the budget; it stays where left out"""
    random_steps: Whole = 100
    """steps of all copies with random actions at the start, without updates"""
    action_penalty: NotNegative = 0.005
    """weight in the actor's loss of its squared output before the tanh, without which actions stick at their ends"""
    reward_scale: Positive = 10.0
    """factor on rewards, which arrive divided by the method's `scale`"""
