"""One policy for many formulas, beside a policy for each: on formulas of the suite that the one policy has not seen.

    python studies/many_formulas.py unicycle/reach unicycle/patrol

For each system and template, one agent is trained on candidates of the suite's generator that are no tasks of it. Each
copy of the environment has a formula of its own, whose derived view is what the policy observes. It is then scored on
those of the accepted tasks 0, 1 and 2 whose view has as many columns as that of task 0. Beside it, an agent of the same
recipe is trained on each of these tasks alone: once with the task's budget, once with the steps of the one agent.
results/many-formulas/scores.csv gets a line as each is scored; a score that is there is not measured again.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from row_by_row import add, rows
from suite import load

from stlbench.contract import Array, Integers, Policy, Training, Transition
from stlbench.records.result import MAIN
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.referee import Referee
from stlbench.task import Task, build_agent, build_method, load_task
from stlbench.task.task import agent_for
from stlbench.tracks.auto import automatic
from stlbench_tasks.suite.formulas import Candidate
from stlbench_tasks.suite.templates import Cramped

SCORES = Path(__file__).parents[1] / "results" / "many-formulas" / "scores.csv"
COLUMNS = ("pair", "formulas", "seed", "test", "satisfied", "robustness", "steps", "cpu_seconds")
FORMULAS, SEEDS, TESTS = (8, 32), (0, 1), (0, 1, 2)
FIRST = 10_000
"""The number of the first candidate in training. The suite's tasks have numbers far below."""
TIMES = 4
"""The factor on the steps of a task's budget, for all formulas together and for one alone."""


class Family:
    """Environments of several tasks as one (`contract.Environment`): the copies of each stand side by side."""

    def __init__(self, environments: Sequence[BatchEnvironment]) -> None:
        self._parts = environments
        self.count = sum(each.count for each in environments)
        self.actions, self.hold = environments[0].actions, environments[0].hold
        (self.observation_size,) = {each.observation_size for each in environments}

    def reset(self) -> Array:
        """(N, D)."""
        return np.concatenate([each.reset() for each in self._parts])

    def step(self, action: Integers | Array) -> Transition:
        """As each of them."""
        ends = np.cumsum([each.count for each in self._parts])[:-1]
        steps = [each.step(own) for each, own in zip(self._parts, np.split(action, ends), strict=True)]
        return Transition(*map(np.concatenate, zip(*steps, strict=True)))


def main(pairs: Sequence[str]) -> None:
    for pair in pairs:
        tests = [load_task(f"suite:{pair}/{number}") for number in TESTS]
        size = _size(tests[0])
        tests = [test for test in tests if _size(test) == size]
        for seed in SEEDS:
            for times, test in product((1, TIMES), tests):
                compared(pair, 1, seed, [test], times)
            for count in FORMULAS:
                compared(pair, count, seed, tests, TIMES)


def compared(pair: str, count: int, seed: int, tests: Sequence[Task], times: int) -> None:
    """Train on so many formulas, one being the test's own; score on the tests, unless their lines are there."""
    steps = times * tests[0].budget("quick").steps
    known = {tuple(row[name] for name in ("pair", "formulas", "seed", "test", "steps")) for row in rows(SCORES)}
    if all((pair, str(count), str(seed), test.name, str(steps)) in known for test in tests):
        return
    tasks = tests if count == 1 else alike(pair, count, tests[0])
    began = process_time()
    method = "flag" if "patrol" in pair else "raw"
    agent = agent_for(tasks[0].actions)
    helped = [automatic(task, agent) for task in tasks]
    policy = trained(helped, agent, method, steps, seed)
    seconds = process_time() - began
    for test in tests:
        own = automatic(test, agent)
        score = Referee(own, build_method(own, method)).assess(policy).scores[MAIN]
        numbers = round(score.satisfaction, 5), round(score.mean, 5)
        line = (pair, count, seed, test.name, *numbers, steps, round(seconds, 1))
        add(SCORES, COLUMNS, [dict(zip(COLUMNS, line, strict=True))])


def trained(tasks: Sequence[Task], name: str, method: str, steps: int, seed: int) -> Policy:
    """The checkpoint that is best on the tasks' starts for selection, by satisfaction and then by robustness."""
    agent: Any = build_agent(tasks[0], name)
    referees = [Referee(task, build_method(task, method)) for task in tasks]
    best: list[tuple[tuple[float, float], Policy]] = []

    def make(count: int) -> Any:
        shares = np.diff(np.linspace(0, count, len(tasks) + 1).astype(int))
        return Family(
            [
                BatchEnvironment(task, build_method(task, method), share, seed=1000 * seed + place)
                for place, (task, share) in enumerate(zip(tasks, shares, strict=True))
            ]
        )

    def report(policy: Policy, done: int) -> bool:
        few = referees[:: max(1, len(referees) // 8)]
        score = np.mean([each.select(policy) for each in few], axis=0)
        best.append(((float(score[0]), float(score[1])), policy))
        return False

    agent.train(Training(make, steps, seed, report, 10))
    return max(best, key=lambda each: each[0])[1]


def alike(pair: str, count: int, test: Task) -> list[Task]:
    """Candidates whose view has the same columns, each a task of its own."""
    system, template = pair.split("/")
    size, found, number = _size(test), list[Task](), FIRST
    while len(found) < count:
        try:
            task, _ = load(Candidate(system, template, "usual", number))
        except Cramped:
            pass
        else:
            if _size(task) == size:
                found.append(replace(task, choice=replace(task.choice, name=f"candidate-{number}")))
        number += 1
    return found


def _size(task: Task) -> int:
    helped = automatic(task, agent_for(task.actions))
    return BatchEnvironment(helped, build_method(helped, "sparse"), 1, 0).observation_size


if __name__ == "__main__":
    main(sys.argv[1:])
