"""`stlbench report`, `stlbench plot` and `stlbench render`: tables, figures, films and the page of a folder of
results, or of bundles.
"""

import shlex
from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from stlbench.cli.common import CANNOT_TELL, warn
from stlbench.cli.options import Budget, Cell, Explain, Fitting, Folder, Listed, TaskFolders, Which
from stlbench.cli.output import Json, print_json, say
from stlbench.errors import DiskFull, UsageError, did_you_mean
from stlbench.records import results_folder
from stlbench.records.result import NOT_RUN, NOT_SCORED
from stlbench.records.result_files import inside
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choices
from stlbench.report import Report, condense, groups_of
from stlbench.report.files import write
from stlbench.report.page import require, write_page
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Width, to_records
from stlbench.share.rescored import bundles_table, read_bundles
from stlbench.simulation.faults import Question, plugins_of
from stlbench.study.plugin_guard import ask, ask_one, load_guarded
from stlbench.study.policies import Start, parse_start
from stlbench.study.progress import bar_on
from stlbench.study.results import Results
from stlbench.tracks.references import References, references

_FEW = 3  # settings that a warning names


def report(
    paths: Annotated[
        list[Path], typer.Argument(metavar="DIR | BUNDLE...", help="A folder that `stlbench run` wrote, or bundles.")
    ],
    html: Annotated[bool, typer.Option("--html", help="Write report.html alone: one page with everything.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The page's file, for --html.", show_default="DIR/report.html")
    ] = None,
    rescore: Annotated[
        bool, typer.Option("--rescore", help="Score the stored policies of bundles again, and use these scores.")
    ] = False,
    width: Fitting = "page",
    explain: Explain = False,
    task_folders: TaskFolders = None,
    as_json: Json = False,
) -> None:
    """Rebuild the tables and figures of a folder of results.

    Covers all cells that are recorded in DIR, prints what was learned and rewrites the files. Without the right to
    write in DIR, it warns and prints alone. --width column makes figures and LaTeX for one column of a paper.
    --explain prints all tables, with their notes. --json prints an object with the lists overview, robustness,
    comparisons, aggregates, groups, differences, improvement, controllers, alignment, time and cells. --html writes one
    file in place of all that: tables to sort and filter, figures, and every cell, for any browser, without a network.
    It needs the extra `page`. Prints its path; with --json an object with path and bytes.

    Several bundles stand in the same tables, methods with the name of their bundle; a bundle that `stlbench verify`
    finds damaged is left out. Nothing is written but a page. --rescore lets each selected policy act again. Exit code 1
    where a bundle is damaged, or claims more than the referee finds; 3 where a policy could not be scored.

    \b
    Examples:
      stlbench report results
      stlbench report results --html
      stlbench report results --width column
      stlbench report results --html --out page.html
      stlbench report results --json
      stlbench report mine.zip theirs.zip --rescore
    """
    if html:
        require()
    elif out is not None:
        raise UsageError("--out is the file of the page that --html writes; add --html")
    if all(path.suffix == ".zip" for path in paths):
        _report_bundles(paths, rescore, out or Path("report.html") if html else None, explain, as_json)
        return
    if len(paths) > 1 or rescore:
        raise UsageError(
            "name one folder, or bundles, which end in .zip; `stlbench results merge` puts folders together"
        )
    (folder,) = paths
    groups = groups_of(folder)
    if not groups or (html and all(row.status == NOT_RUN for group in groups for row in group.rows)):
        raise UsageError(f"{results_folder.locate(folder)} holds no result yet")
    if not html and not as_json:
        show_report(groups, folder, explain, width)
        return
    content = Report(groups, references_of(groups))
    if html:
        with results_folder.one_by_one(folder) as find:
            _write_page(content, find, folder if folder.is_dir() else folder.parent, out, as_json)
    else:
        _write(content, folder, width)
        _print_json(content)


def _report_bundles(paths: Sequence[Path], rescore: bool, page: Path | None, explain: bool, as_json: bool) -> None:
    """Show bundles in one report, or write their page; exit with code 1 where one is damaged or claims more, with 3
    where a policy was not scored."""
    bundles = read_bundles(paths, rescore, lambda cell, verdict: typer.echo(f"{cell}: {verdict}", err=True))
    results = {result.id: result for bundle in bundles for result in bundle.results}
    missing = (cell for bundle in bundles for cell in bundle.missing)
    groups = condense(results.values(), missing, (row for bundle in bundles for row in bundle.unscored))
    content = Report(groups, references_of(groups), first=(bundles_table(bundles),))
    if page is not None:
        _write_page(content, results.get, paths[0], page, as_json)
    elif as_json:
        _print_json(content)
    else:
        say(content.summary if explain else content.answer, explain=explain, explained=content.first)
    if not all(bundle.is_fine for bundle in bundles):
        raise typer.Exit(1)
    if any(bundle.verdict == NOT_SCORED for bundle in bundles):
        raise typer.Exit(CANNOT_TELL)


def _print_json(report: Report) -> None:
    tables = {table.title.lower(): table for table in report.first} | report.tables
    print_json({name: to_records(table) for name, table in tables.items()})


def show_report(
    groups: Sequence[Group], folder: Path, explain: bool, width: Width = "page", shown: Sequence[Group] | None = None
) -> None:
    """Write all files, of all groups; then print the answer of those that are to be shown, and where the files lie.

    All tables with their notes are printed if the user asks to `explain`.
    """
    content = Report(groups, references_of(groups))
    part = content if shown is None or list(shown) == list(groups) else Report(shown, content.references, groups)
    is_written = _write(content, folder, width)
    say(part.summary if explain else part.answer, explain=explain)
    _warn_of_early_ends(part.groups)
    if is_written:
        typer.echo(f"All tables: {folder}/report.md; as .csv and .tex, and figures/, beside it.")
    if not explain:
        typer.echo(f"All tables here, with notes: stlbench report {shlex.quote(str(folder))} --explain")


def _warn_of_early_ends(groups: Sequence[Group]) -> None:
    early = [
        f"{group.setting.name} ({100 * share:.3g} %)"
        for group in groups
        if any(group.values("satisfaction")) and (share := max(filter(None, group.values("ended_early")), default=0.0))
    ]
    if early:
        shown = ", ".join(early[:_FEW]) + (f" and {len(early) - _FEW} more" if len(early) > _FEW else "")
        warn(f"the environment ended episodes before the formula's horizon: {shown}; --explain says what that means")


def _write(report: Report, folder: Path, width: Width) -> bool:
    """Write all files. Whether that was possible: who may only read a folder is shown the tables, with a warning."""
    try:
        write(report, folder, load_guarded, width)
    except DiskFull:
        raise
    except UsageError as error:
        warn(str(error))
        return False
    return True


def _write_page(report: Report, find: results_folder.Find, folder: Path, out: Path | None, as_json: bool) -> None:
    from rich.console import Console

    with bar_on(Console(stderr=True, highlight=False), transient=True) as bar:
        stage = bar.add_task("figures of the methods", total=None)
        path = write_page(
            report,
            find,
            folder,
            load_guarded,
            ask,
            out,
            lambda done, total: bar.update(stage, completed=done, total=total),
        )
    size = path.stat().st_size
    if as_json:
        print_json({"path": str(path), "bytes": size})
    else:
        typer.echo(f"{path}: {size / 1e6:.1f} MB, {sum(group.tried for group in report.groups)} cells")


def references_of(groups: Sequence[Group]) -> dict[str, References]:
    """The scores to compare each task's policies with. Some seconds for a task on a MuJoCo model."""
    from rich.console import Console

    unknown = {name for name in (group.setting.task.name for group in groups) if plugins.known("tasks", name) is None}
    if unknown:
        warn(
            f"not installed: {', '.join(sorted(unknown))}; what needs the task is left out. "
            "If you trust its folder, name it: --task-folder PATH"
        )
    progress = Console(stderr=True, highlight=False)
    with progress.status("controllers of the tasks") if progress.is_terminal else nullcontext():
        return references((group.setting for group in groups), ask)


def plot(
    run: Folder,
    tasks: Listed = None,
    methods: Listed = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the figures.", show_default="RESULTS/figures")
    ] = None,
    rewarded: Annotated[
        bool, typer.Option("--rewarded", help="Draw the robustness of the tasks' rewarded form against time, too.")
    ] = False,
    width: Fitting = "page",
    only: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Kinds: learning, overview, planned, time, trajectories, rewarded.",
            show_default="all but rewarded",
        ),
    ] = None,
    task_folders: TaskFolders = None,
) -> None:
    """Draw a run: learning curves, robustness against time in its funnel, trajectories, and an overview of each task.

    Each figure is written as PNG, SVG and PDF, over the one of before; the files are printed. --width column makes
    them 3.5 inches wide, with text of 7 to 9 points, for one column of a paper.

    \b
    Examples:
      stlbench plot results
      stlbench plot results --tasks robot-nav --methods "funnel,funnel[variant=code]" --out pictures
    """
    from stlbench.report.figures import trace_figures
    from stlbench.report.figures.style import colours_of, fitting

    groups = groups_of(run)
    settings = [group.setting for group in groups if group.tried]
    some_tasks = _known(tasks, {setting.task for setting in settings}, "task", run)
    some_methods = _known(methods, {setting.method for setting in settings}, "method", run)
    if not any(setting.task in some_tasks and setting.method in some_methods for setting in settings):
        raise UsageError(f"{run} holds no result of these tasks and methods")
    chosen = (
        result
        for result in results_folder.read(run)
        if result.id.task in some_tasks and result.id.method in some_methods
    )
    folder = results_folder.folder_of(run)
    figures = out or inside(folder / "figures", folder)
    colours = colours_of(groups)
    job = trace_figures.Job(
        folder, figures, partial(typer.echo, err=True), warn, colours, load_guarded, ask, _kinds(only, rewarded)
    )
    with fitting(width):
        for path in trace_figures.draw(chosen, job):
            typer.echo(path)


def _known(text: str | None, known: set[Choice], kind: str, run: Path) -> set[Choice]:
    if text is None:
        return known
    chosen = set(parse_choices(text))
    for choice in sorted(chosen - known):
        raise UsageError(f"{run} has no {kind} '{choice}'{did_you_mean(str(choice), map(str, known))}")
    return chosen


def _kinds(text: str | None, rewarded: bool) -> Sequence[str]:
    from stlbench.report.figures.trace_figures import KINDS, USUAL

    chosen = list(USUAL) if text is None else [item.strip() for item in text.split(",")]
    for kind in chosen:
        if kind not in KINDS:
            raise UsageError(f"no kind of figure '{kind}'{did_you_mean(kind, KINDS)}")
    return [*chosen, *(["rewarded"] if rewarded else [])]


def render(
    run: Folder,
    cell: Cell,
    budget: Budget = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the files.", show_default="RESULTS/films")
    ] = None,
    form: Annotated[
        Literal["gif", "webp", "mp4", "png"],
        typer.Option("--format", help="webp is small; mp4 needs ffmpeg; png: still pictures, as vectors too."),
    ] = "gif",
    which: Which = "selected",
    start: Annotated[
        str | None, typer.Option(metavar="X,Y,...", help="Start of the stored policy, as in the task's initial box.")
    ] = None,
    start_index: Annotated[
        int | None, typer.Option(metavar="I", min=0, help="Which of the report's starts, counted from 0.")
    ] = None,
    task_folders: TaskFolders = None,
) -> None:
    """Film one cell: the best and the worst start of its report, side by side; or any one start of its stored policy.

    Systems and environments that draw themselves are shown so; of others, the plane that the task names, or the signals
    against time. With --start, --start-index, --policy final or --format png, and before an environment's camera, the
    stored policy acts again.

    \b
    Examples:
      stlbench render results reach-stay/funnel/dqn/0
      stlbench render results reach-stay/funnel/dqn/0 --start 0.3,1.2
      stlbench render results "robot-nav/funnel[variant=code]/dqn/0" --format mp4 --out films
    """
    from stlbench.study.film import ffmpeg, film_cell

    if start is not None and start_index is not None:
        raise UsageError("give --start or --start-index, not both")
    if form == "mp4":
        ffmpeg()
    chosen = Start(start_index, None if start is None else parse_start(start))
    results = Results.load(run)
    run, result = results.folder, results.cell(cell, budget)
    if result.measurement is None:
        raise UsageError(f"{result.id.name} has no policy to film: {result.how}")
    arguments = (run, result, which, chosen, form, out or inside(run / "films", run))
    filmed = ask_one(Question(film_cell, arguments, plugins_of(result.id), f"{result.id.name} cannot be filmed"))
    for remark in filmed.remarks:
        warn(remark)
    for path in filmed.paths:
        typer.echo(path)
