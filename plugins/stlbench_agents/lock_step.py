"""Training in lock-step, as `dqn` and `td3` do it: parameters, the loop, counterfactual transitions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from stlbench.contract import Array, CounterfactualEnvironment, Environment, Integers, Policy, Training, Transition
from stlbench_agents.compiled_code import CompiledAgent
from stlbench_agents.recipes import OffPolicy, Positive, ShareBelow1
from stlbench_agents.training import report_rounds


class LockStepLearner(Protocol):
    """What is trained."""

    def act(self, observation: Array) -> Any:
        """The environment's actions at observations (N, D): exploring ones, of the next step."""

    def learn(self, observation: Array, action: Any, transition: Transition) -> None:
        """Store that step, and update."""

    def policy(self) -> Policy:
        """The policy as it is now, which later updates do not change."""

    def resume(self, policy: Any) -> None:
        """Start from the networks of an earlier policy, before the first step. Raises `Unsuitable` for other sizes."""


@dataclass(frozen=True, kw_only=True)
class LockStepAgent(OffPolicy, CompiledAgent):
    """An agent whose learner is updated after each step of all copies."""

    averaging: ShareBelow1 = 0.0
    """reported policies have an exponential average of the weights, with this weight on the past at each of their
    updates; 0: the weights themselves. Actions in training are those of the current weights"""
    reward_scale: Positive = 1.0
    """factor on rewards, which arrive divided by the method's `scale`. They are also weighted by 1 - gamma, so that
    values keep the scale of the reward; with gamma = 1 they are not"""

    resumes = True

    @abstractmethod
    def begin(self, environment: Environment, seed: int, rounds: int) -> LockStepLearner:
        """A fresh learner, for so many steps of all copies. Raises `Unsuitable` if the actions are of another kind."""

    def train(self, training: Training) -> Policy:
        environment = training.make(self.copies)
        rounds = max(1, training.steps // (self.copies * environment.hold))
        learner, reports = self.begin(environment, training.seed, rounds), report_rounds(rounds, training.checkpoints)
        if training.initial is not None:
            learner.resume(self.restore(training.initial, environment.actions))
        observation = environment.reset()
        for done in range(1, rounds + 1):
            action = learner.act(observation)
            transition = environment.step(action)
            learner.learn(observation, action, transition)
            observation = transition.observation
            if done in reports:
                final = learner.policy()
                if training.report(final, done * self.copies * environment.hold):
                    break
        return final


class Counterfactuals:
    """Adds the counterfactual transitions of an environment, as many of each as its method asks for.

    They stand alone, as returns of one reward, and take places in the same replay.
    """

    def __init__(self, environment: Environment, seed: int) -> None:
        self._environment: CounterfactualEnvironment | None = None
        if isinstance(environment, CounterfactualEnvironment) and environment.counterfactuals > 0:
            self._environment = environment
        self._times = 0 if self._environment is None else self._environment.counterfactuals
        self._generator = np.random.default_rng([seed, 1, 1])
        self.copies = environment.count * (1 + self._times)

    def added(self, observation: Array, action: Integers, transition: Transition) -> tuple[Array, Integers, Transition]:
        """A lock-step of N copies (N, D), (N,), followed by the counterfactual ones: `copies` rows each."""
        if self._environment is None:
            return observation, action, transition
        drawn = [self._environment.counterfactual(self._generator) for _ in range(self._times)]
        columns: Iterable[Any] = zip(transition, *(after for _, after in drawn), strict=True)
        observations = np.concatenate([observation, *(before for before, _ in drawn)])
        return observations, np.tile(action, 1 + self._times), Transition(*map(np.concatenate, columns))
