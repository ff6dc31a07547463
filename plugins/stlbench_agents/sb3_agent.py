"""Training by Stable-Baselines3, on the same environment and reward as stlbench's own agents."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import asdict, dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

from stlbench.contract import ActionGrid, Actions, Arrays, Cost, Environment, Policy, Training
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.recipes import Learner, OffPolicy, Whole
from stlbench_agents.training import box_of, cost_of, grid_of, need_sb3, report_rounds

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


@dataclass(frozen=True, kw_only=True)
class SB3Agent(Learner):
    """An algorithm of SB3: the training that all have in common. Names and meanings of parameters are SB3's."""

    def __post_init__(self) -> None:
        need_sb3()

    algorithm_name: ClassVar[str]
    takes_grid: ClassVar[bool] = False
    """Whether it takes a grid of actions, or else continuous ones."""

    def algorithm(self) -> type[BaseAlgorithm]:
        """SB3's class. Imports SB3, which takes seconds."""
        return cast("type[BaseAlgorithm]", getattr(import_module("stable_baselines3"), self.algorithm_name))

    @abstractmethod
    def exported(self, model: Any, environment: Environment) -> Policy:
        """The model's deterministic policy as it is now. Raises `Unsuitable` where the actions are of another kind."""

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        return ActorPolicy.of(arrays, box_of(actions))

    def options(self, environment: Environment) -> dict[str, Any]:
        """The keyword arguments of SB3's class. Raises `Unsuitable` where the task's actions are of the other kind."""
        (grid_of if self.takes_grid else box_of)(environment.actions)
        options = asdict(self)
        del options["copies"]
        options["policy_kwargs"] = {"net_arch": list(options.pop("net_arch"))}
        first, last = self.learning_rate, options.pop("learning_rate_final")
        options["learning_rate"] = lambda left: last * (first / last) ** left  # `left` is a share of the training
        return options

    def fitted(self, lock_steps: int) -> Self:
        """The same agent, where need be with smaller numbers, for a budget of so many steps of all copies."""
        return self

    @property
    @abstractmethod
    def stored(self) -> int:
        """Transitions in memory at the same time, at most."""

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost:
        outputs = actions.size if isinstance(actions, ActionGrid) else len(actions.names)
        return cost_of(size, self.net_arch, outputs, min(decisions, self.stored))

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
        model = self.model(environment, training.seed % 2**32)
        final: Policy

        def report() -> bool:
            nonlocal final
            final = self.exported(model, environment)
            return bool(training.report(final, model.num_timesteps * environment.hold))

        before_the_end = sorted(report_rounds(rounds, training.checkpoints))[:-1]
        never = training.steps + 1
        callback = Checkpoints([size * done for done in before_the_end], report)
        model.learn(rounds * size, callback=callback, log_interval=never)
        return final


@dataclass(frozen=True, kw_only=True)
class SB3OffPolicy(SB3Agent, OffPolicy):
    """An algorithm of SB3 with a replay."""

    learning_starts: Whole = 800
    """transitions, with random actions, before the first update"""

    @property
    def stored(self) -> int:
        return self.buffer_size

    def options(self, environment: Environment) -> dict[str, Any]:
        return super().options(environment) | {"train_freq": 1}  # an update after each step of all copies
