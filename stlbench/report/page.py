"""One page: all that a folder of results holds, in a single HTML file that loads nothing from elsewhere."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.records.cell_files import TRACES
from stlbench.records.identity import CellId, Setting
from stlbench.records.outputs import write
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.report.figures.palette import Colours, colours_of
from stlbench.report.figures.report_figures import (
    Drawing,
    drawings_across,
    drawings_of_alignment,
    drawings_of_tasks,
)
from stlbench.report.figures.style import fitting
from stlbench.report.figures.units import Load
from stlbench.report.page_cells import cell_part, cells_shown, first_cells
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Table, Value, show
from stlbench.rollout.questions import Ask
from stlbench.task.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stlbench.report.report import Report

FILE = "report.html"
"""Name of the page in a folder of results."""

Tell = Callable[[int, int], None]
"""Is told how many groups of how many are read."""


class Picture(NamedTuple):
    """A figure on the page."""

    label: str
    """What it shows, for those who cannot see it."""
    data: str
    """SVG in base64. As an image it runs nothing and loads nothing."""
    size: tuple[int, int]
    """Width and height in pixels."""


@dataclass(frozen=True)
class TaskPart:
    """The part of one task."""

    key: str
    name: str
    title: str
    facts: list[tuple[str, str]]
    """Name and text: formula, terms, source."""
    lacks: list[str]
    """What the folder does not hold, in a line each."""
    tables: list[Table]
    pictures: list[Picture]
    worst: Table
    """The worst start of each group, and why; without rows where no traces are there."""
    policies: list[tuple[str, list[Picture]]]
    """What the policies of each group did."""


def require() -> None:
    """Raise `UsageError` where the extra `page` is not installed."""
    if find_spec("jinja2") is None:
        raise UsageError('the page needs the package jinja2: pip install "stlbench-rl[page]"')


def write_page(
    report: Report,
    results: Mapping[CellId, Result],
    folder: Path,
    load: Load,
    ask: Ask,
    path: Path | None = None,
    tell: Tell = lambda done, total: None,
) -> Path:
    """Write the page of a folder's results; the path.

    Args:
        report: of all of them.
        results: those of its cells, of which one is asked for at a time; cells without a result are not there.
        folder: where traces, policies and logs are, as far as they are there.
        load: loads a task.
        ask: asks methods for their bounds.
        path: the file, in the folder where none is given; folders above it are made.
        tell: is called after each group of cells.

    Raises:
        UsageError: jinja2 is not installed, or the file cannot be written.
    """
    require()
    with fitting("column"):
        text = _page(report, results, folder, load, ask, tell)
    try:
        return write(path or folder / FILE, text)
    except UsageError as error:
        raise type(error)(f"{error}; --out FILE writes the page elsewhere") from error


def _page(report: Report, results: Mapping[CellId, Result], folder: Path, load: Load, ask: Ask, tell: Tell) -> str:
    colours = colours_of(report.groups)
    drawings = drawings_of_tasks(report.learned, colours, load)
    parts, done = list[TaskPart](), 0
    for task, several in groupby(report.groups, key=lambda group: group.setting.task):
        groups = list(several)
        parts.append(
            _task_part(f"task-{len(parts)}", groups, drawings.get(task, []), report, results, folder, load, ask)
        )
        done += len(groups)
        tell(done, len(report.groups))
    keys = {part.name: part.key for part in parts}
    overview = _overview(report.tables["robustness"])
    rows, left_out = first_cells(report.groups)
    across = [*report.first, *(table for name in ("aggregates", "improvement") if (table := report.tables[name]).rows)]
    cells = cells_shown(rows, left_out)
    tables = [overview, *across, cells, *(table for part in parts for table in (*part.tables, part.worst))]
    return _rendered(
        title=folder.resolve().name or "results",
        overview=overview,
        task_links=[f"#{keys[str(row[0])]}" for row in overview.rows],
        across=[_trimmed(table) for table in across],
        pictures=_drawn([*drawings_across(report.fields, colours), *drawings_of_alignment(report.aligned, load)]),
        parts=parts,
        cells=_trimmed(cells),
        details=[cell_part(row, results.get(row.id), folder) for row in rows],
        notes={
            table.notes: (f"notes-{i}", table.title.partition(":")[0]) for i, table in enumerate(tables) if table.notes
        },
        circumstances=report.circumstances,
    )


def _rendered(**content: Any) -> str:
    """The template, filled in. Whatever a name holds is text there: jinja2 escapes it."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("stlbench.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["shown"] = lambda value, column: show(value, column.digits)
    template = environment.get_template("page.html")
    nonce = hashlib.sha256(repr(content).encode()).hexdigest()[:32]
    return template.render(nonce=nonce, **content)


def _drawn(drawings: Sequence[Drawing]) -> list[Picture]:
    return [_picture(drawing.label, drawing.draw()) for drawing in drawings]


def _picture(label: str, figure: Figure) -> Picture:
    from stlbench.report.figures.files import svg_of

    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return Picture(label, base64.b64encode(svg_of(figure)).decode(), (width, height))


# ------------------------------------------------------------------------------------------------------------ tables


def _overview(table: Table) -> Table:
    """The columns of the table of robustness that a wide screen shows."""
    shown = [i for i, column in enumerate(table.columns) if column.drop <= 2 and not column.below]
    rows = tuple(tuple(row[i] for i in shown) for row in table.rows)
    return _trimmed(Table("Overview", tuple(table.columns[i] for i in shown), rows, table.notes))


def _trimmed(table: Table, *, folded: bool = False) -> Table:
    """Without columns that hold nothing; where `folded`, what all rows share goes into the title, as on a screen."""
    columns, rows = table.columns, table.rows
    shown = [i for i in range(len(columns)) if not rows or any(row[i] not in (None, "") for row in rows)]
    alike = [i for i in shown if folded and columns[i].shared and len({row[i] for row in rows}) == 1]
    common = ", ".join(f"{columns[i].heading} {show(rows[0][i])}" for i in alike)
    shown = [i for i in shown if i not in alike]
    return Table(
        f"{table.title}: {common}" if common else table.title,
        tuple(columns[i] for i in shown),
        tuple(tuple(row[i] for i in shown) for row in rows),
        table.notes,
    )


def _of_task(report: Report, choice: Choice) -> list[Table]:
    """The rows of one task; what belongs to the task and its ablations alike has its name alone."""
    names: dict[str, Value] = {
        "robustness": str(choice),
        "comparisons": str(choice),
        "controllers": choice.name,
        "alignment": choice.name,
        "time": str(choice),
    }
    tables = list[Table]()
    for name, task in names.items():
        table = report.tables[name]
        rows = tuple(row for row in table.rows if row[0] == task)
        if rows:
            tables.append(_trimmed(Table(table.title, table.columns, rows, table.notes), folded=True))
    return tables


# ------------------------------------------------------------------------------------------------------------- tasks


def _task_part(
    key: str,
    groups: Sequence[Group],
    drawings: Sequence[Drawing],
    report: Report,
    results: Mapping[CellId, Result],
    folder: Path,
    load: Load,
    ask: Ask,
) -> TaskPart:
    from stlbench.report.stories import Story, tell_story, worst_table

    choice = groups[0].setting.task
    shown = [group for group in groups if group.outside or group in report.learned]
    task, lacks, stories = None, list[str](), dict[Setting, Story]()
    try:
        task = load(choice)
    except UsageError as error:
        lacks.append(f"The task is not known here, so neither its formula nor traces are shown: {error}")
    if not any(each.curve for group in shown for each in group.done):
        lacks.append("No checkpoint is recorded: there are no learning curves.")
    if task is not None and not (folder / TRACES).is_dir():
        lacks.append(f"There is no folder {TRACES}/ beside these results: what policies did is not shown.")
    elif task is not None:
        for group in shown:
            members = [results[row.id] for row in group.rows if row.numbers is not None]
            try:
                story = tell_story(task, members, folder)
            except UsageError as error:
                lacks.append(str(error))
                continue
            if story is not None:
                stories[group.setting] = story
    colours = colours_of(report.groups)
    return TaskPart(
        key=key,
        name=str(choice),
        title="" if task is None else task.file.title,
        facts=[] if task is None else _facts(task),
        lacks=lacks,
        tables=_of_task(report, choice),
        pictures=_drawn(drawings),
        worst=_trimmed(worst_table(stories), folded=True),
        policies=[] if task is None else _policies(task, stories, colours, ask),
    )


def _facts(task: Task) -> list[tuple[str, str]]:
    from stlbench.report.figures.regions import terms

    file, parts = task.file, terms(task)
    seconds = file.steps * file.sampling_time
    return [
        ("formula", str(task.formula)),
        *(("term", str(term.formula)) for term in (parts if len(parts) > 1 else ())),
        ("episode", f"{file.steps} steps of {file.sampling_time:g} s, {seconds:g} s together"),
        ("horizon", f"{stl.horizon(task.formula)} steps"),
        ("source", file.source),
        *([("notes", " ".join(file.notes.split()))] if file.notes else []),
    ]


def _policies(
    task: Task, stories: Mapping[Setting, Any], colours: Colours, ask: Ask
) -> list[tuple[str, list[Picture]]]:
    """The figures of each group: best, median and worst start; robustness in time; why the worst is as it is."""
    from stlbench.report.figures.margins import bands_of
    from stlbench.report.stories import figures_of

    bands = bands_of(task.choice, (setting.method for setting in stories), ask)
    policies = list[tuple[str, list[Picture]]]()
    for setting, story in stories.items():
        track = "" if setting.track == "shared" else f", {setting.track}"
        name = f"{setting.method} ({setting.agent}, {setting.budget}{track})"
        figures = figures_of(task, story, bands[setting.method], name, colours[str(setting.method)])
        policies.append((name, [_picture(label, figure) for label, figure in figures]))
    return policies
