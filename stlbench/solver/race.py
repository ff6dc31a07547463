"""The race of reward methods by successive halving, and the training of its winner with fresh seeds.

A rung is an ordinary study. Its budget is in the task file and its results are in a ledger, so a race that was stopped
goes on. Contestants are compared by the starts for selection, never by those of the report.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.result import Result
from stlbench.records.result_files import cell_files
from stlbench.registry.choices import LOCAL, Choice
from stlbench.solver import tries
from stlbench.solver.contestants import (
    Contestant,
    along,
    best_first,
    better_half,
    by_second_recipe,
    contestants,
    cost,
    enough_afresh,
    gains,
    playing,
    rank,
    resumes,
    searcher,
    waves,
)
from stlbench.solver.earlier import EarlierPolicy
from stlbench.solver.outlook import Outlook, outlook
from stlbench.solver.solution import FINAL, MORE, RACE, cells_of
from stlbench.solver.workspace import Workspace
from stlbench.study.run import run_study
from stlbench.study.scheduler import build_executor
from stlbench.study.tuning import FIRST_SEED
from stlbench.task.build import INIT

_RUNG_RATIO = 3  # seconds of a rung, over those of the one before
FINAL_SEEDS = (200, 201)
_APART = 1000  # the distance of the seeds of one try from those of the next
_DELIVERY_SHARE = 0.2
"""The share of the time for certificate, counterexamples and files. The final training has what the race leaves."""
_PROBE_SHARE = 0.1
"""The share of the time for the training that measures the speed. It ends at the first checkpoint after it."""
_SUM_SHARE, _SUM_MINUTES = 0.2, 10.0
"""The share of the time for a training by an agent without a discount; half as much for one that follows windows. It is
a share of at most so many minutes: on 30 nested formulas none that found a policy had taken 40 s."""
_PLAYED = "witness.npz"  # the policy that plays the witness
_LEAST_SUM_EPISODES, _GAIN_EPISODES = 1000, 30
"""Episodes of such a training, at least, and those for each number of a linear policy: fewer seldom teach it. Of 96
runs of `cma-es` on drawn tasks 30 learned, and 23 of them after 30 episodes or more for each number."""
_PROBE_CHECKPOINTS = 10
"""Its checkpoints, at most. Each is scored from all starts, which is dear; and the probe ends at one."""
_SCORING_SHARE, _CHECKPOINTS = 0.2, (4, 20)
"""The share of a training's time that may go to checkpoints, and how many of these there are at least and at most."""
_CHECKPOINT_STARTS = 8  # starts from which a checkpoint is scored during a training, at least
_PATIENCE = 0  # a training of the race ends at the first checkpoint that satisfies from all starts for selection
_PROMISING_SHARE = 0.5
"""A method whose best and last policies satisfy from such a share of the starts from which no baseline does learns: the
race ends, and it trains on."""
_FIRST_RUNG_EPISODES = 100
"""Episodes of the first rung. If the time does not suffice for so many, fewer methods race."""
_MOST_WINNER_STEPS = 4  # the final training has at most so many times those of a winner that satisfied from all starts
_LOOK_SHARE, _LOOK_STARTS = 0.02, (100, 500)
"""The share of the time for a look from further starts, and how many these are at least and at most."""
_SIDE_BY_SIDE = 2  # trainings that go on
_OTHER_SPEED = 2  # by another recipe than that of the probe a rung has at most so many times the steps; seconds end it
_OVERTIME = 1.15  # a training that is slower than planned ends after so many times the seconds planned
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

    def train(
        self,
        budget: str,
        who: Sequence[Contestant],
        seeds: Sequence[int],
        enough: Callable[[Result], bool],
        init: Path | None = None,
    ) -> list[Result]:
        """The results of these cells, the best first; perhaps from a policy.

        They end with the first that is `enough`. If the time before the delivery is too short, no more begin, but
        those that run side by side all end. A study has one task and one agent. Raises `UsageError` where the rows of
        all are damaged.
        """
        half, ended = (self.workspace.task.budget(budget).seconds or 0.0) / 2, list[Result]()
        place = self.workspace.folder / cells_of(budget)

        def is_last(result: Result) -> bool:
            ended.append(result)
            return enough(result) or (len(ended) % self._at_once == 0 and self._left <= half)

        results = list[Result]()
        for task, agent in dict.fromkeys((each.task, each.agent) for each in who):
            if results and (any(map(enough, results)) or self._left <= half):
                break
            results += run_study(
                tasks=[task],
                methods=[each.method for each in who if (each.task, each.agent) == (task, agent)],
                agents=[agent],
                seeds=[seed + _APART * self.seed for seed in seeds],
                budget=budget,
                track="auto",
                init=init or (None if self.start is None else self.start.path),
                results=place,
                executor=self.executor,
                jobs=self.jobs,
                progress=self.progress,
                until=is_last,
            )
        if not results:
            raise UsageError(f"no result of {budget} in {place} can be read; `stlbench verify {place} --repair`")
        return sorted(results, key=rank, reverse=True)

    @property
    def _left(self) -> float:
        """Seconds until the delivery."""
        return max(0.0, self.clock.left - _DELIVERY_SHARE * 60 * self.clock.minutes)

    def race(self) -> Result:
        """The best result; its method is the winner. Raises `UsageError` as `_plan`."""
        self.say("measuring the speed of a training")
        known = None if self.start is None else self.start.trained_by
        racing = [*contestants(self.workspace.task, self.clock.minutes, known)]
        # seconds end the probe: its steps could take all time, as nothing is known of the speed yet
        steps, seconds = self.workspace.task.budget("probe").steps, _PROBE_SHARE * 60 * self.clock.minutes
        lasting = steps / self.workspace.task.file.steps * self.workspace.episode_seconds
        few = _PROBE_CHECKPOINTS if lasting > seconds else min(_PROBE_CHECKPOINTS, self._training(seconds, 0.0)[0])
        self._write("probe", steps, seconds, few, _PATIENCE)
        (probe,) = self.train("probe", racing[:1], [FIRST_SEED], _satisfies)
        if probe.measurement is None:
            raise UsageError(f"no training ended well: {probe.id.name}: {probe.reason}")
        if _satisfies(best := probe):
            return best
        if self.start is None and not self._is_promising(best):
            best = self._searched(self.workspace.unscheduled, "search", _SUM_SHARE, best)
        if rank(best)[0] == 0 and (found := self.workspace.search(60 * self.clock.minutes)):
            self.say(found)
        if self.start is None and not self._is_promising(best) and (course := self.workspace.course) is not None:
            best = self._searched(self.workspace.unscheduled, "search-witness", _SUM_SHARE / 2, best, course)
        if self.start is None:
            choices = self.workspace.choices
            if len(choices) > 1 and not self._is_promising(best):
                best = self._searched(choices[:1], "search-windows", _SUM_SHARE / 2, best)
            racing = list(along(by_second_recipe(racing, self.workspace.task), choices))
        if _satisfies(best):
            return best
        methods = self.workspace.state["methods"]  # a race that was stopped has them
        racing = racing[: self._plan(racing, probe) if methods is None else len(methods)]
        rung = 1
        while len(racing) > 1 and not self._is_promising(best) and self._left:
            self.say(f"race, rung {rung}: {', '.join(each.beside(racing[0]) for each in racing)}; {_score(best)}")
            # another seed in each rung, so that a lucky one does not carry a method to the end
            ranked = self.train(f"rung-{rung}", racing, [FIRST_SEED + rung], self._is_promising)
            best = max(ranked[0], best, key=rank)
            racing, rung = better_half(ranked, racing), rung + 1
        return best

    def _searched(
        self, choices: Sequence[Choice], budget: str, share: float, best: Result, course: Array | None = None
    ) -> Result:
        """The better of a result and of that of an agent without a discount, on the first of some choices.

        It begins with a course of actions, if there is one and the agent can play it.
        """
        task = self.workspace.task
        checkpoints, seconds = self._training(share * 60 * min(self.clock.minutes, _SUM_MINUTES), 0.0)
        # its speed is not known; it is at most that of the simulation, and the seconds end it
        episodes = seconds / (self.workspace.episode_seconds + self.workspace.copy_seconds)  # a copy plays few of them
        if episodes < _LEAST_SUM_EPISODES or (contestant := searcher(task, choices)) is None:
            return best
        init = None if course is None else playing(contestant, course, self.workspace.folder / _PLAYED)
        if init is None and (course is not None or episodes < _GAIN_EPISODES * gains(contestant)):
            return best
        begun = "" if init is None else ", from the witness"
        self.say(f"{contestant} with {contestant.agent}{begun}; {_score(best)}")
        steps = int(episodes * task.file.steps)
        self._write(budget, steps, seconds / _OVERTIME, checkpoints, _PATIENCE)
        return max([best, *self.train(budget, [contestant], [FIRST_SEED], _satisfies, init)], key=rank)

    def kept(self) -> list[Result]:
        """The policies that were trained so far, the best first; at equal shares the final training before the race."""
        finals, race = (self._done(folder) for folder in (FINAL, RACE))
        return best_first(finals, race)

    def _done(self, folder: str) -> list[Result]:
        place = self.workspace.folder / folder
        there = results_folder.read(place) if results_folder.locate(place) else ()
        return [each for each in there if each.measurement is not None]

    def _plan(self, racing: Sequence[Contestant], probe: Result) -> int:
        """How many contestants, the first of them, the time lets learn; write them, and the budgets of the rungs.

        Raises `UsageError` where it is too short even for one.
        """
        apart, each = cost(probe, self._scoring)
        steps, given = self.workspace.task.file.steps, 60 * tries.RACE_SHARE * self.clock.minutes
        least = tries.least(self.workspace.task)
        if given < least * each:
            raise UsageError(
                f"{self.clock.minutes:g} minutes are too short: at {1 / each:.0f} steps a second they leave "
                f"{given / each:.0f} steps for a training, and {least} are the least; "
                f"about {tries.least_minutes(self.workspace.task, each):.2g} minutes are needed"
            )
        count = len(racing)
        most = 1 if racing[0].agent == str(probe.id.agent) else _OTHER_SPEED
        while count > 1:
            rungs = waves(count, self._at_once)
            shared = self._left if len(rungs) == 1 else min(given, self._left / 2)  # one rung is the final training
            first = shared / sum(wave * _RUNG_RATIO**rung for rung, wave in enumerate(rungs))
            checkpoints, seconds = self._training(first, apart)
            if seconds >= _FIRST_RUNG_EPISODES * steps * each and first >= 2 * apart:
                for rung in range(len(rungs)):
                    checkpoints, seconds = self._training(first * _RUNG_RATIO**rung, apart)
                    self._write(f"rung-{rung + 1}", int(most * seconds / each), seconds, checkpoints, _PATIENCE)
                break
            count -= 1
        self.workspace.remember(methods=[contestant.method for contestant in racing[:count]])
        return count

    def _training(self, seconds: float, apart: float) -> tuple[int, float]:
        """For a cell of so many seconds: its checkpoints, and the seconds of its training."""
        checkpoints = int(np.clip(_SCORING_SHARE * seconds / self._scoring, *_CHECKPOINTS))
        return checkpoints, max(seconds / 2, seconds - apart - checkpoints * self._scoring)

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
            seconds=round(max(0.1, _OVERTIME * seconds), 1),
            deadline=float(round(_HANGING_SECONDS + 3 * seconds)),
            checkpoints=checkpoints,
            random_starts=0,
            patience=patience,
            resumable=True,
        )

    def _is_promising(self, result: Result) -> bool:
        """Whether it learns: not if it hardly beats a baseline, or was good for one moment of an unstable training."""
        if result.measurement is None:
            return False
        stated = self.workspace.task.file.baselines
        idle = max(each.satisfied for each in (stated.zero, stated.constant, stated.random)) if stated else 0.0
        share = min(rank(result)[0], result.measurement.curve[-1].satisfaction)
        return _satisfies(result) or share >= idle + _PROMISING_SHARE * (1 - idle)

    @property
    def _at_once(self) -> int:
        """Trainings that the executor runs at a time."""
        return build_executor(self.executor, self.jobs).jobs

    def final(self, winner: Result) -> list[Result]:
        """The winner, trained with fresh seeds until one satisfies from all starts for selection; the best first.

        There is none where the time before the delivery is too short: a fresh seed would learn less than the winner.
        """
        assert winner.measurement is not None
        enough = enough_afresh(winner)
        if self._left < enough and not self._done(FINAL):
            self.say("too little time is left to train again with fresh seeds")
            return []
        if FINAL not in self.workspace.task.file.budgets:
            apart, each = cost(winner, self._scoring)
            turns = -(-len(FINAL_SEEDS) // self._at_once)
            if self._left / turns < enough:
                turns = 1  # one seed for all of the time
            checkpoints, seconds = self._training(self._left / turns, apart)
            steps = int(seconds / each)
            if rank(winner)[0] == 1:
                steps = min(steps, _MOST_WINNER_STEPS * winner.measurement.env_steps)
            self._write(FINAL, steps, seconds, checkpoints)
        contestant, steps = Contestant.of(winner), self.workspace.task.budget(FINAL).steps
        self.say(f"final: {contestant}, fresh seeds, at most {steps} steps each; {_score(winner)}")
        begun = INIT in dict(winner.id.agent.parameters) and self.start is None
        init = self.workspace.folder / _PLAYED if begun else None
        return self.train(FINAL, [contestant], FINAL_SEEDS, _satisfies, init)

    # ------------------------------------------------------------------------------------------------------ going on

    def improve(self, trained: Sequence[Result]) -> list[Result]:
        """Train on while time is left, and further starts show that the certificate can rise; the best first.

        In turn, from the best policy and from fresh networks: the other way follows one that was no better.
        """
        known = {each.key: each for each in (*trained, *self._done(FINAL))}
        if (chosen := known.pop(self.workspace.state["chosen"], None)) is not None:
            return [chosen, *known.values()]
        if not self._left:  # on a slow environment the look itself takes long
            return [*trained]
        best, others = trained[0], [*trained[1:]]
        seen, onward = self._outlook(best), True
        for turn in count(1):
            if not seen.can_rise or not self._plan_more(f"{MORE}{turn}", best):
                break
            contestant, first = Contestant.of(best), FINAL_SEEDS[-1] + 1 + _SIDE_BY_SIDE * (turn - 1)
            onward = onward or self._left < enough_afresh(best)
            init = self._policy_of(best) if onward and resumes(contestant.agent) else None
            begun = "fresh networks" if self.start is None else "the earlier solution"
            how = begun if init is None else "the best policy"
            self.say(f"training on, from {how}: {contestant}; {seen}")
            seeds = range(first, first + min(_SIDE_BY_SIDE, self._at_once))
            rose = False
            for result in self.train(f"{MORE}{turn}", [contestant], seeds, lambda result: False, init):
                now = seen if result.measurement is None else self._outlook(result)
                if self._share(result, now) > self._share(best, seen):
                    others.append(best)
                    best, seen, rose = result, now, True
                else:
                    others.append(result)
            onward = onward == rose
        self.workspace.remember(chosen=best.key)
        return [best, *others]

    def _share(self, result: Result, seen: Outlook) -> tuple[float, float]:
        """The share that satisfies of the further starts and those for selection together, then the robustness."""
        share, robustness = rank(result)
        starts = self.workspace.task.file.starts
        return (seen.satisfied + starts * share) / (seen.starts + starts), robustness

    def _outlook(self, result: Result) -> Outlook:
        starts = int(np.clip(_LOOK_SHARE * 60 * self.clock.minutes / self.workspace.episode_seconds, *_LOOK_STARTS))
        return outlook(self.workspace.folder / cells_of(result.id.budget), result, starts)

    def _policy_of(self, result: Result) -> Path:
        files = cell_files(self.workspace.folder / cells_of(result.id.budget), result.id, result.key)
        return files.training if files.training.is_file() else files.policies

    def _plan_more(self, budget: str, best: Result) -> bool:
        """Write the budget of one more training, of half of the time that is left or of all; whether one fits."""
        if budget in self.workspace.task.file.budgets:
            return True  # a solve that was stopped has written it
        apart, each = cost(best, self._scoring)
        assert best.measurement is not None
        if self._left < 2 * (apart + tries.least(self.workspace.task) * each):
            return False
        half = self._left / 2
        checkpoints, seconds = self._training(half if half >= best.measurement.wall_seconds else self._left, apart)
        self._write(budget, int(seconds / each), seconds, checkpoints, patience=checkpoints)
        return True


def _satisfies(result: Result) -> bool:
    return rank(result)[0] == 1


def _score(result: Result) -> str:
    satisfaction, robustness = rank(result)
    return f"best so far {100 * satisfaction:.0f} %, robustness {robustness:.3g}"
