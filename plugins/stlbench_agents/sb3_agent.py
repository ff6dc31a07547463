"""Training by Stable-Baselines3, on the very same environment and reward as by stlbench's own agents."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any

from stlbench.contract import Agent, Environment, Policy, Training
from stlbench_agents.marks import spread
from stlbench_agents.one_thread import one_thread

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

__all__ = ["SB3Agent", "falling"]


class SB3Agent(Agent):
    """An algorithm of SB3: what its subclasses, one an algorithm, have in common."""

    copies: int
    """Environments in lock-step."""

    @abstractmethod
    def model(self, environment: Environment, seed: int, most: int) -> BaseAlgorithm:
        """SB3's model, untrained, for a budget of `most` lock-steps."""

    @abstractmethod
    def exported(self, model: Any, environment: Environment) -> Policy:
        """The model's deterministic policy as it is now."""

    def rollout(self, most: int) -> int:
        """Lock-steps that the algorithm takes at a time, where the budget has `most`."""
        return 1

    def train(self, training: Training) -> Policy:
        """Spend the budget; return the deterministic policy at its end.

        SB3 seeds and uses the process's global generators (random, NumPy, torch).
        """
        with one_thread():
            return self._train(training)

    def _train(self, training: Training) -> Policy:
        from stlbench_agents.sb3_bridge import Checkpoints

        environment = training.make(self.copies)
        most = max(1, training.steps // (self.copies * environment.hold))
        size, rounds = self.copies * self.rollout(most), most // self.rollout(most)
        model = self.model(environment, training.seed % 2**32, most)
        final: Policy

        def report() -> None:
            nonlocal final
            final = self.exported(model, environment)
            training.report(final, model.num_timesteps * environment.hold)

        marks = [size * done for done in sorted(spread(rounds, training.checkpoints))[:-1]]
        never = training.steps + 1
        model.learn(rounds * size, callback=Checkpoints(marks, report), log_interval=never)
        return final

    def made(self, algorithm: type[Any], environment: Environment, seed: int, **options: Any) -> Any:
        """SB3's model of an algorithm with its options; silent, and nothing of it is written to disk."""
        from stable_baselines3.common.logger import Logger

        from stlbench_agents.sb3_bridge import CopiesVecEnv

        copies = CopiesVecEnv(environment, options["gamma"])
        model = algorithm("MlpPolicy", copies, device="cpu", seed=seed, **options)
        model.set_logger(Logger(folder=None, output_formats=[]))
        return model


def falling(first: float, last: float) -> Any:
    """SB3's schedule, a function of the share of training that is left: geometric from `first` to `last`."""
    return lambda left: last * (first / last) ** left
