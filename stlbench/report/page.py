"""One page: all that a folder of results holds, in a single HTML file that loads nothing from elsewhere."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.util import find_spec
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import quote

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.records.identity import OUTSIDE, Setting
from stlbench.records.result import Result
from stlbench.records.result_files import TRACES, cell_files, end_of_log, is_there, names, read, write
from stlbench.records.results_folder import Find
from stlbench.registry.choices import Choice
from stlbench.report import Report
from stlbench.report.figures import files
from stlbench.report.figures.regions import Load, terms
from stlbench.report.figures.style import Colours, colours_of, fitting
from stlbench.report.tables.comparisons import verdicts
from stlbench.report.tables.rows import Group, Row, columns_of
from stlbench.report.tables.runs import CELL, MEASUREMENT, score_columns, scores_and_cost
from stlbench.report.tables.table import Column, Table, show
from stlbench.simulation.faults import Ask
from stlbench.task.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stlbench.report.figures.margins import Story


MOST = 350
"""Cells that a page has one by one, of 4 kB each. Its tables and figures are of all cells."""
_LOG_LINES = 60
Shown = dict[str, Any]  # what the template shows of a task or a cell


def cells_shown(groups: Sequence[Group]) -> tuple[list[Row], Table]:
    """The cells that a page has one by one, and their table."""
    rows, notes = [row for group in groups for row in group.rows], list[str]()
    if len(rows) > MOST:
        seeds = max(1, MOST // len(groups))
        shown = [row for group in groups for row in group.rows[:seeds]][:MOST]
        which = f"first {seeds} seeds of each setting" if len(groups) <= MOST else f"first {len(shown)}"
        notes.append(f"This table has the {which}, not all {len(rows)} cells; `stlbench show cell` shows any.")
        rows = shown
    notes.append("Numbers are of the selected policy, from the report's starts. A cell opens for scores, cost and log.")
    scores, further = score_columns(lambda each: each.score, [row.measurement for row in rows if row.measurement])
    scores[Column("cell CPU", unit="s", digits=1)] = lambda each: each.cpu_seconds
    *first, reason = CELL.items()
    full = {replace(column, short=""): value for column, value in columns_of(MEASUREMENT, scores).items()}
    columns = {**dict(first), **full, **dict([reason])}
    return rows, Table.of("Cells", rows, columns, (*notes, *further)).trimmed()


def cell_part(row: Row, result: Result | None, folder: Path) -> Shown:
    """All that is recorded of one cell: facts, tables, and texts such as a traceback."""
    if result is None:
        facts = {"status": row.status, "budget": row.id.budget}
        return {"name": row.id.name, "facts": list(facts.items()), "tables": [], "texts": [], "provenance": []}
    saved, measured, outside = cell_files(folder, result.id, result.key), result.measurement, row.id.track == OUTSIDE
    written = "\n".join(end_of_log(saved.log, folder, _LOG_LINES))
    log = str(saved.log.relative_to(folder)) if written else "none here: the cell wrote nothing, or it was not kept"
    facts = {
        "status": result.status,
        "reason": result.reason,
        "budget": result.id.budget,
        "track": result.id.track,
        "policy": _policy(result, saved.policies, folder),
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
    where = str(path.relative_to(folder)) if is_there(path, folder) else "its file is not in this folder"
    return f"{where}; SHA-256 selected {stored.selected}, final {stored.final}"


FILE = "report.html"  # name of the page in a folder of results
Tell = Callable[[int, int], None]  # is called with the number of groups that are read, and of all
Facts = list[tuple[str, str]]


class Picture(NamedTuple):
    label: str  # what it shows, for those who cannot see it
    data: str
    """In base64. As an image, SVG runs nothing and loads nothing."""
    size: tuple[int, int]  # width and height in pixels
    kind: str = "svg+xml"


@dataclass(frozen=True)
class Opening:
    """The first part of a page: the answer."""

    lines: Sequence[str]
    """A paragraph each."""
    facts: Facts = field(default_factory=list)
    pictures: Sequence[Path] = ()
    """Films and pictures in the folder of the page, or in one of its folders. Large ones are links."""
    title: str = ""
    """The folder's name where empty."""


_KINDS = {".gif": "gif", ".png": "png", ".webp": "webp"}
_ROOM = 3_000_000
"""Characters of all films and figures together. The page has less than 5 MB with these and the cells."""
_FILM = _ROOM // 2
"""A longer film is a link."""


_TOO_LARGE = (
    "Figures are left out, as the page would be too large: `stlbench report` and `stlbench plot` draw them as files."
)


@dataclass
class _Room:
    """How much more may be embedded."""

    left: int

    def take(self, picture: Picture) -> Picture:
        self.left -= len(picture.data)
        return picture

    def drawn(self, drawing: files.Drawing) -> list[Picture]:
        """The picture, if there is room for one."""
        return [self.take(_picture(drawing.label, drawing.draw()))] if self.left > 0 else []


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
    opening: Opening | None = None,
) -> Path:
    """Write the page of a folder's results; the path, which is report.html in the folder if None is given.

    `find` reads the result of a cell; `load` loads a task, `ask` asks methods for their bounds, and `tell` is called
    after each task. The `opening` stands in place of the verdicts and the films of the results. Raises `UsageError` if
    jinja2 is not installed, or the file cannot be written.
    """
    require()
    path = path or folder / FILE
    if opening is None:
        films = folder / "films"
        shown = [films / name for name in names(films, folder, (".gif", ".webp"))] if path.parent == folder else []
        lines = [line for line in verdicts(report.pairs) if not line.endswith("--explain")]  # the tables have all pairs
        opening = Opening(lines, pictures=shown)
    with fitting("column"):
        text = _Page(report, find, folder, load, ask, opening, path.parent, _Room(_ROOM)).text(tell)
    try:
        return write(path, text)
    except UsageError as error:
        raise type(error)(f"{error}; --out FILE writes the page elsewhere") from error


@dataclass(frozen=True)
class _Page:
    report: Report
    find: Find
    folder: Path
    load: Load
    ask: Ask
    opening: Opening
    home: Path
    """The folder of the page."""
    room: _Room

    @cached_property
    def colours(self) -> Colours:
        return colours_of(self.report.groups)

    def text(self, tell: Tell) -> str:
        report = self.report
        embedded, links = self._opened()
        first = [picture for each in files.drawings_of_overview(report.learned) for picture in self.room.drawn(each)]
        over_all = (
            *files.drawings_across(report.fields, self.colours),
            *files.drawings_of_alignment(report.aligned, self.load),
        )
        pictures = [picture for drawing in over_all for picture in self.room.drawn(drawing)]
        of_tasks, without = self._of_tasks()
        parts, done = list[Shown](), 0
        for choice, members in groupby(report.groups, key=lambda group: group.setting.task):
            groups = list(members)
            shown = of_tasks.get(choice, [])
            part = {"key": f"task-{len(parts)}", "pictures": shown, **self.task_part(choice, groups)}
            part["lacks"] += [_TOO_LARGE] if choice in without or not all(own for _, own in part["policies"]) else []
            parts.append(part)
            done += len(groups)
            tell(done, len(report.groups))
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
            title=self.opening.title or self.folder.resolve().name or "results",
            opening=self.opening,
            first=[*first, *embedded],
            links=links,
            overview=overview,
            task_links=[f"#{keys[str(row[0])]}" for row in overview.rows],
            across=across,
            pictures=pictures,
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

    def _opened(self) -> tuple[list[Picture], list[tuple[str, str]]]:
        """The films and pictures of the opening: those that are embedded, and the others as label and link."""
        embedded, links = list[Picture](), list[tuple[str, str]]()
        for path in self.opening.pictures:
            data = read(path, self.home)
            picture = Picture(path.stem, base64.b64encode(data).decode(), _size(data), _KINDS[path.suffix])
            if len(picture.data) <= min(_FILM, self.room.left):
                embedded.append(self.room.take(picture))
            else:
                links.append((path.name, quote(str(path.relative_to(self.home)))))
        return embedded, links

    def _of_tasks(self) -> tuple[dict[Choice, list[Picture]], set[Choice]]:
        """The pictures of each task, as long as there is room: first one of each; and the tasks that lack some."""
        drawings = files.drawings_of_tasks(self.report.learned, self.colours, self.load)
        pictures = {choice: self.room.drawn(own[0]) for choice, own in drawings.items()}
        for choice, own in drawings.items():
            pictures[choice] += [picture for drawing in own[1:] for picture in self.room.drawn(drawing)]
        return pictures, {choice for choice, own in drawings.items() if len(pictures[choice]) < len(own)}

    def task_part(self, choice: Choice, groups: Sequence[Group]) -> Shown:
        """The task, the results of its policies, and the gaps of the folder."""
        from stlbench.report.figures.margins import Story, tell_story, worst_table

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
                members = [found for row in group.rows if row.measurement and (found := self.find(row.id))]
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
        from stlbench.report.figures.margins import bands_of, figures_of

        bands = bands_of(task.choice, (setting.method for setting in stories), self.ask)
        for setting, story in stories.items():
            name = f"{setting.method} ({', '.join((str(setting.agent), setting.budget, *setting.other_track))})"
            colour = self.colours[str(setting.method)]
            figures = figures_of(task, story, bands[setting.method], name, colour) if self.room.left > 0 else ()
            yield name, [self.room.take(_picture(label, figure)) for label, figure in figures]


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
    return Picture(label, base64.b64encode(files.svg_of(figure, alone=True)).decode(), (width, height))


def _size(data: bytes) -> tuple[int, int]:
    """Width and height of a picture. Raises `UsageError` where it is none."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(data), formats=("GIF", "PNG", "WEBP")) as picture:
            return picture.size
    except (UnidentifiedImageError, OSError, Image.DecompressionBombError) as error:
        raise UsageError(f"a film or picture of the page cannot be read: {error}") from error


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
