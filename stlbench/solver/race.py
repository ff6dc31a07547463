"""The race of reward methods by successive halving, and trainings after it: from the winner, or with fresh seeds."""

from collections.abc import Sequence
from itertools import count

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.solver import tries
from stlbench.solver.contestants import (
    Contestant,
    along,
    better_half,
    by_second_recipe,
    contestants,
    cost,
    gains,
    has_learned,
    playing,
    rank,
    resumes,
    satisfies,
    searcher,
    waves,
)
from stlbench.solver.outlook import Outlook, outlook
from stlbench.solver.solution import FINAL, MORE, cells_of
from stlbench.solver.trainer import OVERTIME, Trainer
from stlbench.study.tuning import FIRST_SEED
from stlbench.task.build import INIT

_RUNG_RATIO = 3  # seconds of a rung, over those of the one before
FINAL_SEEDS = (200, 201)
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
_PROMISING_SHARE = 0.5
"""A race ends with a method whose best and last policies satisfy from such a share of the starts from which no baseline
does."""
_FRESH_RATIO = 1.5  # seconds for a training by fresh seeds, over those of the winner, at least; a second one needs both
_PATIENCE = 0  # a training of the race ends at the first checkpoint that satisfies from all starts for selection
_FIRST_RUNG_EPISODES, _OVER_PROBE = 100, 2
"""Episodes of the first rung, and its steps over those of the probe, which learned too little. If the time does not
suffice for so many, fewer methods race."""
_MOST_WINNER_STEPS = 4  # the final training has at most so many times those of a winner that satisfied from all starts
_LOOK_SHARE, _LOOK_STARTS = 0.02, (100, 500)
"""The share of the time for a look from further starts, and how many these are at least and at most."""
_SIDE_BY_SIDE = 2  # trainings that go on
_OTHER_SPEED = 2  # by another recipe than that of the probe a rung has at most so many times the steps; seconds end it


class Race(Trainer):
    """Trains contestants, the better ones for longer, then trains on from the best."""

    def race(self) -> Result:
        """The best result; its method is the winner. Raises `UsageError` as `_plan`."""
        self.say("measuring the speed of a training")
        known = None if self.start is None else self.start.trained_by
        racing = [*contestants(self.workspace.task, self.clock.minutes, known)]
        # seconds end the probe: its steps could take all time, as nothing is known of the speed yet
        steps, seconds = self.workspace.task.budget("probe").steps, _PROBE_SHARE * 60 * self.clock.minutes
        lasting = steps / self.workspace.task.file.steps * self.workspace.episode_seconds
        few = _PROBE_CHECKPOINTS if lasting > seconds else self._checkpoints(seconds, (1, _PROBE_CHECKPOINTS))
        self._write("probe", steps, seconds, few, _PATIENCE)
        probing = racing[:1]
        if self.start is None and self._at_once > 1:  # a core is idle, so that the second recipe costs no time
            probing = [*dict.fromkeys([*probing, *by_second_recipe(probing, self.workspace.task)])]
        best, *others = self.train("probe", probing, [FIRST_SEED], satisfies)
        if best.measurement is None:
            raise UsageError(f"no training ended well: {best.id.name}: {best.reason}")
        if satisfies(best):
            return best
        latest = {Contestant.of(each): each for each in (best, *others) if each.measurement is not None}
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
        if satisfies(best):
            return best
        methods = self.workspace.state["methods"]  # a race that was stopped has them
        probe = next((each for who, each in latest.items() if who.agent == racing[0].agent), best)
        racing = racing[: self._plan(racing, probe) if methods is None else len(methods)]
        rung = 1
        while len(racing) > 1 and not self._is_promising(best) and self._left:
            self.say(f"race, rung {rung}: {', '.join(each.beside(racing[0]) for each in racing)}; {_score(best)}")
            # another seed in each rung, so that a lucky one does not carry a method to the end
            after = [*filter(self._goes_on, latest.values())]
            ranked = self.train(f"rung-{rung}", racing, [FIRST_SEED + rung], self._is_promising, after=after)
            latest |= {Contestant.of(each): each for each in ranked if each.measurement is not None}
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
        self._write(budget, steps, seconds / OVERTIME, checkpoints, _PATIENCE)
        return max([best, *self.train(budget, [contestant], [FIRST_SEED], satisfies, init)], key=rank)

    def _plan(self, racing: Sequence[Contestant], probe: Result) -> int:
        """How many contestants, the first of them, the time lets learn; write them, and the budgets of the rungs.

        Raises `UsageError` where it is too short even for one.
        """
        apart, each = cost(probe, self.workspace.episode_seconds)
        steps, given = self.workspace.task.file.steps, 60 * tries.RACE_SHARE * self.clock.minutes
        least = tries.least(self.workspace.task)
        if given < least * each:
            raise UsageError(
                f"{self.clock.minutes:g} minutes are too short: at {1 / each:.0f} steps a second they leave "
                f"{given / each:.0f} steps for a training, and {least} are the least; "
                f"about {tries.least_minutes(self.workspace.task, each):.2g} minutes are needed"
            )
        count = len(racing)
        assert probe.measurement is not None
        enough = max(_FIRST_RUNG_EPISODES * steps, _OVER_PROBE * probe.measurement.env_steps)
        most = 1 if racing[0].agent == str(probe.id.agent) else _OTHER_SPEED
        while count > 1:
            rungs = waves(count, self._at_once)
            shared = self._left if len(rungs) == 1 else min(given, self._left / 2)  # one rung is the final training
            first = shared / sum(wave * _RUNG_RATIO**rung for rung, wave in enumerate(rungs))
            checkpoints, seconds = self._training(first, apart)
            if seconds >= enough * each and first >= 2 * apart:
                for rung in range(len(rungs)):
                    checkpoints, seconds = self._training(first * _RUNG_RATIO**rung, apart)
                    self._write(f"rung-{rung + 1}", int(most * seconds / each), seconds, checkpoints, _PATIENCE)
                break
            count -= 1
        self.workspace.remember(methods=[contestant.method for contestant in racing[:count]])
        return count

    def _is_promising(self, result: Result) -> bool:
        return has_learned(result, self.workspace.task, _PROMISING_SHARE)

    def _enough_afresh(self, result: Result) -> float:
        """Seconds in which fresh seeds may learn more than a result did."""
        return _FRESH_RATIO * self._lasted(result)

    def final(self, winner: Result) -> list[Result]:
        """The winner, trained with fresh seeds until one satisfies from all starts for selection; the best first.

        There is none if a training goes on with the winner's (`improve`), or where the time before the delivery is too
        short: a fresh seed would learn less than the winner.
        """
        if self._goes_on(winner):
            return []
        assert winner.measurement is not None
        enough = self._enough_afresh(winner)
        if self._left < enough and not self._done(FINAL):
            self.say("too little time is left to train again with fresh seeds")
            return []
        if FINAL not in self.workspace.task.file.budgets:
            apart, each = cost(winner, self.workspace.episode_seconds)
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
        return self.train(FINAL, [contestant], FINAL_SEEDS, satisfies, init)

    # ------------------------------------------------------------------------------------------------------ going on

    def improve(self, trained: Sequence[Result]) -> list[Result]:
        """Train on while time is left, and further starts show that the certificate can rise; the best first.

        In turn, from the best policy and from fresh networks: the other way follows one that was no better. A policy
        that learned nothing is not trained on.
        """
        if not self._left:  # on a slow environment the look itself takes long
            self.workspace.remember(chosen=trained[0].key)
            return [*trained]
        best, others = trained[0], [*trained[1:]]
        seen, onward = self._outlook(best), True
        for turn in count(1):
            if not seen.can_rise or not self._plan_more(f"{MORE}{turn}", best):
                break
            contestant, first = Contestant.of(best), FINAL_SEEDS[-1] + 1 + _SIDE_BY_SIDE * (turn - 1)
            onward = onward or self._left < self._enough_afresh(best)
            onward = onward and has_learned(best, self.workspace.task)
            after = [best] if onward and resumes(contestant.agent) else []
            begun = "fresh networks" if self.start is None else "the earlier solution"
            how = "the best policy" if after else begun
            self.say(f"training on, from {how}: {contestant}; {seen}")
            seeds = range(first, first + min(_SIDE_BY_SIDE, self._at_once))
            results, rose = self.train(f"{MORE}{turn}", [contestant], seeds, lambda result: False, after=after), False
            if not any(result.measurement for result in results):
                break  # the next would fail as well
            for result in results:
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

    @property
    def _look(self) -> int:
        """Further starts for a look at a policy."""
        return int(np.clip(_LOOK_SHARE * 60 * self.clock.minutes / self.workspace.episode_seconds, *_LOOK_STARTS))

    def _outlook(self, result: Result) -> Outlook:
        return outlook(self.workspace.folder / cells_of(result.id.budget), result, self._look)

    def _plan_more(self, budget: str, best: Result) -> bool:
        """Write the budget of one more training, of half of the time that is left or of all; whether one fits."""
        if budget in self.workspace.task.file.budgets:
            return True  # a solve that was stopped has written it
        apart, each = cost(best, self.workspace.episode_seconds)
        assert best.measurement is not None
        left = self._left - min(_SIDE_BY_SIDE, self._at_once) * self._look * self.workspace.episode_seconds
        if left < 2 * (apart + tries.least(self.workspace.task) * each):
            return False
        half = left / 2
        checkpoints, seconds = self._training(half if half >= best.measurement.wall_seconds else left, apart)
        self._write(budget, int(seconds / each), seconds, checkpoints, patience=checkpoints)
        return True


def _score(result: Result) -> str:
    satisfaction, robustness = rank(result)
    return f"best so far {100 * satisfaction:.0f} %, robustness {robustness:.3g}"
