"""`stlbench policies`: the stored policies that come with stlbench, or those of a folder of results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from stlbench.cli.options import Budget, Cell
from stlbench.cli.output import Json, show
from stlbench.cli.score import score_cell
from stlbench.records.result import Result, reported
from stlbench.report import Column, Table, Value
from stlbench.share.zoo import ZOO, take, with_policies
from stlbench.study.results import Results

app = typer.Typer(rich_markup_mode=None)
Kept = Annotated[
    Path | None,
    typer.Option("--results", metavar="DIR", help="Folder of results.", show_default="what comes with stlbench"),
]


@app.callback()
def policies() -> None:
    """List, take and try stored policies: those that come with stlbench, or those of a folder of results.

    \b
    Example:
      stlbench policies list
    """


@app.command("list")
def list_policies(results: Kept = None, as_json: Json = False) -> None:
    """List stored policies with their scores: one line per cell.

    \b
    Examples:
      stlbench policies list
      stlbench policies list --results results --json
    """
    facts = list(map(_facts, with_policies(ZOO if results is None else results)))
    show(as_json, facts, [Table.of("Stored policies", facts, _COLUMNS)])


def _facts(result: Result) -> dict[str, Any]:
    assert result.measurement is not None
    cell, score = result.id, reported(result.measurement.selected)
    numbers = {"robustness": score.mean, "satisfaction": score.satisfaction, "starts": score.starts}
    return {"cell": cell.name, "budget": cell.budget, "track": cell.track, **numbers, "key": result.key}


_COLUMNS: dict[Column, Callable[[dict[str, Any]], Value]] = {
    Column("cell", right=False): lambda facts: facts["cell"],
    Column("budget", right=False, shared=True): lambda facts: facts["budget"],
    Column("track", right=False, shared=True): lambda facts: facts["track"],
    Column("mean robustness", digits=3): lambda facts: facts["robustness"],
    Column("satisfied", unit="%", digits=1): lambda facts: 100 * facts["satisfaction"],
    Column("starts"): lambda facts: facts["starts"],
}


@app.command("get")
def get(
    cell: Cell,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new folder, which takes the policy.")],
    results: Kept = None,
    budget: Budget = None,
    as_json: Json = False,
) -> None:
    """Write one policy as a folder of results of its own: arrays and record.

    Other commands read it with --results DIR: score, certify, falsify, render, export-policy. Prints the files.

    \b
    Examples:
      stlbench policies get reach-stay/raw/dqn/0 mine
      stlbench certify reach-stay/raw/dqn/0 --results mine
    """
    source = Results.load(ZOO if results is None else results)
    files = list(map(str, take(source.folder, source.cell(cell, budget), folder)))
    show(as_json, files, files)


@app.command("run")
def run(cell: Cell, results: Kept = None, budget: Budget = None, as_json: Json = False) -> None:
    """Let a policy act from the starts of the report, and say whether its score is the recorded one.

    \b
    Example:
      stlbench policies run reach-stay/raw/dqn/0
    """
    score_cell(None, cell, ZOO if results is None else results, budget, "selected", as_json)
