"""The race of reward methods by successive halving, and the training of its winner with fresh seeds.

A rung is an ordinary study. Its budget is in the task file and its results are in a ledger, so a race that was stopped
goes on. Contestants are compared by the starts for selection, never by those of the report.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from stlbench.errors import UsageError
from stlbench.records.result import Result
from stlbench.registry import plugins
from stlbench.rollout.auto import automatic, in_turn
from stlbench.solver.problem import TASK, Posed
from stlbench.study.run import build_executor, run_study
from stlbench.study.tracks import own_agent_on
from stlbench.study.tuning import FIRST_SEED
from stlbench.task import Task, fitting_methods

_MOST = 4  # contestants
_TIMES = 3  # steps of a rung, over those of the one before
_FINAL_SEEDS = (200, 201)
_RACE, _FINAL = 0.4, 0.4
"""Shares of the time. The rest is for the first look, the certificate and the files."""
_EPISODES, _LEAST = 20, 3000
"""A training of fewer episodes, or of fewer steps, teaches nothing."""
_SCORING, _SCORED = 0.2, 64
"""The share of a final training that may go to checkpoints, and the starts from which each is scored at most."""
_ENOUGH = 100
"""Episodes of the first rung. Where the time does not suffice for so many, fewer methods race."""


def rank(result: Result) -> tuple[float, float]:
    """The better, the greater: satisfaction, then robustness, from the starts for selection."""
    if result.measurement is None:
        return -math.inf, -math.inf
    point = result.measurement.selection
    return point.satisfaction, point.robustness_mean


def contestants(task: Task) -> tuple[str, ...]:
    """At most four methods that fit."""
    derived = automatic(task, own_agent_on(task, "auto"))
    fitting = fitting_methods(derived)
    if not fitting:
        raise UsageError(
            f"no method fits the formula {task.formula}; there are {', '.join(plugins.available('methods'))}"
        )
    return in_turn(fitting, task.formula)[:_MOST]


@dataclass
class Clock:
    """The time that the user gave."""

    minutes: float
    _began: float = field(default_factory=time.monotonic)

    @property
    def spent(self) -> float:
        """Seconds."""
        return time.monotonic() - self._began

    @property
    def left(self) -> float:
        """Seconds, at least 0."""
        return max(0.0, 60 * self.minutes - self.spent)


@dataclass(frozen=True)
class Trainer:
    """Runs the cells of a problem."""

    posed: Posed
    clock: Clock
    say: Callable[[str], None]
    """Gets a header line for each phase."""
    progress: bool
    """Whether each study prints how it goes on."""
    executor: str = "local"
    jobs: int | None = None

    def train(self, folder: str, budget: str, methods: Sequence[str], seeds: Iterable[int]) -> list[Result]:
        """The results of these cells, the best first. Raises `UsageError` where none is done."""
        place = self.posed.folder / folder
        results = run_study(
            tasks=[TASK],
            methods=list(methods),
            seeds=list(seeds),
            budget=budget,
            track="auto",
            results=place,
            executor=self.executor,
            jobs=self.jobs,
            progress=self.progress,
        )
        ranked = sorted(results, key=rank, reverse=True)
        if ranked[0].measurement is None:
            raise UsageError(f"no training of {budget} ended well: {ranked[0].id.name}: {ranked[0].reason}")
        return ranked

    def race(self) -> Result:
        """The winner's best result; the probe where one method alone trains. Raises `UsageError` as `_plan`."""
        self.say("measuring the speed of a training")
        (best,) = self.train("race", "probe", contestants(self.posed.task)[:1], [FIRST_SEED])
        methods = self.posed.state["methods"] or self._plan(best)
        rung = 1
        while len(methods) > 1:
            steps = self.posed.task.budget(f"rung-{rung}").steps
            self.say(f"race, rung {rung}: {', '.join(methods)}, {steps} steps each")
            ranked = self.train("race", f"rung-{rung}", methods, [FIRST_SEED + rung])
            best, methods, rung = ranked[0], [str(each.id.method) for each in ranked[: -(-len(ranked) // 2)]], rung + 1
            if rank(best)[0] == 1:
                break
        return best

    def _plan(self, probe: Result) -> list[str]:
        """Choose as many contestants as the time lets learn, and write the budgets of the rungs.

        Raises `UsageError` where it is too short even for one.
        """
        apart, each = _cost(probe)
        methods, steps = list(contestants(self.posed.task)), self.posed.task.file.steps
        given = 60 * _RACE * self.clock.minutes
        least = max(_EPISODES * steps, _LEAST)
        if given < least * each:
            raise UsageError(
                f"{self.clock.minutes:g} minutes are too short: at {1 / each:.0f} steps a second they leave "
                f"{given / each:.0f} steps for a training, and {least} are the least; "
                f"about {least * each / (60 * _RACE):.2g} minutes are needed"
            )
        while len(methods) > 1:
            waves = _waves(len(methods), self._at_once)
            weight = sum(wave * _TIMES**rung for rung, wave in enumerate(waves))
            seconds = max(given / 2, given - apart * sum(waves))  # the probe may have compiled, which others need not
            first = int(seconds / (each * weight))
            if first >= _ENOUGH * steps:
                for rung in range(len(waves)):
                    self._write(f"rung-{rung + 1}", first * _TIMES**rung, each, checkpoints=10)
                break
            methods.pop()
        self.posed.remember(methods=methods)
        return methods

    def _write(self, name: str, steps: int, each: float, checkpoints: int) -> None:
        """Write a budget of about so many steps, `each` of which takes so many seconds."""
        hold = self.posed.task.file.hold
        self.posed.budget(
            name,
            steps=steps // hold * hold,
            seeds=1,
            deadline=float(round(max(900, 5 * steps * each))),
            checkpoints=checkpoints,
            random_starts=0,
        )

    @property
    def _at_once(self) -> int:
        """Trainings that the executor runs at a time."""
        return build_executor(self.executor, self.jobs).jobs

    def final(self, winner: Result) -> list[Result]:
        """The winner, trained with fresh seeds, the best first."""
        if "final" not in self.posed.task.file.budgets:
            apart, each = _cost(winner)
            seconds = max(_FINAL * 60 * self.clock.minutes, self.clock.left - 12 * self.clock.minutes)
            one = seconds / -(-len(_FINAL_SEEDS) // self._at_once)
            checkpoints = int(np.clip(_SCORING * one / (_SCORED * self.posed.episode_seconds), 5, 20))
            steps = int(max(one / 2, one - apart) / each)
            assert winner.measurement is not None
            self._write("final", max(steps, winner.measurement.env_steps), each, checkpoints)
        steps = self.posed.task.budget("final").steps
        method = str(winner.id.method)
        self.say(f"final: {method}, {len(_FINAL_SEEDS)} fresh seeds, at most {steps} steps each")
        return self.train("final", "final", [method], _FINAL_SEEDS)


def _cost(result: Result) -> tuple[float, float]:
    """Seconds of a cell apart from its training, which hardly depend on the steps; and seconds of training per step."""
    measured = result.measurement
    assert measured is not None
    return measured.wall_seconds - measured.training_wall_seconds, measured.training_wall_seconds / measured.env_steps


def _waves(count: int, jobs: int) -> list[int]:
    """For each rung, how many of its cells run one after another."""
    waves = []
    while count > 1:
        waves.append(-(-count // jobs))
        count = -(-count // 2)
    return waves
