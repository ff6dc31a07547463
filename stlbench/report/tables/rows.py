"""Results boiled down: a few numbers per cell, and the cells that differ in nothing but the seed as a group."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from typing import Literal

from stlbench.records.identity import OUTSIDE, CellId, Setting
from stlbench.records.result import LEARNED, MAIN, RANDOM, Measurement, Planned, Result, numbers, reported
from stlbench.records.status import NOT_RUN, Status
from stlbench.report.tables.table import Column, FirstFailed, Seeds, Value

CurveRow = tuple[int, float, float]
"""One checkpoint: environment steps, satisfaction in [0, 1], mean robustness, on the starts kept for selection."""


@dataclass(frozen=True)
class Numbers:
    """What the report needs of one finished cell. Satisfaction in [0, 1], times in seconds."""

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
    starts: int | None = None
    """From how many starts robustness and satisfaction are; None where that was not kept."""
    ended_early: float | None = None
    """Share of these starts, in [0, 1], whose episode ended before the formula's horizon; None where nobody counted."""
    extension: str = ""
    """Why the task is outside the form that the method's source was published for; empty inside it."""
    planned: Planned | None = None
    further: Mapping[str, float] = field(default_factory=dict)
    """Further protocol -> mean robustness of the selected policy."""
    first_failed: Mapping[str, int] = field(default_factory=dict)
    """Conjunct -> starts that failed it first, selected policy."""
    curve: tuple[CurveRow, ...] = ()

    @property
    def learned(self) -> bool:
        """Whether the selected policy has learned the task."""
        return self.satisfaction >= LEARNED

    @property
    def final_learned(self) -> bool:
        """The same of the final policy."""
        return self.final_satisfaction >= LEARNED


@dataclass(frozen=True)
class Row:
    """One cell. Holds no value of a single start, so that thousands of them fit into memory."""

    id: CellId
    status: Status | Literal["not run"]
    reason: str
    provenance: Mapping[str, str]
    """How the result came about (`provenance.collect`)."""
    numbers: Numbers | None

    @property
    def jobs(self) -> str:
        """How many cells ran at a time; empty where the provenance does not say."""
        return self.provenance.get("jobs", "")


@dataclass(frozen=True)
class Group:
    """The cells that differ in nothing but the seed, in the order of their seeds."""

    setting: Setting
    rows: tuple[Row, ...]

    @property
    def outside(self) -> bool:
        """Whether stlbench did not train these."""
        return self.setting.track == OUTSIDE

    @cached_property
    def done(self) -> tuple[Numbers, ...]:
        """The numbers of the finished cells; every aggregate is over these."""
        return tuple(row.numbers for row in self.rows if row.numbers is not None)

    def values(self, number: Callable[[Numbers], float]) -> tuple[float, ...]:
        """One number of each finished cell."""
        return tuple(number(numbers) for numbers in self.done)

    @property
    def tried(self) -> int:
        """How many seeds ran, with a result or without: of so many, some learned the task."""
        return sum(row.status != NOT_RUN for row in self.rows)

    @property
    def extension(self) -> str:
        """Why the task is outside the form of the method's source, as far as any cell says."""
        return next((numbers.extension for numbers in self.done if numbers.extension), "")

    @property
    def seeds(self) -> Seeds:
        """Over how many seeds the aggregates are: of how many, and how the others ended."""
        counts = Counter(row.status for row in self.rows if row.status != "done")
        unfinished = ", ".join(f"{count} {status}" for status, count in counts.items())
        return Seeds(len(self.done), len(self.rows), unfinished or None)

    @property
    def remarks(self) -> str:
        """Status and reason of the cells that ended without a measurement, each said once."""
        unfinished = Counter((row.status, row.reason) for row in self.rows if row.status not in ("done", NOT_RUN))
        return "; ".join(f"{status}: {reason}" if reason else status for status, reason in unfinished)

    @cached_property
    def first_failed(self) -> FirstFailed | None:
        """The conjunct that failed first most often, counted over the starts of all seeds; None where none failed."""
        counts = sum((Counter(numbers.first_failed) for numbers in self.done), Counter[str]())
        if not counts:
            return None
        formula = min(counts, key=lambda text: (-counts[text], text))
        return FirstFailed(formula, counts[formula], counts.total())


def missing_row(cell: CellId) -> Row:
    """A cell that was planned and has no result."""
    return Row(cell, NOT_RUN, "", {}, None)


def row(result: Result) -> Row:
    """A result without its values of single starts."""
    return Row(
        id=result.id,
        status=result.status,
        reason=" ".join(result.reason.split()),
        provenance=_shared(tuple(result.provenance.items())),
        numbers=None if result.measurement is None else _numbers(result.measurement),
    )


@lru_cache(maxsize=64)
def _shared(items: tuple[tuple[str, str], ...]) -> Mapping[str, str]:
    """A mapping of these items, the same object for all the cells of one run."""
    return dict(items)


def group(rows: Iterable[Row]) -> tuple[Group, ...]:
    """Rows, gathered by their setting; sorted, whatever order they come in."""
    gathered: dict[Setting, list[Row]] = {}
    for row in rows:
        gathered.setdefault(row.id.setting, []).append(row)
    return tuple(
        Group(setting, tuple(sorted(gathered[setting], key=lambda row: row.id.seed))) for setting in sorted(gathered)
    )


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


def outside(groups: Iterable[Group]) -> tuple[Group, ...]:
    """The groups of policies that were trained elsewhere, or by nobody."""
    return tuple(group for group in groups if group.outside)


def trained(groups: Iterable[Group]) -> tuple[Group, ...]:
    """All others."""
    return tuple(group for group in groups if not group.outside)


SETTING = (
    Column("task", right=False, shared=True),
    Column("method", right=False),
    Column("agent", right=False, shared=True),
    Column("budget", right=False, shared=True),
    Column("track", right=False, shared=True),
    Column("seeds", right=False, kind=Seeds),
)


def setting_values(group: Group) -> tuple[Value, ...]:
    """The values of a group in these columns."""
    setting = group.setting
    budget = "unknown" if group.outside else setting.budget
    return (str(setting.task), str(setting.method), str(setting.agent), budget, setting.track, group.seeds)
