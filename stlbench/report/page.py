"""One page: all that a folder of results holds, in a single HTML file that loads nothing from elsewhere."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.records.identity import OUTSIDE, CellId, Setting
from stlbench.records.outputs import TRACES, cell_files, end_of_log, write
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.report import Report
from stlbench.report.figures.files import drawings_across, drawings_of_alignment, drawings_of_tasks, svg_of
from stlbench.report.figures.regions import Load, terms
from stlbench.report.figures.style import Colours, colours_of, fitting
from stlbench.report.tables.cells import CELL, ENDED_EARLY, if_done, percent, scores_and_cost
from stlbench.report.tables.rows import Group, Numbers, Row
from stlbench.report.tables.table import Column, Table, Value, show
from stlbench.rollout.questions import Ask
from stlbench.task.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stlbench.report.figures.counterexample import Story

FILE = "report.html"  # name of the page in a folder of results
MOST = 2000
"""Cells that a page has one by one. Its tables and figures are of all cells."""
_LOG_LINES = 60
Tell = Callable[[int, int], None]  # is called with the number of groups that are read, and of all
Facts = list[tuple[str, str]]
Part = dict[str, Any]  # what the template shows of a task or a cell


class Picture(NamedTuple):
    label: str  # what it shows, for those who cannot see it
    data: str
    """SVG in base64. As an image it runs nothing and loads nothing."""
    size: tuple[int, int]  # width and height in pixels


def require() -> None:
    """Raise `UsageError` if the extra `page` is not installed."""
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
    """Write the page of a folder's results; the path, which is report.html in the folder if None is given.

    The `results` are read one at a time. `load` loads a task, `ask` asks methods for their bounds, and `tell` is called
    after each task. Raises `UsageError` if jinja2 is not installed, or the file cannot be written.
    """
    require()
    with fitting("column"):
        text = _Page(report, results, folder, load, ask).text(tell)
    try:
        return write(path or folder / FILE, text)
    except UsageError as error:
        raise type(error)(f"{error}; --out FILE writes the page elsewhere") from error


@dataclass(frozen=True)
class _Page:
    report: Report
    results: Mapping[CellId, Result]
    folder: Path
    load: Load
    ask: Ask

    @cached_property
    def colours(self) -> Colours:
        return colours_of(self.report.groups)

    def text(self, tell: Tell) -> str:
        report = self.report
        drawings = drawings_of_tasks(report.learned, self.colours, self.load)
        parts, done = list[Part](), 0
        for choice, members in groupby(report.groups, key=lambda group: group.setting.task):
            groups = list(members)
            pictures = [_picture(drawing.label, drawing.draw()) for drawing in drawings.get(choice, [])]
            parts.append({"key": f"task-{len(parts)}", "pictures": pictures, **self.task_part(choice, groups)})
            done += len(groups)
            tell(done, len(report.groups))
        over_all = (*drawings_across(report.fields, self.colours), *drawings_of_alignment(report.aligned, self.load))
        table = report.tables["robustness"]
        wide = (i for i, column in enumerate(table.columns) if column.drop <= 2 and not column.below)
        overview = _trimmed(table.select(wide, "Overview"))
        across = [
            *report.first,
            *(report.tables[name] for name in ("aggregates", "improvement", "groups", "differences")),
        ]
        across = [_trimmed(table) for table in across if table.rows]
        rows, cells = cells_shown(report.groups)
        keys = {part["name"]: part["key"] for part in parts}
        details = [_cell_part(row, self.results.get(row.id), self.folder) for row in rows]
        tables = [overview, *across, cells, *(table for part in parts for table in (*part["tables"], part["worst"]))]
        tables += [table for part in details for table in part["tables"]]
        return _rendered(
            title=self.folder.resolve().name or "results",
            overview=overview,
            task_links=[f"#{keys[str(row[0])]}" for row in overview.rows],
            across=across,
            pictures=[_picture(drawing.label, drawing.draw()) for drawing in over_all],
            parts=parts,
            cells=cells,
            details=details,
            notes={
                table.notes: (f"notes-{i}", table.title.partition(":")[0])
                for i, table in enumerate(tables)
                if table.notes
            },
            circumstances=report.circumstances,
        )

    def task_part(self, choice: Choice, groups: Sequence[Group]) -> Part:
        """What the task is, what its policies did, and what the folder lacks."""
        from stlbench.report.figures.counterexample import Story, tell_story, worst_table

        shown = [group for group in groups if group.outside or group in self.report.learned]
        task, lacks, stories = None, list[str](), dict[Setting, Story]()
        try:
            task = self.load(choice)
        except UsageError as error:
            lacks.append(f"The task is not known here, so neither its formula nor traces are shown: {error}")
        if not any(each.curve for group in shown for each in group.done):
            lacks.append("No checkpoint is recorded: there are no learning curves.")
        if task is not None and not (self.folder / TRACES).is_dir():
            lacks.append(f"There is no folder {TRACES}/ beside these results: what policies did is not shown.")
        elif task is not None:
            for group in shown:
                members = [self.results[row.id] for row in group.rows if row.numbers is not None]
                try:
                    if story := tell_story(task, members, self.folder):
                        stories[group.setting] = story
                except UsageError as error:
                    lacks.append(str(error))
        return {
            "name": str(choice),
            "title": "" if task is None else task.file.title,
            "facts": [] if task is None else _facts(task),
            "lacks": lacks,
            "tables": _of_task(self.report, choice),
            "worst": _trimmed(worst_table(stories), folded=True),
            "policies": [] if task is None else list(self._policies(task, stories)),
        }

    def _policies(self, task: Task, stories: Mapping[Setting, Story]) -> Iterator[tuple[str, list[Picture]]]:
        """The figures of each group: best, median and worst start; robustness in time; the reason of the worst."""
        from stlbench.report.figures.counterexample import figures_of
        from stlbench.report.figures.margins import bands_of

        bands = bands_of(task.choice, (setting.method for setting in stories), self.ask)
        for setting, story in stories.items():
            track = "" if setting.track == "shared" else f", {setting.track}"
            name = f"{setting.method} ({setting.agent}, {setting.budget}{track})"
            figures = figures_of(task, story, bands[setting.method], name, self.colours[str(setting.method)])
            yield name, [_picture(label, figure) for label, figure in figures]


def _rendered(**content: Any) -> str:
    """The template, filled in. jinja2 escapes all texts."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("stlbench.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["shown"] = lambda value, column: show(value, column.digits)
    nonce = hashlib.sha256(repr(content).encode()).hexdigest()[:32]
    return environment.get_template("page.html").render(nonce=nonce, **content)


def _picture(label: str, figure: Figure) -> Picture:
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    return Picture(label, base64.b64encode(svg_of(figure, alone=True)).decode(), (width, height))


def _facts(task: Task) -> Facts:
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


def _trimmed(table: Table, *, folded: bool = False) -> Table:
    """Without empty columns. If `folded`, what all rows share goes into the title, as on a screen."""
    empty = [all(value in (None, "") for value in values) for values in zip(*table.rows, strict=True)]
    shown = [i for i in range(len(table.columns)) if not table.rows or not empty[i]]
    alike = [i for i in shown if folded and i in table.alike]
    return table.select((i for i in shown if i not in alike), table.title_with(alike))


def _of_task(report: Report, choice: Choice) -> list[Table]:
    """The rows of one task. Controllers and plans have rows of the task, and none of its ablations."""
    tables = list[Table]()
    for name in ("robustness", "comparisons", "controllers", "alignment", "time"):
        table = report.tables[name]
        task = choice.name if name in ("controllers", "alignment") else str(choice)
        if rows := tuple(row for row in table.rows if row[0] == task):
            tables.append(_trimmed(replace(table, rows=rows), folded=True))
    return tables


def cells_shown(groups: Sequence[Group]) -> tuple[list[Row], Table]:
    rows, notes = [row for group in groups for row in group.rows], list[str]()
    if len(rows) > MOST:
        seeds = max(1, MOST // len(groups))
        notes.append(f"Of {len(rows)} cells the first {seeds} seeds of each setting; `stlbench show cell` shows any.")
        rows = [row for group in groups for row in group.rows[:seeds]]
    notes.append(
        "Of the selected policy, from the report's starts. Open a cell for its scores, cost, provenance and log."
    )
    numbers: dict[Column, Callable[[Numbers], Value]] = {
        Column("mean robustness", digits=3): lambda each: each.robustness_mean,
        Column("worst start", digits=3): lambda each: each.robustness_min,
        Column("satisfied", unit="%", digits=1): lambda each: 100 * each.satisfaction,
        Column("ended early", unit="%", digits=1): lambda each: percent(each.ended_early),
        Column("cell CPU", unit="s", digits=1): lambda each: each.cpu_seconds,
    }
    if any(row.numbers and row.numbers.ended_early for row in rows):
        notes.append(ENDED_EARLY)
    else:
        numbers = {column: value for column, value in numbers.items() if column.title != "ended early"}
    *first, reason = CELL.items()
    columns = {**dict(first), **if_done(numbers), **dict([reason])}
    return rows, _trimmed(Table.of("Cells", rows, columns, tuple(notes)))


def _cell_part(row: Row, result: Result | None, folder: Path) -> Part:
    """All that is recorded of one cell: facts, tables, and texts such as a traceback."""
    if result is None:
        facts = {"status": row.status, "budget": row.id.budget}
        return {"name": row.id.name, "facts": list(facts.items()), "tables": [], "texts": [], "provenance": []}
    files, measured, outside = cell_files(folder, result.id, result.key), result.measurement, row.id.track == OUTSIDE
    written = "\n".join(end_of_log(files.log, _LOG_LINES))
    log = str(files.log.relative_to(folder)) if written else "none here: the cell wrote nothing, or it was not kept"
    facts = {
        "status": result.status,
        "reason": result.reason,
        "budget": result.id.budget,
        "track": result.id.track,
        "policy": _policy(result, files.policies, folder),
        "log": log,
    }
    texts = {"Traceback": result.details, "End of its log": written}
    return {
        "name": result.id.name,
        "facts": [(name, text) for name, text in facts.items() if text],
        "tables": [] if measured is None else scores_and_cost(measured, outside=outside),
        "texts": [(title, text) for title, text in texts.items() if text],
        "provenance": [*result.provenance.items(), ("key", result.key)],
    }


def _policy(result: Result, path: Path, folder: Path) -> str:
    stored = result.measurement.policies if result.measurement else None
    if stored is None:
        return "none is stored" if result.measurement else ""
    where = str(path.relative_to(folder)) if path.is_file() else "its file is not in this folder"
    return f"{where}; SHA-256 selected {stored.selected}, final {stored.final}"
