"""A few numbers of each cell, and groups of cells that differ in nothing but the seed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from typing import Any, Literal, TypeVar

from stlbench.errors import UsageError
from stlbench.records.identity import OUTSIDE, CellId, Setting
from stlbench.records.result import LEARNED, MAIN, NOT_RUN, RANDOM, Measurement, Planned, Result, Status, reported
from stlbench.records.rows import numbers
from stlbench.registry import plugins
from stlbench.report.tables.table import Column, FirstFailed, Seeds, Value
from stlbench.statistics.intervals import mean, median

_T = TypeVar("_T")
CurveRow = tuple[int, float, float]
"""One checkpoint: environment steps, satisfaction in [0, 1], mean robustness, on the starts for selection."""


@dataclass(frozen=True)
class Numbers:
    """The data of one finished cell that the report needs. Satisfaction in [0, 1], times in seconds."""

    satisfaction: float
    robustness_mean: float
    robustness_min: float
    final_satisfaction: float
    final_robustness_mean: float
    selected_steps: int
    training_cpu_seconds: float
    training_wall_seconds: float
    cpu_seconds: float
    wall_seconds: float
    env_steps: int
    reward_nanoseconds: float
    inputs_added: int
    starts: int | None = None  # the number of starts behind robustness and satisfaction; None if it was not recorded
    ended_early: float | None = None
    """Share of these starts, in [0, 1], whose episode ended before the formula's horizon; None if not recorded."""
    extension: str = ""  # why the task is outside the form that the method's source was published for; empty inside it
    planned: Planned | None = None
    further: Mapping[str, float] = field(default_factory=dict)
    """Further protocol -> mean robustness of the selected policy."""
    first_failed: Mapping[str, int] = field(default_factory=dict)
    """Conjunct -> starts that failed it first, selected policy."""
    curve: tuple[CurveRow, ...] = ()

    @property
    def learned(self) -> bool:
        return self.satisfaction >= LEARNED

    @property
    def final_learned(self) -> bool:
        return self.final_satisfaction >= LEARNED


@dataclass(frozen=True)
class Row:
    """One cell, without the values of single starts, so that thousands of cells fit into memory."""

    id: CellId
    status: Status | Literal["not run"]
    reason: str
    provenance: Mapping[str, str]  # how the result came about (`provenance.collect`)
    numbers: Numbers | None


@dataclass(frozen=True)
class Group:
    """The cells that differ in nothing but the seed, in the order of their seeds."""

    setting: Setting
    rows: tuple[Row, ...]

    @property
    def outside(self) -> bool:
        """Whether stlbench did not train these policies."""
        return self.setting.track == OUTSIDE

    @cached_property
    def done(self) -> tuple[Numbers, ...]:
        """The numbers of the finished cells; every aggregate is over these."""
        return tuple(row.numbers for row in self.rows if row.numbers is not None)

    def values(self, name: str) -> tuple[Any, ...]:
        """One of `Numbers`, of each finished cell."""
        return tuple(getattr(numbers, name) for numbers in self.done)

    def mean(self, name: str) -> float | None:
        return mean(self.values(name))

    def median(self, name: str) -> float | None:
        values = self.values(name)
        return median(values) if values else None

    @property
    def tried(self) -> int:
        """How many seeds ran, with a result or without."""
        return sum(row.status != NOT_RUN for row in self.rows)

    @property
    def extension(self) -> str:
        """Why the task is outside the form of the method's source, as far as any cell says."""
        return next((numbers.extension for numbers in self.done if numbers.extension), "")

    @property
    def seeds(self) -> Seeds:
        return Seeds(len(self.done), len(self.rows), unfinished(self.rows) or None)

    @property
    def remarks(self) -> str:
        """Status and reason of the cells that ended without a measurement, each once."""
        ended = Counter((row.status, row.reason) for row in self.rows if row.status not in ("done", NOT_RUN))
        return "; ".join(f"{status}: {reason}" if reason else status for status, reason in ended)

    @cached_property
    def first_failed(self) -> FirstFailed | None:
        """The conjunct that failed first most often, over the starts of all seeds; None if none failed."""
        counts = sum((Counter(numbers.first_failed) for numbers in self.done), Counter[str]())
        if not counts:
            return None
        formula = min(counts, key=lambda text: (-counts[text], text))
        return FirstFailed(formula, counts[formula], counts.total())


def unfinished(rows: Iterable[Row]) -> str:
    """How the cells without a result ended: "40 intractable, 1 timeout"; empty if all have one."""
    ended = Counter(row.status for row in rows if row.status != "done")
    return ", ".join(f"{count} {status}" for status, count in ended.items())


def missing_row(cell: CellId) -> Row:
    return Row(cell, NOT_RUN, "", {}, None)


def row(result: Result) -> Row:
    return Row(
        id=result.id,
        status=result.status,
        reason=" ".join(result.reason.split()),
        provenance=_shared(tuple(result.provenance.items())),
        numbers=None if result.measurement is None else _numbers(result.measurement),
    )


@lru_cache(maxsize=64)
def _shared(items: tuple[tuple[str, str], ...]) -> Mapping[str, str]:
    """The items as a mapping, one object for all cells of a run."""
    return dict(items)


def _numbers(measurement: Measurement) -> Numbers:
    columns, selected = numbers(measurement), measurement.selected
    known = {each.name: columns[each.name] for each in fields(Numbers) if each.name in columns}
    return Numbers(
        **known,
        planned=measurement.planned,
        further={name: score.mean for name, score in selected.items() if name not in (MAIN, RANDOM)},
        first_failed=dict(reported(selected).first_failed),
        curve=tuple((point.steps, point.satisfaction, point.robustness_mean) for point in measurement.curve),
    )


def group(rows: Iterable[Row]) -> tuple[Group, ...]:
    gathered: dict[Setting, list[Row]] = {}
    for row in rows:
        gathered.setdefault(row.id.setting, []).append(row)
    return tuple(
        Group(setting, tuple(sorted(gathered[setting], key=lambda row: row.id.seed))) for setting in sorted(gathered)
    )


def trained(groups: Iterable[Group]) -> tuple[Group, ...]:
    return tuple(group for group in groups if not group.outside)


Maximised = Literal["reward", "formula"]


def maximised(groups: Iterable[Group]) -> dict[str, Maximised]:
    """Agent that plans -> what it maximises, by its cells, or else by the installed agent."""
    known, groups = dict[str, Maximised | None](), trained(groups)
    for group in groups:
        plans = next((numbers.planned.maximised for numbers in group.done if numbers.planned), None)
        if group.done:
            known[group.setting.agent.name] = plans
    for name in {group.setting.agent.name for group in groups} - known.keys():
        with suppress(UsageError):
            known[name] = getattr(plugins.find("agents", name).load(), "plans", None)
    return {name: plans for name, plans in known.items() if plans is not None}


def split(groups: Sequence[Group]) -> tuple[tuple[Group, ...], tuple[Group, ...]]:
    """The groups of agents that learn, and of agents that plan; policies from outside are in neither."""
    planners, own = maximised(groups), trained(groups)
    learned = tuple(group for group in own if group.setting.agent.name not in planners)
    return learned, tuple(group for group in own if group.setting.agent.name in planners)


CONTESTANT: Mapping[Column, Callable[[Group], Value]] = {
    Column("task", right=False, shared=True): lambda group: str(group.setting.task),
    Column("method", right=False): lambda group: str(group.setting.method),
    Column("agent", right=False, shared=True): lambda group: str(group.setting.agent),
    Column("budget", right=False, shared=True): lambda group: "unknown" if group.outside else group.setting.budget,
    Column("track", right=False, shared=True): lambda group: group.setting.track,
}
"""The columns that say which group a row is of."""
SETTING = {**CONTESTANT, Column("seeds", right=False, kind=Seeds): lambda group: group.seeds}
"""These, and how many of its seeds have a result."""


def shared_columns(group_of: Callable[[_T], Group]) -> dict[Column, Callable[[_T], Value]]:
    """Task, agent, budget and track, for items of which each belongs to a group."""

    def of_item(value: Callable[[Group], Value]) -> Callable[[_T], Value]:
        return lambda item: value(group_of(item))

    return {column: of_item(value) for column, value in SETTING.items() if column.shared}
