"""`stlbench tune`: a recipe for each method, from the same number of trials."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

import typer

from stlbench.cli.options import REQUIRED, study_options
from stlbench.cli.output import console
from stlbench.cli.run import interruptible
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.outputs import write
from stlbench.records.result import Result
from stlbench.report import Column, Table, Value, to_csv, to_screen
from stlbench.study.cell import Cell
from stlbench.study.progress import Progress, Tally
from stlbench.study.run import build_executor, run_cells
from stlbench.study.study import Study
from stlbench.study.tracks import Recipe, write_recipes
from stlbench.study.tuning import Entrant, Trial, entrants, search

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

    What may be tuned is said by the agent, the same for every method: discount, rewards in a return, learning rate, how
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
    with Ledger(study.results / FILE, create=False) as ledger:
        return {result.id: result for result in ledger.results_of(cell.id for cell in cells)}


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
