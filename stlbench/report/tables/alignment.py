"""What the best policy by a reward is worth by the formula, between what is possible and what was learned."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stlbench.records.status import NOT_RUN
from stlbench.registry.choices import Choice
from stlbench.report.tables.planned import RESOLUTION, best_known, maximised, reached, split
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Column, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

FORMULA = "(formula)"
"""In the place of a method, where it is the formula's own robustness that was maximised."""
RECIPE = "recipe"
"""The setting in which nothing is left out of the task's recipe, and the agent's parameters are those of it."""
_MUCH = 0.05
"""Share of the best known by which two resolutions may differ without a remark."""


@dataclass(frozen=True)
class Aligned:
    """One task, method and setting. Robustness is the mean over the report's starts; None where it is not known."""

    task: str
    method: str
    setting: str
    best_known: float | None
    reward_optimal: float | None = None
    """Of the policy that is best by the reward."""
    satisfied: float | None = None
    """Share of the starts from which the planned policy satisfies the formula."""
    grid_value: float | None = None
    """What the plan expects, in the unit of what is maximised."""
    selected: float | None = None
    """Of the selected policies that were learned in this setting, mean over seeds."""
    final: float | None = None
    seeds: int | None = None
    """How many of them there are."""
    resolution: float = 1.0
    """How fine the grid of the plan is."""
    disagreement: float | None = None
    """The largest difference between what plans of several resolutions reached."""
    remarks: str | None = None

    @property
    def reward_loses(self) -> float | None:
        """By how much the best policy by the reward is worse than what is possible."""
        return _difference(self.best_known, self.reward_optimal)

    @property
    def learner_loses(self) -> float | None:
        """By how much what was learned is worse than the best policy by the reward."""
        return _difference(self.reward_optimal, self.selected)


def align(
    groups: Sequence[Group], standards: Mapping[str, Standard], shown: Iterable[Group] | None = None
) -> tuple[Aligned, ...]:
    """A row for each task, method and setting that was planned for, first those of the formula itself.

    Plans that differ in nothing but the resolution share a row: it has the numbers of the one without that parameter,
    else of the finest, and says how far they disagree.

    Args:
        groups: all that is recorded, planned and learned.
        standards: of their tasks.
        shown: rows are of these alone, with what the others say of them; of all where left out.
    """
    wanted = {group.setting for group in (groups if shown is None else shown)}
    learned, planned = split(groups)
    planners, best = maximised(planned), best_known(groups, standards)
    together = dict[tuple[str, str, bool, str, str], list[Group]]()
    for group in planned:
        task, agent = group.setting.task, group.setting.agent
        method = FORMULA if planners[agent.name] == "formula" else str(group.setting.method)
        text = setting_text(task, agent)
        together.setdefault((task.name, method, text != RECIPE, text, agent.name), []).append(group)
    return tuple(
        _row(method, sorted(several, key=_fineness), learned, best, _own_agent(standards.get(task)))
        for (task, method, *_), several in sorted(together.items())
        if any(group.setting in wanted for group in several)
    )


def setting_text(task: Choice, agent: Choice) -> str:
    """What a plan is of beside task and method: "recipe", "gamma=1", "without=cuts+ends, gamma=1"."""
    parts = [*task.parameters, *_own(agent)]
    return ", ".join(f"{key}={value}" for key, value in parts) or RECIPE


def _own(agent: Choice) -> tuple[tuple[str, str], ...]:
    """The agent's parameters that change what is maximised, and not how well."""
    return tuple((key, value) for key, value in agent.parameters if key != RESOLUTION)


def _fineness(group: Group) -> tuple[bool, float]:
    """First the plan at the default resolution, then the finest."""
    return RESOLUTION in dict(group.setting.agent.parameters), -_resolution(group)


def _resolution(group: Group) -> float:
    """1 where nothing is said; NaN where it is no number, so that no plan was made."""
    try:
        return float(dict(group.setting.agent.parameters).get(RESOLUTION, 1))
    except ValueError:
        return math.nan


def _own_agent(standard: Standard | None) -> str | None:
    return None if standard is None else standard.own_agent


def _row(
    method: str, several: Sequence[Group], learned: Sequence[Group], best: Mapping[Choice, float], own_agent: str | None
) -> Aligned:
    """Of plans that differ in the resolution, the one that counts first."""
    plan = next((group for group in several if group.done), several[0])
    setting = plan.setting
    values = [value for group in several if (value := reached(group)) is not None]
    expected = [numbers.planned.value for numbers in plan.done if numbers.planned]
    taught = None if method == FORMULA else _learned(plan, learned, own_agent)
    possible = best.get(setting.task)
    disagreement = max(values) - min(values) if len(values) > 1 else None
    return Aligned(
        task=setting.task.name,
        method=method,
        setting=setting_text(setting.task, setting.agent),
        best_known=possible,
        reward_optimal=None if method == FORMULA else reached(plan),
        satisfied=_mean([numbers.satisfaction for numbers in plan.done]),
        grid_value=_mean([value for value in expected if not math.isnan(value)]),
        selected=None if taught is None else reached(taught),
        final=None if taught is None else _mean(taught.values(lambda numbers: numbers.final_robustness_mean)),
        seeds=None if taught is None else len(taught.done),
        resolution=_resolution(plan),
        disagreement=disagreement,
        remarks=_remarks(several, _coarse(disagreement, possible)),
    )


def _learned(plan: Group, learned: Sequence[Group], own_agent: str | None) -> Group | None:
    """What the task's own agent learned with the method in the same setting; None where nobody trained it so.

    Of several budgets the plan's, else the largest.
    """
    setting = plan.setting
    same = [
        group
        for group in learned
        if group.done
        and (group.setting.task, group.setting.method, group.setting.track)
        == (setting.task, setting.method, setting.track)
        and group.setting.agent.name == (own_agent or group.setting.agent.name)
        and group.setting.agent.parameters == _own(setting.agent)
    ]
    return max(same, key=lambda group: _trained(group, setting.budget), default=None)


def _trained(group: Group, budget: str) -> tuple[bool, int]:
    return group.setting.budget == budget, max(numbers.env_steps for numbers in group.done)


def _remarks(several: Sequence[Group], coarse: str) -> str | None:
    """How plans without a result ended, each said once, and how coarse those with one are."""
    endings = [group.remarks or ("" if group.done else NOT_RUN) for group in several]
    return "; ".join(filter(None, dict.fromkeys([*endings, coarse]))) or None


def _coarse(disagreement: float | None, possible: float | None) -> str:
    if disagreement is None or possible is None or disagreement <= _MUCH * abs(possible):
        return ""
    return f"resolutions differ by {disagreement:.3g}, more than {100 * _MUCH:.0f} % of the best known"


def alignment_table(rows: Iterable[Aligned]) -> Table:
    """One row per task, method and setting that was planned for."""
    columns = (
        Column("task", right=False, shared=True),
        Column("method", right=False),
        Column("setting", right=False, shared=True),
        Column("best_known", "best known", digits=3),
        Column("reward_optimal", "reward optimal", digits=3),
        Column("satisfied", digits=2),
        Column("grid_value", "grid value", drop=2),
        Column("selected", digits=3),
        Column("final", digits=3, drop=4),
        Column("seeds", drop=3),
        Column("reward_loses", "reward loses", digits=3),
        Column("learner_loses", "learner loses", digits=3),
        Column("resolution", drop=5),
        Column("disagreement", "disagree", digits=3, drop=1),
        Column("remarks", right=False, below=True),
    )
    body = tuple(tuple(_value(getattr(row, column.title)) for column in columns) for row in rows)
    return Table("Alignment", columns, body, _NOTES)


_NOTES = (
    "Robustness of the task's formula, mean over the report's starts: the best known; of "
    "the policy that a plan finds best by the reward; and of what was learned, selected and final.",
    "Satisfied is of the planned policy, a share of the starts; grid value, what its plan expects, in the unit of what "
    "is maximised. Disagree: by how much plans of several resolutions differ.",
    "The reward loses what its own best policy lacks of the best known, and the learner what it lacks of that.",
)


def _value(value: Value) -> Value:
    return None if isinstance(value, float) and math.isnan(value) else value


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _difference(larger: float | None, smaller: float | None) -> float | None:
    return None if larger is None or smaller is None else larger - smaller
