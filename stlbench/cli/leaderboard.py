"""`stlbench leaderboard`: submitted bundles in a table, their policies scored on fresh starts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stlbench.cli.common import Json, console, print_json

if TYPE_CHECKING:
    from stlbench.leaderboard.entry import Scores


def leaderboard(
    bundles: Annotated[
        list[Path], typer.Argument(metavar="BUNDLE...", help="Files that `stlbench bundle` wrote, or folders of them.")
    ],
    output: Annotated[Path, typer.Option(metavar="DIR", help="Where the leaderboard goes.")] = Path("leaderboard"),
    draw: Annotated[
        int | None,
        typer.Option(min=0, max=2**31 - 1, metavar="N", help="Seed of the fresh starts.", show_default="at random"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Put bundles into one table: their policies are scored on fresh starts, whatever they claim.

    Each bundle is checked as by `stlbench verify`, and held against the rules: named authors, seeds 10, 11, ... without
    a gap and at least five, no budget for tests, a stored policy of each cell. Then the referee scores its selected
    policies from the starts of its claim, and from random ones that are drawn now, the same for all bundles. Nothing in
    a bundle is run.

    Writes scores.json, table.md and table.csv to DIR. Exit code 1 where a bundle is refused, or claims more than is
    found.

    \b
    Examples:
      stlbench leaderboard mine.zip theirs.zip
      stlbench leaderboard mine.zip --draw 123 --json
    """
    from stlbench.leaderboard.board import build

    def told(name: str, said: str) -> None:
        if not as_json:
            typer.echo(f"{name}: {said}", err=True)

    scores = build(bundles, output, draw, told)
    if as_json:
        print_json(_facts(scores))
    else:
        _say(scores, output)
    if not scores.is_fine:
        raise typer.Exit(1)


def _say(scores: Scores, output: Path) -> None:
    from stlbench.leaderboard.tables import bundles, results
    from stlbench.report import to_screen

    for table in (results(scores), bundles(scores)):
        to_screen(table, console())
    for entry in scores.entries:
        if entry.claims_more:
            typer.echo(f"{entry.bundle} claims more than the referee finds")
    counts = f"{len(scores.entries)} bundles, {len(scores.refused)} refused"
    typer.echo(f"Written to {output}/: scores.json, table.md, table.csv; {counts}")


def _facts(scores: Scores) -> dict[str, object]:
    from stlbench.leaderboard.tables import bundles, results
    from stlbench.report import to_records

    tables = {"results": to_records(results(scores)), "bundles": to_records(bundles(scores))}
    refused = [{"bundle": each.bundle, "problems": list(each.problems)} for each in scores.refused]
    return {"fine": scores.is_fine, "draw": scores.draw, **tables, "refused": refused}
