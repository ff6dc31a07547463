"""Which cells are an agent's that plans: what these found stands beside what was learned, never among it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.report.tables.rows import Group, trained

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

RESOLUTION = "resolution"
"""The parameter of an agent that plans which says how fine its grid is: the larger the finer, 1 where left out."""

Maximised = Literal["reward", "formula"]
_Of = tuple[str, bool]


def maximised(groups: Iterable[Group]) -> dict[str, Maximised]:
    """Agent that plans -> what it makes the most of: as its cells say, or, where none is done, the installed agent."""
    known, groups = dict[str, Maximised | None](), trained(groups)
    for group in groups:
        plans = next((numbers.planned.maximised for numbers in group.done if numbers.planned), None)
        if group.done:
            known[group.setting.agent.name] = plans
    for name in {group.setting.agent.name for group in groups} - known.keys():
        known[name] = _installed(name)
    return {name: plans for name, plans in known.items() if plans is not None}


def _installed(agent: str) -> Maximised | None:
    """What the agent of that name makes the most of; None where it learns, or is not installed here."""
    try:
        kind = plugins.find("agents", agent).load()
    except UsageError:
        return None
    plans: Maximised | None = getattr(kind, "plans", None)
    return plans


def split(groups: Sequence[Group]) -> tuple[tuple[Group, ...], tuple[Group, ...]]:
    """The groups of agents that learn, and those of agents that plan; policies from outside are in neither."""
    planners, own = maximised(groups), trained(groups)
    learned = tuple(group for group in own if group.setting.agent.name not in planners)
    return learned, tuple(group for group in own if group.setting.agent.name in planners)


def reached(group: Group) -> float | None:
    """Mean robustness of the selected policies; None where no cell is done."""
    values = group.values(lambda numbers: numbers.robustness_mean)
    return float(np.mean(values)) if values else None


def best_known(groups: Sequence[Group], standards: Mapping[str, Standard]) -> dict[Choice, float]:
    """Task, or ablation of one -> the best known robustness of its formula, where anybody looked for it.

    Somebody looked where the task file says what is best known, and where a cell is a plan for the formula. The best
    known is the largest of these, of plans for a reward, and of the controller by hand. How often an agent decides
    changes what is possible, and other parts of a recipe do not: ablations share a best known, but those without `hold`
    have their own.
    """
    planners, best, reached_otherwise = maximised(groups), dict[_Of, float](), dict[_Of, float]()
    for group in trained(groups):
        value, plans = reached(group), planners.get(group.setting.agent.name)
        if value is not None and plans is not None:
            known, of = best if plans == "formula" else reached_otherwise, _formula(group.setting.task)
            known[of] = max(value, known.get(of, value))
    for name, standard in standards.items():
        if standard.best_known is not None:
            stated = standard.best_known.robustness
            best[name, False] = max(stated, best.get((name, False), stated))
        if standard.by_hand is not None:
            reached_otherwise[name, False] = max(standard.by_hand.mean, reached_otherwise.get((name, False), -math.inf))
    best = {of: max(value, reached_otherwise.get(of, value)) for of, value in best.items()}
    tasks = {group.setting.task for group in groups}
    return {task: best[_formula(task)] for task in tasks if _formula(task) in best}


def _formula(task: Choice) -> _Of:
    """What decides the best known: the task, and whether it is without `hold`."""
    return task.name, "hold" in dict(task.parameters).get("without", "").split("+")
