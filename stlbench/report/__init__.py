"""Results for readers: one `Report` has all tables; terminal, Markdown, CSV, LaTeX, JSON and page show them."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from stlbench.records import results_folder
from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.report.tables import runs
from stlbench.report.tables.across import Field, aggregates_table, fields, improvement_table
from stlbench.report.tables.comparisons import Comparison, advice, answer_table, compare, comparisons_table, verdicts
from stlbench.report.tables.rows import Group, Row, group, missing_row, row, split, trained
from stlbench.report.tables.sampled import groups_table, pairs_table
from stlbench.report.tables.table import Table
from stlbench.report.tables.yardsticks import Aligned, Known, align, alignment_table, best_known, controllers_table

if TYPE_CHECKING:
    from stlbench.tracks.references import References


def condense(
    results: Iterable[Result], missing: Iterable[CellId] = (), further: Iterable[Row] = ()
) -> tuple[Group, ...]:
    """Read results one at a time, and gather a few numbers of each in groups that differ in nothing but the seed.

    The `missing` are cells that were planned and have no result; `further` rows are gathered as they are.
    """
    return group(chain(map(row, results), map(missing_row, missing), further))


def groups_of(folder: Path) -> tuple[Group, ...]:
    """All cells of a folder of results, also those that are missing. Raises `UsageError` as `results_folder.read`."""
    return condense(results_folder.read(folder), results_folder.missing(folder).values())


def only(groups: Iterable[Group], cells: Container[CellId]) -> tuple[Group, ...]:
    return group(row for group in groups for row in group.rows if row.id in cells)


@dataclass(frozen=True)
class Report:
    """The tables of some results. Each is computed once, when it is first read."""

    groups: Sequence[Group]  # the results that the tables show
    references: Mapping[str, References]  # what the policies of each task are compared with
    recorded: Sequence[Group] | None = None
    """All results of the folder, if `groups` are a part of them: plans are compared with all of these."""
    first: tuple[Table, ...] = ()  # tables that come before these, such as one of bundles

    @cached_property
    def learned(self) -> tuple[Group, ...]:
        """The groups of agents that learn."""
        return split(self.groups)[0]

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """The sets of tasks over which methods are aggregated."""
        return fields(self.learned, self.known)

    @cached_property
    def pairs(self) -> tuple[Comparison, ...]:
        return compare(self.learned, self.known)

    @cached_property
    def aligned(self) -> tuple[Aligned, ...]:
        """The plans, and the policies learned in the same setting."""
        return align(self._recorded, self.references, self.groups)

    @cached_property
    def overview(self) -> Table:
        return runs.overview(self.learned, self.known, advice(self.pairs))

    @cached_property
    def robustness(self) -> Table:
        return runs.robustness_table(self.learned, self.known, self.outside)

    @cached_property
    def comparisons(self) -> Table:
        return comparisons_table(self.pairs)

    @cached_property
    def tables(self) -> dict[str, Table]:
        """The tables that are written as files and as JSON, by name, also those without a row."""
        names = {group.setting.task.name for group in self.groups}
        return {
            "overview": self.overview if len(self._tasks) > 1 else replace(self.overview, rows=()),
            "robustness": self.robustness,
            "comparisons": self.comparisons,
            "aggregates": aggregates_table(self.fields),
            "improvement": improvement_table(self.fields),
            "groups": groups_table(self.fields),
            "differences": pairs_table(self.fields),
            "controllers": controllers_table(
                {name: self.references[name] for name in self.references if name in names}
            ),
            "alignment": alignment_table(self.aligned),
            "time": runs.time_table(self.learned),
            "cells": runs.cells_table(
                (row for group in self.groups for row in group.rows),
                {name: reference.groups for name, reference in self.references.items()},
            ),
        }

    @property
    def summary(self) -> tuple[Table, ...]:
        """The tables that a reader is shown, in this order; tables without a row are left out."""
        of_tasks = [self.tables[name] for name in ("robustness", "comparisons", "controllers", "alignment", "time")]
        tables = (self.tables["overview"], *self.across, *of_tasks, runs.unfinished_table(self.groups))
        return (*self.first, *(table for table in tables if table.rows))

    @property
    def answer(self) -> tuple[Table | str, ...]:
        """A screen's answer: what was learned, or else planned, what went wrong, and a line for each two methods."""
        policies = [*self.learned, *self.outside]
        found = answer_table(policies, self.known) if policies else self.tables["alignment"]
        shown = [table for table in (*self.first, found, runs.unfinished_table(self.groups)) if table.rows]
        return (*shown, *verdicts(self.pairs))

    @property
    def across(self) -> list[Table]:
        """The tables over several tasks, also those without a row."""
        return [self.tables[name] for name in ACROSS]

    @property
    def circumstances(self) -> Table:
        return runs.circumstances(trained(self.groups))

    @cached_property
    def outside(self) -> tuple[Group, ...]:
        """Policies from outside, of the tasks that are shown."""
        outside = (group for group in self._recorded if group.outside)
        return tuple(each for each in outside if each.setting.task in self._tasks or each in self.groups)

    @property
    def _recorded(self) -> Sequence[Group]:
        return self.groups if self.recorded is None else self.recorded

    @cached_property
    def _tasks(self) -> set[Choice]:
        return {group.setting.task for group in self.learned}

    @cached_property
    def known(self) -> Known:
        """The facts known of the tasks, such as the best that anything reached."""
        best = best_known(self._recorded, self.references)
        return Known(self.references, {task: value for task, value in best.items() if task in self._tasks})


ACROSS = ("aggregates", "improvement", "groups", "differences")
"""The names of the tables over several tasks."""
