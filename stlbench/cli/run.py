"""`stlbench run`, `stlbench plan` and `stlbench tune`: plan the cells, run those that are missing, show the tables;
or find a recipe for each method.
"""

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from stlbench.cli.common import DISK_FULL, refuse
from stlbench.cli.options import REQUIRED, Explain, TaskName, Verbose, study_options
from stlbench.cli.output import console
from stlbench.cli.report import show_report
from stlbench.errors import DiskFull, UsageError
from stlbench.records.identity import CellId
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import ACCIDENTS, Result, accidents_of
from stlbench.records.result_files import write
from stlbench.registry import plugins
from stlbench.registry.choices import LOCAL, Choice
from stlbench.registry.named_tasks import task_of
from stlbench.report import groups_of, only
from stlbench.report.tables.table import Column, Table, Value, to_csv, to_screen
from stlbench.study.cell import Cell, Recipe, write_recipes
from stlbench.study.logs import build_logs
from stlbench.study.plan import check_cells, parse_settings, plan_alignment
from stlbench.study.plugin_guard import ask
from stlbench.study.progress import Progress, Tally, duration
from stlbench.study.run import missing_cells, results_of, run_cells, run_missing
from stlbench.study.scheduler import build_executor
from stlbench.study.study import Study, read_choices
from stlbench.study.tuning import Entrant, Trial, entrants, search
from stlbench.task.task import load_task
from stlbench.tracks.references import differences

DEFAULTS = {"tasks": "reach-stay", "methods": "funnel,flag"}  # what is compared where neither options nor a file say


@study_options(tasks=("", DEFAULTS["tasks"]), methods=("", DEFAULTS["methods"]))
def run(
    study: Annotated[
        Path | None,
        typer.Argument(metavar="[STUDY]", help="A YAML file with these options as its keys; options go before it."),
    ] = None,
    *,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would run, and how long, and stop.")] = False,
    explain: Explain = False,
    verbose: Verbose = False,
    **options: Any,
) -> None:
    """Compare reward methods: train and score every task, method, agent and seed.

    Each cell is recorded in DIR as it ends. The same command again runs only what is missing and repeats the tables,
    so an interrupted run goes on. The exit code is 1 if a cell raised, timed out or was killed, 2 for bad input or if
    every cell is unsuitable, 74 if the disk is full, 130 after ctrl-C, otherwise 0.

    \b
    Examples:
      stlbench run --tasks reach-stay --methods funnel,flag --seeds 3 --jobs 2
      stlbench run --methods "funnel,funnel[variant=code],flag[beta=10]" --budget paper --results study
      stlbench run study.yaml --seeds 10
    """
    described = Study.of(options, study) if study else Study.of(DEFAULTS | options)
    if dry_run:
        typer.echo(_what_would_run(described))
        return
    with interruptible(described.cells, described.folder), Progress(verbose) as progress:
        cells = run_missing(described, progress)
    report_cells({cell.id for cell in cells}, described.folder, explain)


def _what_would_run(study: Study) -> str:
    """The cells that are missing, and how long they take if each takes as long as those of its setting did."""
    build_logs(study.log)  # what the run itself would refuse is refused here
    cells = study.cells()  # planned once, as that takes long
    jobs = build_executor(study.executor, study.jobs, study.memory).jobs
    missing, before = missing_cells(study, cells)
    check_cells(missing)
    if not missing:
        return f"nothing would run: all {len(cells)} cells have a result"
    tally, budgets = Tally([cell.id for cell in missing]), {cell.id.budget for cell in missing}
    for result in before:
        if result.id.budget in budgets:  # cells of another budget say nothing of these
            tally.add(result)
    first = f"{len(missing)} of {len(cells)} cells would run, {jobs} at a time"
    seconds = tally.expected() / jobs
    return f"{first}, for about {duration(seconds)}" if seconds else f"{first}; nobody knows for how long"


@contextmanager
def interruptible(cells: Callable[[], Sequence[Cell]], folder: Path) -> Iterator[None]:
    """Where someone interrupts what runs these cells, or the disk is full, say how many of them are recorded, and exit
    with code 130 or `DISK_FULL`."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo(f"interrupted: {_recorded(cells(), folder)}; run the same command again to continue", err=True)
        raise typer.Exit(130) from None
    except DiskFull as error:
        refuse(f"{error}: {_recorded(cells(), folder)}; make room, and run the same command again to continue")
        raise typer.Exit(DISK_FULL) from None


def _recorded(cells: Sequence[Cell], folder: Path) -> str:
    with Ledger(folder / LEDGER) as ledger:
        count = len(ledger.finished(cell.key for cell in cells))
    return f"{count} of {len(cells)} cells are recorded in {folder}/"


def report_cells(cells: Container[CellId], folder: Path, explain: bool) -> None:
    """Write the tables of all cells in the folder and show those of some; exit with code 1 if one had an accident.

    Raises:
        UsageError: all of these cells ended as unsuitable.
    """
    recorded = groups_of(folder)
    shown = only(recorded, cells)
    rows = [row for group in shown for row in group.rows]
    show_report(recorded, folder, explain, shown=shown)
    if any(row.status in ACCIDENTS for row in rows):
        raise typer.Exit(1)
    if rows and all(row.status == "unsuitable" for row in rows):
        reasons = list(dict.fromkeys(row.reason for row in rows))
        others = f"; other cells have other reasons ({len(reasons) - 1})" if len(reasons) > 1 else ""
        raise UsageError(f"no cell fits, so nothing was trained: {rows[0].id.name}: {reasons[0]}{others}")


_RESULTS = "results/plan"


@study_options("methods", "jobs", "results", "executor", "retry", methods=("", "all that fit"), results=("", _RESULTS))
def plan(
    task: TaskName,
    *,
    settings: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Settings, a comma list: 'recipe', 'gamma=1', 'without=cuts+ends gamma=1'.",
            show_default="recipe, gamma=1, without each of cuts, ends, rewarded",
        ),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(metavar="X", help="Factor on the points of the grid, per axis.", show_default="1"),
    ] = None,
    explain: Explain = False,
    verbose: Verbose = False,
    **options: Any,
) -> None:
    """Say what the rewards of a task ask for: plan for them, and for the formula itself, without training.

    For each method and setting, the policy that is best by the reward is computed on a grid of the state and scored as
    any policy is. The table Alignment compares it with the best known. On a coarse grid (--resolution 0.6) a cell
    takes 2 to 30 seconds for a method without memory. The same command again runs only what is missing.

    \b
    Examples:
      stlbench plan overlap --methods raw,funnel --resolution 0.6
      stlbench plan reach-stay --settings "recipe,gamma=1,without=cuts gamma=1"
    """
    chosen, results = read_choices(options.get("methods")), Path(options.get("results", _RESULTS))
    cells = plan_alignment(task_of(task), chosen, None if settings is None else parse_settings(settings), resolution)
    executor, retry = build_executor(options.get("executor", LOCAL), options.get("jobs")), options.get("retry")
    with interruptible(lambda: cells, results), Progress(verbose) as progress:
        run_cells(cells, results, executor, retry=accidents_of(retry), progress=progress)
    _say_equal([cell.id for cell in cells], chosen)
    report_cells({cell.id for cell in cells}, results, explain)


def _say_equal(cells: Sequence[CellId], methods: Sequence[Choice] | None) -> None:
    """Which of the methods pay for the same on the task, and on those of its ablations that reward another form."""
    seen = set[object]()
    for task in dict.fromkeys(cell.task for cell in cells):
        loaded = load_task(task)
        if loaded.specification.formula not in seen:
            seen.add(loaded.specification.formula)
            for difference in differences(task, plugins.available("methods") if methods is None else methods, ask):
                typer.echo(f"{task}: {difference}")


_DEFAULTS = {"seeds": "100-101", "results": "results/tuning"}


@study_options(
    *("tasks", "methods", "agents", "seeds", "budget", "jobs", "results", "executor", "retry"),
    tasks=("", REQUIRED),
    methods=("", REQUIRED),
    agents=("Agents, a comma list; parameters in brackets are not tuned.", ""),
    seeds=("Seeds of each trial, from 100 on.", _DEFAULTS["seeds"]),
    results=("Folder of ledger, trials and recipes.", _DEFAULTS["results"]),
)
def tune(
    *,
    trials: Annotated[int, typer.Option(min=1, max=1000, metavar="N", help="Trials of each method on each task.")] = 20,
    **options: Any,
) -> None:
    """Find a recipe for each method on each task, with the same number of trials for all, for `run --track tuned`.

    The agent says what may be tuned, the same for every method: discount, rewards in a return, learning rate, how
    long an action is held. The first trial is the task's shared recipe. Trials are compared on the starts that are
    kept for selection, and on seeds that are not reported. DIR/recipes.yaml has the recipes, DIR/trials.csv all trials.
    The same command again runs only what is missing; with more trials it goes on.

    \b
    Examples:
      stlbench tune --tasks robot-nav,reach-stay --methods funnel,flag,raw --trials 20
      stlbench run --tasks robot-nav,reach-stay --methods funnel,flag,raw --track tuned \\
        --recipes results/tuning/recipes.yaml --seeds 10
    """
    study = Study.of(_DEFAULTS | options)
    searched = entrants(study)
    planned: dict[CellId, Cell] = {}
    total = len(searched) * trials * len(study.seeds or ())
    with interruptible(lambda: tuple(planned.values()), study.results), _Rounds(total) as progress:
        search(searched, study, trials, lambda cells: _run(cells, study, planned, progress))
    _write(searched, study, trials)
    to_screen(_table(searched), console())


class _Rounds(Progress):
    """Counts the cells of all rounds; a round is known when the one before it is done."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most = most

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        """The first round says how many cells there are at most: some trials are the same, some methods do not fit."""
        if not self.total:
            self.note(f"at most {self.most} cells")
            self.start(self.most, 0)
        self.done += done
        self.tally = Tally(missing, self.done)

    def _left(self) -> str:
        return ""


def _run(
    cells: Sequence[Cell], study: Study, planned: dict[CellId, Cell], progress: Progress
) -> Mapping[CellId, Result]:
    planned.update((cell.id, cell) for cell in cells)
    place = build_executor(study.executor, study.jobs)
    run_cells(cells, study.results, place, retry=study.retry, attempts=study.attempts, progress=progress)
    return {result.id: result for result in results_of(cells, study.results)}


def _write(searched: Sequence[Entrant], study: Study, trials: int) -> None:
    recipes: dict[str, dict[str, dict[str, Recipe]]] = {}
    for entrant in searched:
        by_agent = recipes.setdefault(str(entrant.task), {})
        by_agent.setdefault(str(entrant.agent), {})[str(entrant.method)] = entrant.recipe()
    facts: dict[str, Any] = {"trials": trials, "seeds": list(study.seeds or ()), "budget": study.budget}
    write_recipes(study.results / "recipes.yaml", recipes, facts)
    write(study.results / "trials.csv", to_csv(_table(searched)))
    typer.echo(f"{study.results / 'recipes.yaml'}\n{study.results / 'trials.csv'}")


def _table(searched: Sequence[Entrant]) -> Table:
    tuned = dict.fromkeys(name for entrant in searched for name in entrant.space)
    columns: dict[Column, Callable[[tuple[Entrant, int, Trial]], Value]] = {
        Column("task", right=False, shared=True): lambda row: str(row[0].task),
        Column("agent", right=False, shared=True): lambda row: str(row[0].agent),
        Column("method", right=False): lambda row: str(row[0].method),
        Column("trial"): lambda row: row[1],
        **{Column(name): lambda row, name=name: row[2].values.get(name) for name in tuned},  # type: ignore[misc]
        Column("status", right=False, shared=True): lambda row: row[2].status,
        Column("satisfaction", digits=3): lambda row: row[2].satisfaction,
        Column("robustness", digits=3): lambda row: row[2].robustness,
        Column("chosen", right=False): lambda row: "yes" if row[2] is row[0].best else None,
    }
    rows = ((entrant, number, trial) for entrant in searched for number, trial in enumerate(entrant.trials))
    note = (
        "Satisfaction and robustness from the starts that are kept for selection, mean over the seeds. The first trial "
        "is the recipe that all methods share."
    )
    return Table.of("Trials", rows, columns, (note,))
