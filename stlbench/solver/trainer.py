"""The trainings of a solve, and the time for them: each is a cell of an ordinary study.

Its budget is in the task file and its result is in a ledger, so a solve that was stopped goes on. Results are compared
by the starts for selection, never by those of the report.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.result import Result
from stlbench.records.result_files import CellFiles, cell_files
from stlbench.registry.choices import LOCAL
from stlbench.solver.contestants import Contestant, best_first, has_learned, rank, wall_seconds
from stlbench.solver.earlier import EarlierPolicy
from stlbench.solver.solution import FINAL, RACE, cells_of
from stlbench.solver.workspace import Workspace
from stlbench.study.run import run_study
from stlbench.study.scheduler import build_executor

APART = 1000  # the distance of the seeds of one try from those of the next
_DELIVERY_SHARE = 0.15
"""The share of the time for certificate, counterexamples and files. The final training has what the race leaves."""
_SCORING_SHARE, _CHECKPOINTS = 0.2, (2, 20)
"""The share of a training's time that may go to checkpoints, and how many of these there are at least and at most."""
_CHECKPOINT_STARTS = 8  # starts from which a checkpoint is scored during a training, at least
OVERTIME = 1.15  # a training that is slower than planned ends after so many times the seconds planned
_HANGING_SECONDS = 600.0  # beyond three times its own, a training may take so many; only one that hangs takes longer


@dataclass
class Clock:
    """The time that the user gave."""

    minutes: float
    _began: float = field(default_factory=lambda: time.perf_counter())

    @property
    def spent(self) -> float:
        """Seconds."""
        return time.perf_counter() - self._began

    @property
    def left(self) -> float:
        """Seconds, at least 0."""
        return max(0.0, 60 * self.minutes - self.spent)


@dataclass(frozen=True)
class Trainer:
    """Runs the cells of a problem."""

    workspace: Workspace
    clock: Clock
    say: Callable[[str], None]
    """Gets a header line for each phase."""
    progress: bool
    """Whether each study prints how it goes on."""
    executor: str = LOCAL
    jobs: int | None = None
    start: EarlierPolicy | None = None
    """The policy from which all trainings start."""
    seed: int = 0
    """The number of the try. Each has other seeds."""
    _seconds: dict[str, float] = field(default_factory=dict)
    """Key of a result -> wall seconds of its training and of those that it goes on with."""

    def train(
        self,
        budget: str,
        who: Sequence[Contestant],
        seeds: Sequence[int],
        enough: Callable[[Result], bool],
        init: Path | None = None,
        after: Sequence[Result] = (),
    ) -> list[Result]:
        """The results of these cells, the best first; all from a policy, or each after the result of its contestant.

        They end with the first that is `enough`. If the time before the delivery is too short, no more begin, but
        those that run side by side all end. A study has one task, and one agent unless the methods of others are the
        same. Raises `UsageError` where the rows of all are damaged.
        """
        half, ended = (self.workspace.task.budget(budget).seconds or 0.0) / 2, list[Result]()
        place = self.workspace.folder / cells_of(budget)

        def is_last(result: Result) -> bool:
            ended.append(result)
            return enough(result) or (len(ended) % self._at_once == 0 and self._left <= half)

        before, studies = {Contestant.of(each): each for each in after}, dict[tuple[Any, ...], list[str]]()
        for task, agent in dict.fromkeys((each.task, each.agent) for each in who):
            own = [each for each in who if (each.task, each.agent) == (task, agent)]
            files = tuple((each.method, self._file_of(before[each])) for each in own if each in before)
            studies.setdefault((task, tuple(each.method for each in own), files), []).append(agent)
        results = list[Result]()
        for (task, methods, files), agents in studies.items():
            if results and (any(map(enough, results)) or self._left <= half):
                break
            results += run_study(
                tasks=[task],
                methods=methods,
                agents=agents,
                seeds=[seed + APART * self.seed for seed in seeds],
                budget=budget,
                track="auto",
                init=init or dict(files) or (None if self.start is None else self.start.path),
                results=place,
                executor=self.executor,
                jobs=self.jobs,
                progress=self.progress,
                until=is_last,
            )
        if not results:
            raise UsageError(f"no result of {budget} in {place} can be read; `stlbench verify {place} --repair`")
        for result in results:
            earlier = before.get(Contestant.of(result))
            self._seconds[result.key] = wall_seconds(result) + (self._lasted(earlier) if earlier else 0.0)
        return sorted(results, key=rank, reverse=True)

    def _lasted(self, result: Result) -> float:
        """Wall seconds of a training and of those that it goes on with."""
        return self._seconds.get(result.key, wall_seconds(result))

    def _files(self, result: Result) -> CellFiles:
        return cell_files(self.workspace.folder / cells_of(result.id.budget), result.id, result.key)

    def _file_of(self, result: Result) -> Path:
        """The file from which a training goes on with that of a result, else that of its policies."""
        files = self._files(result)
        return files.training if files.training.is_file() else files.policies

    def _goes_on(self, result: Result) -> bool:
        """Whether a training goes on with that of a result.

        Without success its noise and its learning rate are too small by now: on HalfCheetah `raw` learned in 21 s from
        fresh networks, and not in 36 s after 12 others.
        """
        return self._files(result).training.is_file() and has_learned(result, self.workspace.task)

    @property
    def _left(self) -> float:
        """Seconds until the delivery."""
        return max(0.0, self.clock.left - _DELIVERY_SHARE * 60 * self.clock.minutes)

    def chosen(self) -> list[Result] | None:
        """What `improve` gave, if it has ended in this time before: the best first."""
        known = {each.key: each for each in self.kept()}
        best = known.pop(self.workspace.state["chosen"], None)
        return None if best is None else [best, *known.values()]

    def kept(self) -> list[Result]:
        """The policies that were trained so far, the best first; at equal shares the final training before the race."""
        finals, race = (self._done(folder) for folder in (FINAL, RACE))
        return best_first(finals, race)

    def _done(self, folder: str) -> list[Result]:
        place = self.workspace.folder / folder
        there = results_folder.read(place) if results_folder.locate(place) else ()
        return [each for each in there if each.measurement is not None]

    def _training(self, seconds: float, apart: float) -> tuple[int, float]:
        """For a cell of so many seconds: its checkpoints, and the seconds of its training."""
        checkpoints = self._checkpoints(seconds, _CHECKPOINTS)
        return checkpoints, max(seconds / 2, seconds - apart - checkpoints * self._scoring)

    def _checkpoints(self, seconds: float, limits: tuple[int, int]) -> int:
        return int(np.clip(_SCORING_SHARE * seconds / self._scoring, *limits))

    @property
    def _scoring(self) -> float:
        """Seconds of a checkpoint."""
        return (self.workspace.task.file.starts + _CHECKPOINT_STARTS) * self.workspace.episode_seconds

    def _write(self, name: str, steps: int, seconds: float, checkpoints: int, patience: int | None = None) -> None:
        """Write a budget of about so many steps, which should take so many seconds."""
        hold = self.workspace.task.file.hold
        self.workspace.budget(
            name,
            steps=steps // hold * hold,
            seeds=1,
            seconds=round(max(0.1, OVERTIME * seconds), 1),
            deadline=float(round(_HANGING_SECONDS + 3 * seconds)),
            checkpoints=checkpoints,
            random_starts=0,
            patience=patience,
            resumable=True,
        )

    @property
    def _at_once(self) -> int:
        """Trainings that the executor runs at a time."""
        return build_executor(self.executor, self.jobs).jobs
