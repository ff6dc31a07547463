"""`stlbench results`: take cells out of a folder of results, and put folders together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import typer

from stlbench.cli.common import warn
from stlbench.cli.options import Folder
from stlbench.cli.output import Json, show
from stlbench.errors import UsageError
from stlbench.records import upkeep
from stlbench.records.upkeep import Merged

app = typer.Typer(rich_markup_mode=None)


@app.callback()
def results() -> None:
    """Remove cells from a folder of results, or merge folders.

    \b
    Example:
      stlbench results merge results other-machine/results
    """


@app.command("remove")
def remove(
    folder: Folder,
    cells: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CELL]...", help="Names, task/method/agent/seed; '*' stands for any characters."),
    ] = None,
    status: Annotated[
        list[str] | None, typer.Option(metavar="STATUS", help="Only cells that ended so. May be given several times.")
    ] = None,
    budget: Annotated[str | None, typer.Option(metavar="NAME", help="Only cells of this budget.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    as_json: Json = False,
) -> None:
    """Remove cells from the ledger, with their traces, policies and logs: `stlbench run` measures them again.

    At least one of CELL, --status and --budget is needed; a cell is removed if all that are given fit. Prints the
    cells, and asks before it removes them. Where other seeds of a cell stay, tables count it as not run. --json prints
    a list of them and needs --yes.

    \b
    Examples:
      stlbench results remove results reach-stay/funnel/dqn/0
      stlbench results remove results "reach-stay/*" --status raised --status timeout --yes
    """
    chosen = upkeep.choose(folder, cells, status, budget)
    if as_json and not yes:
        raise UsageError("--json cannot ask for a yes; add --yes")
    if not as_json:
        for result in chosen:
            typer.echo(f"{result.id.name} {result.id.budget} {result.status}")
        if not yes:
            typer.confirm(f"Remove {_count(len(chosen))} from {folder}/?", abort=True, err=True)
    upkeep.remove(folder, [result.id for result in chosen])
    facts = [{"cell": result.id.name, "budget": result.id.budget, "status": result.status} for result in chosen]
    show(
        as_json,
        facts,
        [f"Removed {_count(len(chosen))} from {folder}/; the tables there change with `stlbench report`"],
    )


@app.command("merge")
def merge(
    into: Annotated[Path, typer.Argument(metavar="INTO", help="Folder of results that takes the cells.")],
    sources: Annotated[
        list[Path], typer.Argument(metavar="FROM...", help="Folders of results; they stay as they are.")
    ],
    as_json: Json = False,
) -> None:
    """Copy the cells of other folders of results, with their traces and policies.

    Of a cell that several folders have, a result that is no failure stays, and of two such the one that was measured
    last. Cells that were planned and have no result are planned in INTO too. Files are checked against their checksums.

    \b
    Example:
      stlbench results merge results machine-a/results machine-b/results
    """
    counts = {source: upkeep.merge(into, source) for source in sources}
    facts = [{"from": str(source), **count._asdict()} for source, count in counts.items()]
    show(as_json, facts, _merged(into, counts))


def _merged(into: Path, counts: Mapping[Path, Merged]) -> Iterator[str]:
    for source, count in counts.items():
        planned = f", {count.planned} planned without a result" if count.planned else ""
        yield f"{source}: {count.added} new, {count.replaced} better or newer, {count.kept} left out{planned}"
        for name in count.conflicts:
            warn(f"{name} has other scores in {source}/ than in {into}/, though the keys are the same")
        for file in count.damaged:
            warn(f"{file} is not as it was recorded, and not copied")


def _count(cells: int) -> str:
    return f"{cells} {'cell' if cells == 1 else 'cells'}"
