"""`stlbench policies`: the stored policies that come with stlbench, or those of a folder of results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from stlbench.cli.common import Json, show
from stlbench.cli.options import Budget, Cell
from stlbench.cli.score import score_cell
from stlbench.records.result import Result, Score, reported
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
    found = with_policies(ZOO if results is None else results)
    facts = []
    for result in found:
        assert result.measurement is not None
        score = reported(result.measurement.selected)
        numbers = {"robustness": score.mean, "satisfaction": score.satisfaction, "starts": score.starts}
        facts.append({"cell": result.id.name, "budget": result.id.budget, "track": result.id.track, **numbers})
    show(as_json, [fact | {"key": each.key} for fact, each in zip(facts, found, strict=True)], [_table(found.results)])


def _table(results: tuple[Result, ...]) -> Table:
    def score(result: Result) -> Score:
        assert result.measurement is not None
        return reported(result.measurement.selected)

    columns: dict[Column, Callable[[Result], Value]] = {
        Column("cell", right=False): lambda result: result.id.name,
        Column("budget", right=False, shared=True): lambda result: result.id.budget,
        Column("track", right=False, shared=True): lambda result: result.id.track,
        Column("mean robustness", digits=3): lambda result: score(result).mean,
        Column("satisfied", unit="%", digits=1): lambda result: 100 * score(result).satisfaction,
        Column("starts"): lambda result: score(result).starts,
    }
    return Table.of("Stored policies", results, columns)


@app.command("get")
def get(
    cell: Cell,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new folder, which takes the policy.")],
    results: Kept = None,
    budget: Budget = None,
    as_json: Json = False,
) -> None:
    """Write one policy as a folder of results of its own: arrays, record, and a model card.

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
