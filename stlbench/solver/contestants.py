"""The contestants of a race: methods that fit a task, each with an agent, and which result of theirs is better."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import cast

from stlbench.contract import ActionGrid, Agent, Array, Intractable, System, Unsuitable
from stlbench.errors import UsageError, one_line
from stlbench.records.array_files import write_arrays
from stlbench.records.result import Result
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choice
from stlbench.simulation.environment import BatchEnvironment
from stlbench.solver.workspace import TASK, UNSCHEDULED
from stlbench.study.cell import on_track, own_agent_on
from stlbench.task import Task, build_agent, build_method, fitting_methods, load_task
from stlbench.task.build import INIT, aim_of, in_turn
from stlbench.task.task import agents_for
from stlbench.tracks.auto import automatic, scheduled

_MOST = 4  # contestants
_LONG = 20
"""A second agent races too if there are at least so many minutes."""


def rank(result: Result) -> tuple[float, float]:
    """The better, the greater: satisfaction, then robustness, from the starts for selection."""
    if result.measurement is None:
        return -math.inf, -math.inf
    point = result.measurement.selection
    return point.satisfaction, point.robustness_mean


def satisfies(result: Result) -> bool:
    """Whether it does from all starts for selection."""
    return rank(result)[0] == 1


def has_learned(result: Result, task: Task, wanted: float = 0.0) -> bool:
    """Whether it satisfies from more starts than any baseline, and from a wanted share of the others.

    It does not if it was good for one moment of an unstable training.
    """
    if result.measurement is None:
        return False
    stated = task.file.baselines
    idle = max(each.satisfied for each in (stated.zero, stated.constant, stated.random)) if stated else 0.0
    share = min(rank(result)[0], result.measurement.curve[-1].satisfaction)
    return satisfies(result) or (share > idle and share >= idle + wanted * (1 - idle))


def cost(result: Result, episode_seconds: float) -> tuple[float, float]:
    """Seconds of a cell apart from its training and the episodes of its checkpoints; and of training per step.

    The former hardly depend on the steps.
    """
    measured = result.measurement
    assert measured is not None
    scored = sum(point.starts for point in measured.curve) * episode_seconds
    apart = measured.wall_seconds - measured.training_wall_seconds - scored
    return max(0.0, apart), measured.training_wall_seconds / measured.env_steps


def wall_seconds(result: Result) -> float:
    """Those of a cell; 0 without a measurement."""
    return 0.0 if result.measurement is None else result.measurement.wall_seconds


def best_first(finals: Sequence[Result], race: Sequence[Result]) -> list[Result]:
    """Results of the final training and of the race. Those of the final training come first where shares are equal."""
    trained = [*sorted(finals, key=rank, reverse=True), *sorted(race, key=rank, reverse=True)]
    return sorted(trained, key=lambda result: rank(result)[0], reverse=True)


@dataclass(frozen=True)
class Contestant:
    """A method, and the agent that trains with it."""

    method: str
    agent: str
    task: Choice = TASK
    """The task with the schedule that it follows."""

    @classmethod
    def of(cls, result: Result) -> Contestant:
        """The contestant that trained."""
        return cls(str(result.id.method), str(result.id.agent.without(INIT)), result.id.task)

    @property
    def helped(self) -> Task:
        """The task with the help of the rules for its agent."""
        return on_track(load_task(self.task), parse_choice(self.agent), "auto")

    def beside(self, first: Contestant) -> str:
        """Its name, with the agent if the first contestant has another."""
        return f"{self}" if self.agent == first.agent else f"{self} with {self.agent}"

    def __str__(self) -> str:
        schedule = dict(self.task.parameters).get("schedule")
        return self.method if schedule is None else f"{self.method} by schedule {schedule}"


def better_half(ranked: Sequence[Result], racing: Sequence[Contestant]) -> list[Contestant]:
    """The contestants of the better half of ranked results; if nobody satisfies from any start, the first in the race.

    In 108 races of `funnel`, `raw` and `dense` on drawn tasks nobody satisfied after a fifth of the time. The first two
    included all 85 later winners, the two of the greatest robustness 81.
    """
    kept = [Contestant.of(each) for each in ranked if each.measurement is not None] or [*racing]
    if rank(ranked[0])[0] <= 0:
        places = {each: place for place, each in enumerate(racing)}
        kept.sort(key=lambda each: places.get(each, len(racing)))
    return kept[: -(-len(ranked) // 2)]


def waves(count: int, jobs: int) -> list[int]:
    """For each rung of a race of so many contestants, how many of its cells run one after another."""
    found = []
    while count > 1:
        found.append(-(-count // jobs))
        count = -(-count // 2)
    return found


def resumes(agent: str) -> bool:
    """Whether an agent can start from an earlier policy."""
    return _class_of(agent).resumes


def contestants(task: Task, minutes: float, known: Contestant | None = None) -> tuple[Contestant, ...]:
    """At most four: methods that fit with the task's agent, and with much time the first of them with another agent.

    If all start from a policy, it is the one that trained this policy alone.
    """
    if known is not None:
        return (again(known, task),)
    own = own_agent_on(task, "auto")
    derived = automatic(task, own)
    fitting = fitting_methods(derived)
    if not fitting:
        raise UsageError(f"no method fits the formula {task.formula}; {'; '.join(_reasons(derived))}")
    methods = in_turn(fitting, aim_of(derived.file.followed))
    if not isinstance(task.actions, ActionGrid):  # then no agent learns from other memories
        methods = tuple(sorted(methods, key=lambda name: fitting[name].counterfactuals > 0))
    second = [Contestant(methods[0], agent) for agent in _second(task, own) if minutes >= _LONG]
    return (*(Contestant(method, own) for method in methods[: _MOST - len(second)]), *second)


def again(known: Contestant, task: Task) -> Contestant:
    """The contestant that trained, on another task: on its formula as it is if it was so, else by its schedule."""
    bare = dict(known.task.parameters).get("without") == "schedule" and scheduled(task) is not None
    return replace(known, task=UNSCHEDULED if bare else TASK)


def searcher(task: Task, choices: Sequence[Choice]) -> Contestant | None:
    """The first agent without a discount, with a method for sums of rewards; None where there is none.

    It trains on the first of some choices of a task that such a method fits.
    """
    agents = [agent for agent in agents_for(task.actions) if not _class_of(agent).discounts]
    for agent, choice in product(agents, choices):
        fitting = fitting_methods(automatic(load_task(choice), agent))
        first = next(iter(in_turn(fitting, "sum")), None)
        if first is not None and plugins.place(type(fitting[first]), "sum") is not None:
            return Contestant(first, agent, choice)
    return None


def playing(contestant: Contestant, course: Array, path: Path) -> Path | None:
    """The path of a policy that plays a course of actions (decisions, axes); None if the agent has none."""
    task, environment = _environment_of(contestant)
    policy = build_agent(task, contestant.agent).playing(course, environment)
    arrays = None if policy is None else policy.arrays()
    if arrays is None:
        return None
    write_arrays(path, arrays)
    return path


def gains(contestant: Contestant) -> int:
    """The numbers of a policy that is linear in the observation: axes times entries."""
    task, environment = _environment_of(contestant)
    entries: int = environment.time_column
    return len(task.actions.names) * entries


def _environment_of(contestant: Contestant) -> tuple[Task, BatchEnvironment]:
    """A contestant's task, and one copy of its environment."""
    task = contestant.helped
    return task, BatchEnvironment(task, build_method(task, contestant.method), 1, seed=0)


def _class_of(agent: str) -> type[Agent]:
    return cast(type[Agent], plugins.find("agents", parse_choice(agent).name).load())


def along(racing: Sequence[Contestant], choices: Sequence[Choice]) -> tuple[Contestant, ...]:
    """All contestants by the first of some schedules, then the first of all by the others.

    The last schedule is the one of the probe, which learned nothing.
    """
    best, *others = choices
    first = [replace(racing[0], task=choice) for choice in others]
    return (*(replace(each, task=best) for each in racing), *first)


def by_second_recipe(racing: Sequence[Contestant], task: Task) -> tuple[Contestant, ...]:
    """The contestants by the second recipe of their agent, where it has one and the task is an environment.

    It has more copies: the rules begin episodes of a system in diverse states, and those of an environment cannot. CPU
    seconds of `raw` until 95 % of the starts satisfy, by the first and the second recipe of `td3`, medians: 44 and 28
    on HalfCheetah (seeds 100 to 103), 99 and 29 on Ant, 59 and 46 on FetchReach, 15 and 22 on LunarLander (100, 101).
    """
    if isinstance(task.dynamics, System):
        return tuple(racing)
    return tuple(replace(each, agent=_with_second_recipe(each.agent)) for each in racing)


def _with_second_recipe(agent: str) -> str:
    try:
        entries = tuple((name, str(value)) for name, value in _class_of(agent).second_recipe.items())
        return str(parse_choice(str(Choice(agent, entries))))
    except (AttributeError, TypeError, UsageError, ValueError) as error:
        rule = "its second_recipe should have parameters, and numbers or words as values"
        raise plugins.find("agents", agent).error(f"{rule}: {one_line(error)}") from error


def _reasons(task: Task) -> Iterator[str]:
    """The reason of each method that does not fit a task, such as an operator that it does not know."""
    for name in plugins.available("methods"):
        try:
            build_method(task, name)
        except (Intractable, Unsuitable, UsageError) as error:
            yield one_line(error)


def _second(task: Task, own: str) -> list[str]:
    """The next agent for the same actions that can train here."""
    for agent in agents_for(task.actions):
        if agent == own or not _class_of(agent).discounts:
            continue
        with suppress(Exception):  # also what one from outside raises: it does not race
            build_agent(automatic(task, agent), agent)
            return [agent]
    return []
