"""`stlbench report`: the tables and figures of a folder of results, from its ledger."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import LEDGER, Json, console, print_json
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.report import Group


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that `stlbench run` wrote.")],
    as_json: Json = False,
) -> None:
    """Rebuild the tables and figures from a ledger.

    Covers all cells that are recorded in DIR, prints the tables and rewrites the files. --json prints an object with
    the lists robustness, time and cells.

    \b
    Examples:
      stlbench report results
      stlbench report results --json
    """
    from stlbench.ledger import Ledger
    from stlbench.report import condense, write

    with Ledger(folder / LEDGER, create=False) as ledger:
        groups = condense(ledger.results())
    if not groups:
        raise UsageError(f"{folder / LEDGER} holds no result yet")
    if as_json:
        write(groups, folder)
        print_json(_content(groups))
    else:
        show_report(groups, folder)


def show_report(groups: Sequence[Group], folder: Path) -> None:
    """Print the tables, write all files, and say where they lie."""
    from stlbench.report import summary, to_screen, write

    out = console()
    for table in summary(groups):
        to_screen(table, out)
    write(groups, folder)
    typer.echo(f"Written to {folder}/: report.md, robustness and time (.csv, .tex), cells.csv, figures/")


def _content(groups: Sequence[Group]) -> dict[str, Any]:
    from stlbench.report import cells, cost, robustness, to_records

    return {
        "robustness": to_records(robustness(groups)),
        "time": to_records(cost(groups)),
        "cells": to_records(cells(row for group in groups for row in group.rows)),
    }
