"""The page's part of one task: what it asks, its tables and charts, and what the policies did."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.records.cell_files import TRACES
from stlbench.records.identity import CellId, Setting
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.report.bands import bands_of
from stlbench.report.figures.palette import Colours
from stlbench.report.figures.regions import terms
from stlbench.report.figures.units import scale_of_task
from stlbench.report.page.chart import Chart
from stlbench.report.page.listed import Listed, listed, of_rows
from stlbench.report.page.of_groups import cost, learning, robustness
from stlbench.report.page.of_story import charts_of
from stlbench.report.page.story import Story, tell_story
from stlbench.report.tables.planned import maximised
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Column, Table
from stlbench.study.plugin_guard import load_guarded
from stlbench.task.task import Task


@dataclass(frozen=True)
class Tables:
    """The tables of the report, of all tasks."""

    robustness: Table
    comparisons: Table
    alignment: Table
    times: Table
    controllers: Table


@dataclass(frozen=True)
class StoryPart:
    """What the policies of one group did."""

    name: str
    charts: list[Chart]


@dataclass(frozen=True)
class TaskPart:
    """One task."""

    key: str
    name: str
    title: str
    facts: list[tuple[str, str]]
    """Name and text: formula, terms, source."""
    tables: list[Listed]
    charts: list[Chart]
    worst: Listed | None
    """The worst start of each group, and why; None without traces."""
    stories: list[StoryPart]
    lacks: list[str]
    """What the folder does not hold, in a line each."""

    @property
    def all_tables(self) -> list[Listed]:
        """Also that of the worst starts."""
        return [*self.tables, *([self.worst] if self.worst else [])]

    @property
    def all_charts(self) -> list[Chart]:
        """Also those of the stories."""
        return [*self.charts, *(chart for story in self.stories for chart in story.charts)]


def task_part(
    number: int,
    groups: Sequence[Group],
    results: Mapping[CellId, Result],
    tables: Tables,
    colours: Colours,
    folder: Path,
    told: Callable[[], None],
) -> TaskPart:
    """The part of the task of these groups, learned and planned; `told` is called after each of them."""
    choice, key = groups[0].setting.task, f"task-{number}"
    planners = maximised(groups)
    learned = [group for group in groups if group.outside or group.setting.agent.name not in planners]
    task, lacks = _loaded(choice)
    found, unread = _stories(task, learned, results, folder, told)
    scale = scale_of_task(choice)
    charts = list[Chart]()
    if any(group.done for group in learned):
        charts = [robustness(learned, scale.unit, colours), *learning(learned, scale, colours)]
    took = cost([group for group in learned if not group.outside], colours)
    if not any(each.curve for group in learned for each in group.done):
        lacks.append("No checkpoint is recorded: there are no learning curves.")
    bands = bands_of(choice, (setting.method for setting in found))
    parts = [
        StoryPart(
            _name(setting), charts_of(task, story, bands[setting.method], colours[str(setting.method)], f"story-{i}")
        )
        for i, (setting, story) in enumerate(found.items())
        if task is not None
    ]
    return TaskPart(
        key=key,
        name=str(choice),
        title="" if task is None else task.file.title,
        facts=[] if task is None else _facts(task),
        tables=_tables(tables, choice),
        charts=[*charts, *([took] if took else [])],
        worst=listed(_worst(found), folded=True) if found else None,
        stories=parts,
        lacks=[*lacks, *unread],
    )


def _loaded(choice: Choice) -> tuple[Task | None, list[str]]:
    try:
        return load_guarded(choice), []
    except UsageError as error:
        return None, [f"The task is not known here, so neither its formula nor traces are shown: {error}"]


def _facts(task: Task) -> list[tuple[str, str]]:
    file, found = task.file, terms(task)
    seconds = file.steps * file.sampling_time
    return [
        ("formula", str(task.formula)),
        *(("term", str(term.formula)) for term in (found if len(found) > 1 else ())),
        ("episode", f"{file.steps} steps of {file.sampling_time:g} s, {seconds:g} s together"),
        ("horizon", f"{stl.horizon(task.formula)} steps"),
        ("source", file.source),
        *([("notes", " ".join(file.notes.split()))] if file.notes else []),
    ]


def _tables(tables: Tables, choice: Choice) -> list[Listed]:
    name = str(choice)
    parts = [
        of_rows(tables.robustness, lambda row: row[0] == name),
        of_rows(tables.comparisons, lambda row: row[0] == name),
        of_rows(tables.controllers, lambda row: row[0] == choice.name),
        of_rows(tables.alignment, lambda row: row[0] == choice.name),
        of_rows(tables.times, lambda row: row[0] == name),
    ]
    return [listed(table, folded=True) for table in parts if table.rows]


def _name(setting: Setting) -> str:
    track = "" if setting.track == "shared" else f", {setting.track}"
    return f"{setting.method} ({setting.agent}, {setting.budget}{track})"


def _stories(
    task: Task | None,
    groups: Sequence[Group],
    results: Mapping[CellId, Result],
    folder: Path,
    told: Callable[[], None],
) -> tuple[dict[Setting, Story], list[str]]:
    """The story of each group whose traces are there, and what there is none of."""
    if task is None:
        return {}, []
    if not (folder / TRACES).is_dir():
        return {}, [f"There is no folder {TRACES}/ beside these results: what policies did is not shown."]
    found, lacks = dict[Setting, Story](), list[str]()
    for group in groups:
        members = [results[row.id] for row in group.rows if row.numbers is not None]
        try:
            story = tell_story(task, members, folder)
            if story is not None:
                found[group.setting] = story
        except UsageError as error:
            lacks.append(str(error))
        told()
    return found, lacks


def _worst(found: Mapping[Setting, Story]) -> Table:
    """Which subformula failed, when, by how much."""
    columns = (
        Column("method", right=False),
        *(Column(title, right=False, shared=True) for title in ("agent", "budget", "track")),
        Column("worst start", right=False),
        Column("robustness", digits=3),
        Column("lost first", right=False),
        Column("lost at step"),
        Column("decided by", right=False),
        Column("at step"),
        Column("margin", digits=3),
    )
    rows = tuple(
        (
            *(str(setting.method), str(setting.agent), setting.budget, setting.track),
            *(f"{story.worst.cell}, start {story.worst.start}", story.worst.robustness),
            *((None, None) if story.loss is None else (str(story.loss.conjunct), story.loss.step)),
            "an early end" if (why := story.place.witness) is None else str(why.predicate),
            *(story.place.step, None if why is None else why.margin),
        )
        for setting, story in found.items()
    )
    notes = (
        "Of the selected policies of all seeds, the report's start with the least robustness.",
        "Lost first: the part of the formula that nothing could satisfy any more from that step on. Decided by: the "
        "predicate whose margin at that step is the robustness.",
    )
    return Table("Worst start of each method, and why", columns, rows, notes)
