"""`stlbench verify`: is a folder of results whole?"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stlbench.cli.common import Json, print_json
from stlbench.cli.verify_bundle import verify_bundle
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.records.verify import Verified


_SHOWN = 10
"""Files without a result that are listed."""


def verify(
    folder: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="A folder that `stlbench run` wrote, or a bundle (.zip).")
    ],
    repair: Annotated[
        bool, typer.Option("--repair", help="Have the next run measure again what is damaged or missing.")
    ] = False,
    rescore: Annotated[
        bool, typer.Option("--rescore", help="Of a bundle: have the referee score its policies again.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Check that a folder of results is whole: its ledger, each row, the files of traces and policies.

    Rows and files are compared with the checksums that were recorded with them. Whatever is damaged or missing is
    named, and the exit code is 1. With --repair these cells are marked, and the `stlbench run` that measured them
    measures them again; their results stay until then. A ledger of which SQLite cannot read a part is written anew, and
    the old file is kept as ledger.sqlite.damaged; the exit code is 0.

    A bundle is compared with its own list of checksums. With --rescore the referee scores the policies in it on this
    machine, and the exit code is 1 where the bundle claims more than it finds.

    \b
    Examples:
      stlbench verify results
      stlbench verify results --repair
      stlbench verify submission.zip --rescore
    """
    if folder.suffix == ".zip":
        if repair:
            raise UsageError(f"{folder} is a bundle, which is packed anew and not repaired; leave --repair out")
        verify_bundle(folder, rescore, as_json)
        return
    if rescore:
        raise UsageError("--rescore is for bundles; `stlbench score TASK CELL` scores a stored cell again")
    from stlbench.records import verify as verifying
    from stlbench.records.ledger import LedgerWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LedgerWarning)  # all of it is said below
        found = verifying.repair(folder) if repair else verifying.verify(folder)
    if as_json:
        print_json(_facts(found, repair))
    else:
        _say(found, repair, folder)
    if not (found.is_whole or repair):
        raise typer.Exit(1)


def _facts(found: Verified, repaired: bool) -> dict[str, object]:
    cells = [
        {"cell": damage.name, "key": damage.key, "what": damage.what, "problem": damage.problem}
        for damage in found.damages
    ]
    counts = {name: getattr(found, name) for name in ("rows", "files", "marked")}
    lists = {"structure": list(found.structure), "damages": cells, "strays": list(found.strays)}
    return {"whole": found.is_whole, **counts, **lists, "repaired": repaired}


def _verdict(found: Verified) -> str:
    cells = len({damage.key for damage in found.damages})
    parts = {
        f"{cells} with damage": cells,
        "its structure is damaged": found.structure and not cells,
        f"{len(found.strays)} files without a result": found.strays,
    }
    return ", ".join(said for said, is_so in parts.items() if is_so) or "whole"


def _say(found: Verified, repaired: bool, folder: Path) -> None:
    for line in found.structure:
        typer.echo(f"ledger: {line}")
    for damage in found.damages:
        typer.echo(f"{damage.name}: {damage.what}: {damage.problem}")
    for name in found.strays[:_SHOWN]:
        typer.echo(f"{name}: the ledger has no result for this file")
    if len(found.strays) > _SHOWN:
        typer.echo(f"and {len(found.strays) - _SHOWN} more files")
    typer.echo(f"{folder}/: {found.rows} rows, {found.files} files as they were recorded: {_verdict(found)}")
    if found.marked:
        cells_are = "1 cell is" if found.marked == 1 else f"{found.marked} cells are"
        typer.echo(f"{cells_are} marked, for the next `stlbench run` to measure again")
    if found.strays:
        typer.echo("files without a result: rows were lost, or a run was killed; keep them or delete them")
    if not (found.structure or found.damages):
        return
    again = "the `stlbench run` that measured them measures them again"
    typer.echo(f"repaired: {again}" if repaired else f"--repair marks the cells, and {again}")
