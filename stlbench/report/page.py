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
from stlbench.records.identity import Setting
from stlbench.records.outputs import TRACES, write
from stlbench.records.stored import Find
from stlbench.registry.choices import Choice
from stlbench.report import Report
from stlbench.report.figures.files import drawings_across, drawings_of_alignment, drawings_of_tasks, svg_of
from stlbench.report.figures.regions import Load, terms
from stlbench.report.figures.style import Colours, colours_of, fitting
from stlbench.report.page_cells import Part, cell_part, cells_shown
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Table, show
from stlbench.rollout.questions import Ask
from stlbench.task.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stlbench.report.figures.counterexample import Story

FILE = "report.html"  # name of the page in a folder of results
Tell = Callable[[int, int], None]  # is called with the number of groups that are read, and of all
Facts = list[tuple[str, str]]


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
    find: Find,
    folder: Path,
    load: Load,
    ask: Ask,
    path: Path | None = None,
    tell: Tell = lambda done, total: None,
) -> Path:
    """Write the page of a folder's results; the path, which is report.html in the folder if None is given.

    `find` reads the result of a cell; `load` loads a task, `ask` asks methods for their bounds, and `tell` is called
    after each task. Raises `UsageError` if jinja2 is not installed, or the file cannot be written.
    """
    require()
    with fitting("column"):
        text = _Page(report, find, folder, load, ask).text(tell)
    try:
        return write(path or folder / FILE, text)
    except UsageError as error:
        raise type(error)(f"{error}; --out FILE writes the page elsewhere") from error


@dataclass(frozen=True)
class _Page:
    report: Report
    find: Find
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
        overview = table.select(wide, "Overview").trimmed()
        across = [table.trimmed() for table in (*report.first, *report.across) if table.rows]
        rows, cells = cells_shown(report.groups)
        keys = {part["name"]: part["key"] for part in parts}
        details = [cell_part(row, self.find(row.id), self.folder) for row in rows]
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
                members = [found for row in group.rows if row.numbers and (found := self.find(row.id))]
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
            "worst": worst_table(stories).trimmed(folded=True),
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
        *([("notes", file.notes)] if file.notes else []),
    ]


def _of_task(report: Report, choice: Choice) -> list[Table]:
    """The rows of one task. Controllers and plans have rows of the task, and none of its ablations."""
    tables = list[Table]()
    for name in ("robustness", "comparisons", "controllers", "alignment", "time"):
        table = report.tables[name]
        task = choice.name if name in ("controllers", "alignment") else str(choice)
        if rows := tuple(row for row in table.rows if row[0] == task):
            tables.append(replace(table, rows=rows).trimmed(folded=True))
    return tables
