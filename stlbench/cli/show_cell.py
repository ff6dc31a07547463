"""`stlbench show cell`: one cell in full: how it ended, why, and what it scored."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import Json, console, print_json

if TYPE_CHECKING:
    from stlbench.records.result import Result


def cell(
    name: Annotated[str, typer.Argument(metavar="NAME", help="task/method/agent/seed, as the run's lines name it.")],
    folder: Annotated[Path, typer.Argument(metavar="[RESULTS]", help="A folder that `stlbench run` wrote.")] = Path(
        "results"
    ),
    budget: Annotated[
        str | None, typer.Option(metavar="NAME", help="Budget of the cell.", show_default="the only one in RESULTS")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show one cell of a folder of results: status, reason and traceback, provenance, scores, cost.

    \b
    Examples:
      stlbench show cell hold-disc/funnel/dqn/0
      stlbench show cell "overlap[without=cuts]/funnel/dqn/1" results/ablation --json
    """
    from stlbench.records.cell_files import cell_files
    from stlbench.records.identity import OUTSIDE
    from stlbench.report import to_screen
    from stlbench.report.tables.cells import cost_table, scores_table
    from stlbench.study.results import Results

    results = Results.load(folder)
    result = results.cell(name, budget)
    log = cell_files(results.folder, result.id, result.key).log
    if as_json:
        print_json(facts(result, log))
        return
    for line in _lines(result, log):
        typer.echo(line)
    if result.measurement is not None:
        typer.echo()
        measured = result.measurement
        if result.id.track == OUTSIDE:
            to_screen(scores_table({"": measured.selected}), console())
            return
        for table in (scores_table({"selected": measured.selected, "final": measured.final}), cost_table(measured)):
            to_screen(table, console())


def facts(result: Result, log: Path) -> dict[str, Any]:
    """All that is recorded of a cell, as plain values; `log` is the file of what it wrote, where there is one."""
    import json

    from stlbench.records.result import to_json

    content: dict[str, Any] = json.loads(to_json(result))
    return {"name": result.id.name, **content, "log": str(log) if log.is_file() else None}


def _lines(result: Result, log: Path) -> list[str]:
    """What is recorded; of a cell that failed also the end of its log."""
    from stlbench.records.cell_files import end_of_log
    from stlbench.records.status import ACCIDENTS

    parts = {
        "cell": result.id.name,
        "budget": result.id.budget,
        "status": result.status,
        "reason": result.reason,
        "key": result.key,
        "log": str(log) if log.is_file() else "",
        **result.provenance,
    }
    width = max(map(len, parts)) + 1
    lines = [f"{name + ':':{width}} {text}" for name, text in parts.items() if text]
    details = ["", result.details.rstrip()] if result.details else []
    written = end_of_log(log) if result.status in ACCIDENTS else []
    return [*lines, *details, *(["", "the end of its log:", *written] if written else [])]
