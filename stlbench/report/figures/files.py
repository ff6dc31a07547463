"""Which figures a report has, and their files. PNG and SVG have a digest of what they were drawn from.

A figure whose files were drawn from the same is not drawn again: matplotlib alone takes a second to import.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib import import_module, metadata
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import stlbench
from stlbench.errors import UsageError
from stlbench.records.result_files import is_there, to_read, write
from stlbench.registry.choices import Choice
from stlbench.report.figures.regions import Load, Scale, scale_of_task
from stlbench.report.figures.style import Colours, colours_of, fitting, names_by, now, pages, rc
from stlbench.report.tables.across import Field
from stlbench.report.tables.rows import Group
from stlbench.report.tables.sampled import drawn
from stlbench.report.tables.table import Width
from stlbench.report.tables.yardsticks import Aligned
from stlbench.statistics.across import FEWEST

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stlbench.report import Report

_HEAD = 4096  # the first bytes of a file, which have the digest
_ENDS = ("png", "svg", "pdf")
_DPI = 200


def file_name(*parts: str) -> str:
    """The parts as one name of a file, such as time-hold-disc-funnel. Raises `UsageError` if that could be a path.

    Names of plugins and their parameters can always name a file; a ledger of somebody else may have any text.
    """
    for part in parts:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.,=+\[\]-]*", part):
            raise UsageError(f"{part!r} cannot name a figure's file: letters, digits and _ . , = + - [ ] can")
    return "-".join(parts)


@dataclass(frozen=True)
class Drawing:
    name: str  # of its files
    label: str  # what it shows, for those who cannot see it
    function: tuple[str, str]
    """Module and name, in this room, of the function that draws it. The module imports matplotlib."""
    values: tuple[Any, ...]  # the function's arguments: what it is drawn from

    def draw(self) -> Figure:
        module, name = self.function
        figure: Figure = getattr(import_module(f"{__package__}.{module}"), name)(*self.values)
        return figure

    def write(self, folder: Path) -> list[Path]:
        """Write the files, unless they are there and were drawn from the same; their paths.

        A PDF has no digest within its first bytes; it is written before the others, which have it.
        """
        source = sha256(repr((_code(), now(), self.name, self.values)).encode()).hexdigest()
        *noted, pdf = paths = [folder / f"{self.name}.{end}" for end in _ENDS]
        try:
            if is_there(pdf, folder) and all(source.encode() in _head(path) for path in noted):
                return paths
        except (OSError, UsageError):
            pass  # a file is missing, or is none
        return save(self.draw(), folder, self.name, source)


def _head(path: Path) -> bytes:
    with to_read(path, path.parent) as file:
        return file.read(_HEAD)


@cache
def _code() -> tuple[str, ...]:
    """Versions, and the code of this room, so that a change of it shows without a new version."""
    code = sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        code.update(path.read_bytes())
    return stlbench.__version__, metadata.version("matplotlib"), code.hexdigest()


def save(figure: Figure, folder: Path, name: str, source: str = "") -> list[Path]:
    """Write the figure as `name`.png, .svg and .pdf, the same bytes whenever it is drawn again; their paths.

    In the vector files text is text. The PNG has 256 colours, a third of the size, since reports are committed. They
    are chosen for coverage: the usual median cut merged colours of few pixels, such as a legend's. PNG and SVG keep the
    `source`, a digest of what it was drawn from.
    """
    import matplotlib as mpl
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    picture, few, pdf, note = BytesIO(), BytesIO(), BytesIO(), PngInfo()
    with mpl.rc_context(rc()):
        figure.savefig(pdf, format="pdf", metadata={"CreationDate": None})
        figure.savefig(picture, format="png", dpi=_DPI)
    if source:
        note.add_text("Source", source)
    colours = Image.open(picture).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    colours.save(few, format="png", optimize=True, pnginfo=note)
    contents = {"pdf": pdf.getvalue(), "svg": svg_of(figure, source), "png": few.getvalue()}
    for end, content in contents.items():
        write(folder / f"{name}.{end}", content)
    return [folder / f"{name}.{end}" for end in _ENDS]


def save_svg(figure: Figure, path: Path) -> None:
    """Write the figure as SVG alone, the same bytes whenever it is drawn again."""
    path.write_bytes(svg_of(figure))


def svg_of(figure: Figure, source: str = "", *, alone: bool = False) -> bytes:
    """The figure as SVG; if `alone`, without a background and letters as shapes: it looks the same without its font."""
    import matplotlib as mpl

    file = BytesIO()
    with mpl.rc_context(rc() | ({"svg.fonttype": "path"} if alone else {})):
        figure.savefig(file, format="svg", metadata={"Date": None, "Identifier": source or None}, transparent=alone)
    return file.getvalue()


ROWS_PER_FIGURE = 24  # groups that have a row each
MOST_TASKS = 24
"""A report of more tasks has no figures of single ones: each takes seconds, and nobody looks at hundreds."""


def write_figures(report: Report, folder: Path, load: Load, width: Width) -> list[Path]:
    colours = colours_of(report.groups)
    with fitting(width):
        few = len({group.setting.task for group in report.learned}) <= MOST_TASKS
        of_tasks = drawings_of_tasks(report.learned, colours, load).values() if few else ()
        drawings = [
            *(drawing for several in of_tasks for drawing in several),
            *drawings_of_overview(report.learned),
            *drawings_across(report.fields, colours),
            *drawings_of_alignment(report.aligned, load),
        ]
        return [path for drawing in drawings for path in drawing.write(folder)]


TASKS_PER_FIGURE = 48
"""Rows of an overview."""


def drawings_of_overview(groups: Sequence[Group]) -> list[Drawing]:
    """All tasks and methods at a glance; none of one task, or of one method."""
    methods = sorted({str(group.setting.method) for group in groups})
    if len(methods) < 2 or len({group.setting.task for group in groups}) < 2:
        return []
    rows = dict[str, list[Group]]()
    for name, group in zip(names_by("task", groups), groups, strict=True):
        rows.setdefault(name, []).append(group)
    return [
        Drawing(
            "overview" + end,
            "On how many seeds each method learned each task; the overview table has the numbers",
            ("across", "overview"),
            (page, methods),
        )
        for end, page in pages([*rows.items()], TASKS_PER_FIGURE)
    ]


def drawings_of_tasks(groups: Sequence[Group], colours: Colours, load: Load) -> dict[Choice, list[Drawing]]:
    """Robustness by method, and learning curves, of each task that has a finished cell.

    If a task has more groups than one figure takes, further figures have names that end in _2, _3, ...
    """
    drawings = dict[Choice, list[Drawing]]()
    for task, members in groupby(groups, key=lambda group: group.setting.task):
        of_task, scale = list(members), scale_of_task(task, load)
        if any(group.done for group in of_task):
            drawings[task] = [
                Drawing(
                    file_name("robustness", str(task)) + end,
                    f"Robustness by seed of {len(page)} methods on {task}; the table of robustness has the numbers",
                    ("methods", "robustness_by_method"),
                    (page, scale, _own(colours, page)),
                )
                for end, page in pages(of_task, ROWS_PER_FIGURE)
            ]
            drawings[task] += drawings_of_learning(of_task, colours, scale)
    return drawings


def drawings_of_learning(groups: Sequence[Group], colours: Colours, scale: Scale) -> list[Drawing]:
    """Learning curves of one task's groups, each track by itself; none of results without checkpoints."""
    return [
        Drawing(
            file_name("learning", str(page[0].setting.task), *page[0].setting.other_track) + end,
            f"Satisfaction and robustness of the checkpoints of {len(page)} methods, against environment steps",
            ("methods", "learning_curves"),
            (page, scale, _own(colours, page)),
        )
        for track in dict.fromkeys(group.setting.track for group in groups)
        for end, page in pages([group for group in groups if group.setting.track == track])
        if any(measured.curve for group in page for measured in group.done)
    ]


def drawings_across(fields: Sequence[Field], colours: Colours) -> list[Drawing]:
    label = (
        "Interquartile means of the methods over all tasks, and the share of runs above each score; the table "
        "across tasks has the numbers"
    )
    drawings = list[Drawing]()
    for kind, members in groupby(fields, key=lambda field: (field.budget, field.track)):
        several = tuple(members)
        own = {entry.method: colours[entry.method] for entry in several[0].entries}
        drawings.append(Drawing(file_name("across", *kind), label, ("across", "across_tasks"), (several, own)))
    return drawings + _groups(fields, colours) + _ranks(fields, colours)


def _groups(fields: Sequence[Field], colours: Colours) -> list[Drawing]:
    label = "What each method learned of each group of drawn tasks; the table of groups has the numbers"
    shares = "The share of each method's runs that satisfy from so many starts or more, from half of them to all"
    drawings = list[Drawing]()
    for field in drawn(fields):
        kind, own = (field.budget, field.track), {entry.method: colours[entry.method] for entry in field.entries}
        drawings.append(Drawing(file_name("groups", *kind), label, ("methods", "groups"), (field,)))
        drawings.append(Drawing(file_name("satisfied", *kind), shares, ("methods", "satisfied"), (field, own)))
    return drawings


def _ranks(fields: Sequence[Field], colours: Colours) -> list[Drawing]:
    """For drawn tasks alone, since the tests are over a sample of tasks; for three methods or more that all fit."""
    label = "The mean rank of each method over the drawn tasks, and which methods may be alike"
    fitting = [field for field in fields if field.groups and all(all(entry.scores) for entry in field.entries)]
    return [
        Drawing(
            file_name("ranks", field.budget, field.track),
            label,
            ("across", "ranks"),
            (field, {entry.method: colours[entry.method] for entry in field.entries}),
        )
        for field in {(field.budget, field.track): field for field in fitting}.values()
        if len(field.entries) > 2 and len(field.tasks) >= FEWEST
    ]


def drawings_of_alignment(rows: Sequence[Aligned], load: Load) -> list[Drawing]:
    """One figure of all that was planned; none without a finished plan."""
    finished = [row for row in rows if row.reward_optimal is not None]
    units = {row.task: scale_of_task(row.task, load).unit for row in finished}
    label = "The best known robustness, the best policy by each reward, and what was learned with it"
    return [Drawing("alignment", label, ("across", "alignment"), (finished, units))] if finished else []


def _own(colours: Colours, groups: Sequence[Group]) -> dict[str, str]:
    return {method: colours[method] for method in (str(group.setting.method) for group in groups)}
