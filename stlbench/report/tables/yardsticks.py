"""The measures of a task's policies: its controller, the baselines, the best known and its bound; and the
worth, by the formula, of the best policy by a reward.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from operator import itemgetter
from typing import TYPE_CHECKING

from stlbench.records.identity import Setting, Track
from stlbench.records.result import LEARNED, NOT_RUN
from stlbench.registry.choices import Choice
from stlbench.report.tables.rows import Group, columns_of, maximised, split, trained
from stlbench.report.tables.table import Column, Table, Value
from stlbench.statistics.intervals import mean

if TYPE_CHECKING:
    from stlbench.tracks.references import References


@dataclass(frozen=True)
class Known:
    """The facts known of tasks without the results."""

    references: Mapping[str, References] = field(default_factory=dict)
    """The scores of a task's controller and baselines, by the task's name."""
    best: Mapping[Choice, float] = field(default_factory=dict)
    """The best known robustness (`best_known`) of the formula of each task, or ablation of one."""

    def by_hand(self, task: Choice) -> float | None:
        """The mean robustness of the task's controller; an ablation has its task's controller."""
        reference = self.references.get(task.name)
        return reference.by_hand.mean if reference and reference.by_hand else None

    def level(self, task: Choice) -> float | None:
        """The best known robustness of a task, or else its controller's."""
        return self.best.get(task, self.by_hand(task))

    def share(self, task: Choice, robustness: float | None) -> float | None:
        """Robustness as a share of the best known; None if one of them is not above 0."""
        best = self.best.get(task)
        return robustness / best if robustness is not None and best is not None and robustness > 0 < best else None

    def likeness(self, one: Setting, other: Setting) -> str | None:
        """How the methods of two settings pay the same: "=", "~", or None if they do not."""
        reference = self.references.get(one.task.name)
        return reference.likeness(one, other) if reference else None


_Formula = tuple[str, bool]


def best_known(groups: Sequence[Group], references: Mapping[str, References]) -> dict[Choice, float]:
    """Task, or ablation of one -> the best known robustness of its formula, if anybody searched for it.

    The task file states it, or a plan for the formula reached it. Plans for a reward and the controller can reach
    more. How often an agent decides changes what is possible, and other parts of a recipe do not. So ablations share
    the value, except those without `hold`. A plan on the track `plain`, which holds no action, is of these.
    """
    planners, best, reached = maximised(groups), dict[_Formula, float](), dict[_Formula, float]()
    for group in trained(groups):
        value, plans = group.mean("robustness_mean"), planners.get(group.setting.agent.name)
        if value is not None and plans is not None:
            known, formula = best if plans == "formula" else reached, _planned(group.setting, references)
            known[formula] = max(value, known.get(formula, value))
    for name, reference in references.items():
        if reference.best_known is not None:
            stated = reference.best_known.robustness
            best[name, False] = max(stated, best.get((name, False), stated))
        if reference.by_hand is not None:
            reached[name, False] = max(reference.by_hand.mean, reached.get((name, False), -math.inf))
    best = {formula: max(value, reached.get(formula, value)) for formula, value in best.items()}
    tasks = {group.setting.task for group in groups}
    return {task: best[_formula(task)] for task in tasks if _formula(task) in best}


def _formula(task: Choice) -> _Formula:
    """The choices that decide the best known: the task, and whether it is without `hold`."""
    return task.name, "hold" in dict(task.parameters).get("without", "").split("+")


def _planned(setting: Setting, references: Mapping[str, References]) -> _Formula:
    """The formula of a plan. The track `plain` is without `hold`, unless the task holds no action anyway."""
    (name, without), reference = _formula(setting.task), references.get(setting.task.name)
    return name, without or (setting.track == "plain" and (reference is None or reference.hold != 1))


_Columns = Mapping[Column, Callable[["References"], Value]]


def _if_known(part: str, name: str, factor: float = 1) -> Callable[[References], Value]:
    """A number of a part of the reference; None without the part."""

    def value(reference: References) -> Value:
        known = getattr(reference, part)
        number = None if known is None else getattr(known, name)
        return None if number is None else factor * number

    return value


def _baseline(part: str, title: str, short: str) -> _Columns:
    return {
        Column(title, short, digits=3): _if_known(part, "mean"),
        Column(f"{title} satisfied", f"{short} sat.", unit="%", digits=1, drop=1): _if_known(part, "satisfaction", 100),
    }


_PARTS: Mapping[str, tuple[_Columns, str]] = {
    "by_hand": (
        {
            Column("mean robustness", "mean", digits=3): _if_known("by_hand", "mean"),
            Column("worst start", digits=3, drop=2): _if_known("by_hand", "minimum"),
            Column("satisfied", unit="%", digits=1): _if_known("by_hand", "satisfaction", 100),
        },
        "First what a controller written by hand gets, from the report's starts: a reference and no upper bound.",
    ),
    "zero": (_baseline("zero", "zero action", "zero"), ""),
    "constant": (
        _baseline("constant", "best constant action", "constant"),
        "Zero action, best constant action: taken all the time. The best was chosen from other starts.",
    ),
    "at_random": (
        _baseline("at_random", "at random", "random"),
        "At random: actions drawn evenly from all, anew at each decision.",
    ),
    "best_known": (
        {
            Column("best known", digits=3): _if_known("best_known", "robustness"),
            Column("upper bound", digits=3): _if_known("best_known", "upper_bound"),
        },
        "Best known: the most that anything reached. Upper bound: more is proven to be impossible.",
    ),
    "trivial": (
        {Column("trivial", right=False): lambda each: "trivial" if each.trivial else None},
        f"Trivial: a constant action satisfies the formula from at least {100 * LEARNED:.0f} % of the starts. The task "
        "shows how a method holds what it has, and does not show that it learns anything.",
    ),
}
"""The things that some task must have: the columns that there are then, and a note."""


def controllers_table(references: Mapping[str, References]) -> Table:
    """The scores of controllers and baselines, and the best known: one row for each task that has any of it."""
    known = [(task, each) for task, each in references.items() if any(getattr(each, part) for part in _PARTS)]
    parts = [content for part, content in _PARTS.items() if any(getattr(each, part) for _, each in known)]
    columns: dict[Column, Callable[[tuple[str, References]], Value]] = {
        Column("task", right=False, shared=True): lambda row: row[0],
        **columns_of(itemgetter(1), dict(chain.from_iterable(several.items() for several, _ in parts))),
    }
    return Table.of("Controllers and baselines", known, columns, tuple(note for _, note in parts if note))


FORMULA = "(formula)"  # in the place of a method, if the plan maximised the formula's own robustness
RECIPE = "recipe"  # the setting with the task's whole recipe and the agent's parameters of it
RESOLUTION = "resolution"
"""The parameter of an agent that plans which says how fine its grid is: 1 by default, larger is finer."""
_MUCH = 0.05  # share of the best known by which two resolutions may differ without a remark


@dataclass(frozen=True)
class Aligned:
    """One task, method and setting. Robustness is the mean over the report's starts; None if it is not known."""

    task: str
    method: str
    setting: str
    best_known: float | None
    reward_optimal: float | None = None  # of the policy that is best by the reward
    satisfied: float | None = None  # share of the starts from which the planned policy satisfies the formula
    grid_value: float | None = None  # what the plan expects, in the unit of what is maximised
    selected: float | None = None  # of the selected policies that were learned in this setting, mean over seeds
    final: float | None = None
    seeds: int | None = None
    resolution: float = 1.0  # how fine the grid of the plan is
    disagreement: float | None = None  # the largest difference between what plans of several resolutions reached
    remarks: str | None = None

    @property
    def reward_loses(self) -> float | None:
        """The loss of the best policy by the reward against what is possible."""
        return _difference(self.best_known, self.reward_optimal)

    @property
    def learner_loses(self) -> float | None:
        """The loss of what was learned against the best policy by the reward."""
        return _difference(self.reward_optimal, self.selected)


def _difference(larger: float | None, smaller: float | None) -> float | None:
    return None if larger is None or smaller is None else larger - smaller


def align(
    groups: Sequence[Group], references: Mapping[str, References], shown: Iterable[Group] | None = None
) -> tuple[Aligned, ...]:
    """A row for each task, method and setting that was planned for; rows of the formula come first.

    Plans that differ in the resolution alone share a row. It has the numbers of the plan without that parameter, else
    of the finest, and says how far they disagree. Rows have plans of `shown` alone, compared with all groups. Where
    rows differ in track or budget, their settings say so.
    """
    wanted = {group.setting for group in (groups if shown is None else shown)}
    learned, planned = split(groups)
    planners, known = maximised(planned), Known(references, best_known(groups, references))
    together = dict[tuple[str, str, bool, str, str], dict[tuple[Track, str], list[Group]]]()
    for group in planned:
        task, agent = group.setting.task, group.setting.agent
        method = FORMULA if planners[agent.name] == "formula" else str(group.setting.method)
        text = setting_text(task, agent)
        apart = together.setdefault((task.name, method, text != RECIPE, text, agent.name), {})
        apart.setdefault((group.setting.track, group.setting.budget), []).append(group)
    rows = list[Aligned]()
    for (_, method, _, text, _), apart in sorted(together.items()):
        alike = [several[0].setting for several in apart.values()]
        for _, several in sorted(apart.items()):
            if any(group.setting in wanted for group in several):
                own = ", ".join((text, *way(several[0].setting, alike)))
                rows.append(_row(method, own, sorted(several, key=_fineness), learned, known))
    return tuple(rows)


def way(setting: Setting, alike: Sequence[Setting]) -> Iterator[str]:
    """The track and the budget of a plan, in which plans that have the same text otherwise differ: "track auto"."""
    for name in ("track", "budget"):
        if len({getattr(each, name) for each in alike}) > 1:
            yield f"{name} {getattr(setting, name)}"


def setting_text(task: Choice, agent: Choice) -> str:
    """The setting of a plan, without task and method: "recipe", "gamma=1", "without=cuts+ends, gamma=1"."""
    return ", ".join(f"{key}={value}" for key, value in (*task.parameters, *_own(agent))) or RECIPE


def _own(agent: Choice) -> tuple[tuple[str, str], ...]:
    return tuple((key, value) for key, value in agent.parameters if key != RESOLUTION)


def _fineness(group: Group) -> tuple[bool, float]:
    """Sorts the plan at the default resolution first, then the finest."""
    return RESOLUTION in dict(group.setting.agent.parameters), -_resolution(group)


def _resolution(group: Group) -> float:
    """NaN if it is no number, so that no plan was made."""
    try:
        return float(dict(group.setting.agent.parameters).get(RESOLUTION, 1))
    except ValueError:
        return math.nan


def _row(method: str, text: str, several: Sequence[Group], learned: Sequence[Group], known: Known) -> Aligned:
    """The row of plans that differ in the resolution; the first finished one counts."""
    plan = next((group for group in several if group.done), several[0])
    setting, possible = plan.setting, known.best.get(plan.setting.task)
    values = [value for group in several if (value := group.mean("robustness_mean")) is not None]
    expected = [value for value in plan.values("grid_value") if value is not None and not math.isnan(value)]
    taught = None if method == FORMULA else _learned(plan, learned, known)
    disagreement = max(values) - min(values) if len(values) > 1 else None
    remarks = [group.remarks or ("" if group.done else NOT_RUN) for group in several]
    if disagreement is not None and possible is not None and disagreement > _MUCH * abs(possible):
        remarks.append(f"resolutions differ by {disagreement:.3g}, more than {100 * _MUCH:.0f} % of the best known")
    return Aligned(
        task=setting.task.name,
        method=method,
        setting=text,
        best_known=possible,
        reward_optimal=None if method == FORMULA else plan.mean("robustness_mean"),
        satisfied=plan.mean("satisfaction"),
        grid_value=mean(expected),
        selected=taught.mean("robustness_mean") if taught else None,
        final=taught.mean("final_robustness_mean") if taught else None,
        seeds=len(taught.done) if taught else None,
        resolution=_resolution(plan),
        disagreement=disagreement,
        remarks="; ".join(filter(None, dict.fromkeys(remarks))) or None,
    )


def _learned(plan: Group, learned: Sequence[Group], known: Known) -> Group | None:
    """The results of the task's own agent with the method in the same setting; None if nobody trained it so.

    Among several budgets the plan's counts, else the largest.
    """
    setting, reference = plan.setting, known.references.get(plan.setting.task.name)
    own_agent = reference.own_agent if reference else None
    same = [
        group
        for group in learned
        if group.done
        and (group.setting.task, group.setting.method, group.setting.track)
        == (setting.task, setting.method, setting.track)
        and group.setting.agent.name == (own_agent or group.setting.agent.name)
        and group.setting.agent.parameters == _own(setting.agent)
    ]

    def trained(group: Group) -> tuple[bool, int]:
        return group.setting.budget == setting.budget, max(group.values("env_steps"))

    return max(same, key=trained, default=None)


def alignment_table(rows: Iterable[Aligned]) -> Table:
    """One row for each task, method and setting that was planned for."""
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
    values = [[getattr(row, column.title) for column in columns] for row in rows]
    known = tuple(
        tuple(None if isinstance(value, float) and math.isnan(value) else value for value in row) for row in values
    )
    notes = (
        "Robustness of the task's formula, mean over the report's starts: the best known; of "
        "the policy that a plan finds best by the reward; and of what was learned, selected and final.",
        "Satisfied is of the planned policy, a share of the starts; grid value, what its plan expects, in the unit of "
        "what is maximised. Disagree: by how much plans of several resolutions differ.",
        "The reward loses what its own best policy lacks of the best known, and the learner what it lacks of that.",
    )
    return Table("Alignment", columns, known, notes)
