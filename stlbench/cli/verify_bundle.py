"""`stlbench verify` of a bundle: is it what it says, and what does the referee say of its policies?"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from stlbench.cli.common import console, print_json

if TYPE_CHECKING:
    from stlbench.report import Table, Value
    from stlbench.share.checked import Checked
    from stlbench.share.rescored import Rescored


def verify_bundle(path: Path, rescore: bool, as_json: bool) -> None:
    """Print what was found; exit code 1 where anything is not as the bundle says."""
    from stlbench.share.checked import check
    from stlbench.share.rescored import rescore as score

    found = check(path)
    scored = list(_shown(score(path), found.policies, as_json)) if rescore and not found.problems else []
    if as_json:
        print_json({"whole": not found.problems, **found._asdict(), "rescored": [_facts(each) for each in scored]})
    else:
        _say(path, found, scored)
    if found.problems or any(each.verdict == "claims more" for each in scored):
        raise typer.Exit(1)


def _shown(scored: Iterable[Rescored], count: int, quiet: bool) -> Iterable[Rescored]:
    """Each as it comes, as a policy may take seconds."""
    for number, each in enumerate(scored, 1):
        if not quiet:
            why = f", {each.why}" if each.why else ""
            typer.echo(f"[{number}/{count}] {each.cell.name}: {each.verdict}{why}", err=True)
        yield each


def _say(path: Path, found: Checked, scored: list[Rescored]) -> None:
    from stlbench.report import to_screen

    for problem in found.problems:
        typer.echo(problem)
    verdict = "not what it says" if found.problems else "every file as it was packed"
    counts = f"{found.cells} cells, policies of {found.policies}" if found.cells else "its results were not read"
    typer.echo(f"{path}: {counts}: {verdict}")
    if scored:
        to_screen(_table(scored), console())


def _table(scored: list[Rescored]) -> Table:
    from stlbench.report import Column, Table

    columns = (
        Column("cell", right=False),
        Column("recorded", digits=3),
        Column("found", digits=3),
        Column("satisfied, recorded", digits=3),
        Column("found", digits=3),
        Column("verdict", right=False),
    )
    note = "Robustness and share that satisfies, of the starts that tables report; the verdict is of all protocols."
    return Table("Scored again", columns, tuple(map(_row, scored)), (note,))


def _row(each: Rescored) -> tuple[Value, ...]:
    from stlbench.records.result import reported

    said = reported(each.recorded)
    found = None if each.found is None else reported(each.found)
    mean, satisfied = (None, None) if found is None else (found.mean, found.satisfaction)
    return (each.cell.name, said.mean, mean, said.satisfaction, satisfied, each.verdict)


def _facts(each: Rescored) -> dict[str, object]:
    sides = {"recorded": each.recorded, "found": each.found or {}}
    numbers = {
        side: {name: {"mean": score.mean, "satisfaction": score.satisfaction} for name, score in scores.items()}
        for side, scores in sides.items()
    }
    return {"cell": each.cell.name, "verdict": each.verdict, "why": each.why, **numbers}
