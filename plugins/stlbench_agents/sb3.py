"""Training by Stable-Baselines3 (DQN, PPO, SAC, TD3), on the same environment and reward as stlbench's own agents."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from itertools import chain
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, cast

import numpy as np
from pydantic import Field

from stlbench.contract import ActionGrid, Actions, Arrays, Cost, Environment, Policy, Training
from stlbench_agents import training as shared
from stlbench_agents.policies import ActorPolicy, linear_layers, need

if TYPE_CHECKING:
    from stable_baselines3 import DQN, PPO, SAC, TD3
    from stable_baselines3.common.base_class import BaseAlgorithm


@dataclass(frozen=True, kw_only=True)
class SB3Agent(shared.Learner):
    """An algorithm of SB3: the training that all have in common. Names and meanings of parameters are SB3's."""

    def __post_init__(self) -> None:
        need("torch", "PyTorch", "sb3")
        need("stable_baselines3", "Stable-Baselines3", "sb3")

    algorithm_name: ClassVar[str]
    takes_grid: ClassVar[bool] = False
    """Whether it takes a grid of actions, or else continuous ones."""

    def algorithm(self) -> type[BaseAlgorithm]:
        """SB3's class. Imports SB3, which takes seconds."""
        return cast("type[BaseAlgorithm]", getattr(import_module("stable_baselines3"), self.algorithm_name))

    @abstractmethod
    def exported(self, model: Any, environment: Environment) -> Policy:
        """The model's deterministic policy as it is now. Raises `Unsuitable` if the actions are of another kind."""

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        return ActorPolicy.of(arrays, shared.box_of(actions))

    def options(self, environment: Environment) -> dict[str, Any]:
        """The keyword arguments of SB3's class. Raises `Unsuitable` if the task's actions are of the other kind."""
        (shared.grid_of if self.takes_grid else shared.box_of)(environment.actions)
        options = asdict(self)
        del options["copies"]
        options["policy_kwargs"] = {"net_arch": list(options.pop("net_arch"))}
        first, last = self.learning_rate, options.pop("learning_rate_final")
        options["learning_rate"] = lambda left: last * (first / last) ** left  # `left` is a share of the training
        return options

    def fitted(self, lock_steps: int) -> Self:
        """The same agent, if need be with smaller numbers, for a budget of so many steps of all copies."""
        return self

    @property
    @abstractmethod
    def stored(self) -> int:
        """Transitions in memory at the same time, at most."""

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost:
        outputs = actions.size if isinstance(actions, ActionGrid) else len(actions.names)
        return shared.cost_of(size, self.net_arch, outputs, min(decisions, self.stored))

    @property
    def rollout(self) -> int:
        """Lock-steps that the algorithm takes at a time; a budget is rounded down to whole ones."""
        return 1

    def model(self, environment: Environment, seed: int) -> BaseAlgorithm:
        """SB3's model, untrained; silent, and nothing of it is written to disk."""
        from stable_baselines3.common.logger import Logger

        from stlbench_agents.sb3_bridge import CopiesVecEnv

        options = self.options(environment)
        copies = CopiesVecEnv(environment, self.gamma)
        model = self.algorithm()("MlpPolicy", copies, device="cpu", seed=seed, **options)
        model.set_logger(Logger(folder=None, output_formats=[]))
        return model

    def preload(self) -> None:
        self.algorithm()
        import stlbench_agents.sb3_bridge  # noqa: F401

    def train(self, training: Training) -> Policy:
        """SB3 seeds and uses the process's global generators (random, NumPy, torch)."""
        import torch  # takes seconds

        environment = training.make(self.copies)
        lock_steps = max(1, training.steps // (self.copies * environment.hold))
        torch.set_num_threads(1)
        torch.set_flush_denormal(True)  # denormal numbers are slow: dead ReLUs push Adam's moments there
        try:
            return self.fitted(lock_steps)._train(training, environment, lock_steps)
        finally:
            torch.set_flush_denormal(False)

    def _train(self, training: Training, environment: Environment, lock_steps: int) -> Policy:
        from stlbench_agents.sb3_bridge import Checkpoints

        size, rounds = self.copies * self.rollout, lock_steps // self.rollout
        model = self.model(environment, training.seed % 2**32)  # NumPy's global generator takes no larger seed
        final: Policy

        def report() -> bool:
            nonlocal final
            final = self.exported(model, environment)
            return bool(training.report(final, model.num_timesteps * environment.hold))

        before_the_end = sorted(shared.report_rounds(rounds, training.checkpoints))[:-1]
        never = training.steps + 1
        callback = Checkpoints([size * done for done in before_the_end], report)
        model.learn(rounds * size, callback=callback, log_interval=never)
        return final


@dataclass(frozen=True, kw_only=True)
class SB3OffPolicy(SB3Agent, shared.OffPolicy):
    """An algorithm of SB3 with a replay."""

    learning_starts: shared.Whole = 800
    """transitions, with random actions, before the first update"""

    @property
    def stored(self) -> int:
        return self.buffer_size

    def options(self, environment: Environment) -> dict[str, Any]:
        return super().options(environment) | {"train_freq": 1}  # an update after each step of all copies


@dataclass(frozen=True, kw_only=True)
class SB3DQN(shared.DeepQ, SB3OffPolicy):
    """Deep Q-learning as Stable-Baselines3 implements it: a cross-check of `dqn` by code that others wrote.

    Where it differs from `dqn`: Huber loss; targets of plain rewards (not weighted by 1 - gamma), so that Q is about
    1 / (1 - gamma) as large; the target network chooses the bootstrap action (no double Q-learning); no averaged
    weights; a joint head alone; exploration draws one random number for all copies, so that in a lock-step all act at
    random or none does.
    """

    algorithm_name = "DQN"
    recipe = MappingProxyType({**shared.SHARED, "gamma": 0.9, "n_steps": 5, "buffer_size": 131072})
    preference = MappingProxyType({"grid": 2})
    takes_grid = True

    learning_starts: shared.Whole = 100
    target_update_interval: shared.Count = 1
    """transitions from one update of the target to the next, at least one step of all copies"""

    def options(self, environment: Environment) -> dict[str, Any]:
        rounded_up = max(self.target_update_interval, self.copies)  # SB3 does so too, but with a warning
        return super().options(environment) | {"target_update_interval": rounded_up}

    def exported(self, model: DQN, environment: Environment) -> Policy:
        from stlbench_agents.q_policy import GreedyPolicy, QNetwork  # imports Numba, which parameters do not need

        *hidden, (matrix, bias) = linear_layers(model.q_net.q_net)
        size, grid = environment.observation_size, shared.grid_of(environment.actions).shape
        network = QNetwork(size, [len(layer[1]) for layer in hidden], grid, "joint")
        return GreedyPolicy(network, [*chain.from_iterable(hidden), matrix.T, bias])


@dataclass(frozen=True, kw_only=True)
class SB3TD3(SB3OffPolicy):
    """TD3 (Fujimoto, van Hoof, Meger 2018) as SB3 implements it: a cross-check of `td3` by code that others wrote."""

    algorithm_name = "TD3"
    recipe = MappingProxyType({**shared.SHARED, "gradient_steps": 4, "n_steps": 3})

    policy_delay: shared.Count = 2
    """updates of the critics for one of the actor"""
    target_policy_noise: shared.NotNegative = 0.1
    """standard deviation of the noise on target actions, which lie in [-1, 1]"""
    target_noise_clip: shared.NotNegative = 0.25
    """the most that this noise may be"""
    exploration_noise: shared.NotNegative = 0.2
    """standard deviation of the noise on actions in training, which lie in [-1, 1]"""

    def options(self, environment: Environment) -> dict[str, Any]:
        from stable_baselines3.common.noise import NormalActionNoise

        axes, options = len(shared.box_of(environment.actions).names), super().options(environment)
        noise = NormalActionNoise(np.zeros(axes), np.full(axes, options.pop("exploration_noise")))
        return options | {"action_noise": noise}

    def exported(self, model: TD3, environment: Environment) -> Policy:
        return ActorPolicy(
            linear_layers(model.actor.mu.children()), shared.box_of(environment.actions), "relu", squashed=True
        )


@dataclass(frozen=True, kw_only=True)
class SB3SAC(SB3OffPolicy):
    """Soft actor-critic (Haarnoja et al. 2018) as SB3 implements it, with its entropy coefficient learned."""

    algorithm_name = "SAC"
    recipe = MappingProxyType({**shared.SHARED, "gradient_steps": 4, "n_steps": 3})
    preference = MappingProxyType({"box": 2})

    ent_coef_initial: shared.Positive = 0.1
    """the entropy coefficient at the start; SB3's own 1 is large beside rewards of at most 1"""

    def options(self, environment: Environment) -> dict[str, Any]:
        options = super().options(environment)
        return options | {"ent_coef": f"auto_{options.pop('ent_coef_initial')}"}

    def exported(self, model: SAC, environment: Environment) -> Policy:
        layers = linear_layers([*model.actor.latent_pi.children(), model.actor.mu])
        return ActorPolicy(layers, shared.box_of(environment.actions), "relu", squashed=True)


@dataclass(frozen=True, kw_only=True)
class SB3PPO(SB3Agent):
    """Proximal policy optimisation (Schulman et al. 2017) as SB3 implements it, with tanh between layers.

    A budget is rounded down to whole rollouts; one of less than a rollout is one rollout, in whole batches as far as
    its steps allow.
    """

    algorithm_name = "PPO"
    recipe = shared.SHARED

    n_steps: shared.Count = 256
    """steps of all copies in a rollout"""
    batch_size: Annotated[int, Field(ge=2)] = 256
    n_epochs: shared.Count = 10
    """passes over a rollout"""
    gae_lambda: shared.Share = 0.95
    """of the generalised advantage estimate"""
    clip_range: shared.Positive = 0.2
    """of the ratio of probabilities"""
    ent_coef: shared.NotNegative = 0.0
    """weight of the entropy in the loss"""

    @property
    def stored(self) -> int:
        return self.n_steps * self.copies

    @property
    def rollout(self) -> int:
        return self.n_steps

    def fitted(self, lock_steps: int) -> Self:
        """The agent with a rollout that the budget has, if possible in whole batches, and batches no larger than it."""
        rollout = self.n_steps
        if lock_steps < rollout:
            whole = self.batch_size // math.gcd(self.batch_size, self.copies)
            rollout = lock_steps // whole * whole or lock_steps
        rollout = max(rollout, -(-2 // self.copies))  # SB3 wants two samples
        return replace(self, n_steps=rollout, batch_size=min(self.batch_size, rollout * self.copies))

    def exported(self, model: PPO, environment: Environment) -> Policy:
        layers = linear_layers([*model.policy.mlp_extractor.policy_net.children(), model.policy.action_net])
        return ActorPolicy(layers, shared.box_of(environment.actions), "tanh", squashed=False)
