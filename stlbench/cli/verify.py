"""`stlbench verify`: whether a folder of results, or a bundle, is whole."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from stlbench.cli.output import Json, show
from stlbench.errors import UsageError, one_line
from stlbench.records import verify as verifying
from stlbench.records.ledger import FILE
from stlbench.records.reader import LedgerWarning
from stlbench.records.result import reported
from stlbench.records.schema import way_out
from stlbench.records.verify import Verified
from stlbench.report import Column, Table, Value
from stlbench.share.checked import Checked, check
from stlbench.share.rescored import CLAIMS_MORE, Rescored
from stlbench.share.rescored import rescore as rescore_policies

_SHOWN = 10  # the most files without a result that are listed
_CANNOT_TELL = 3  # the exit code, as that of `compare`


def verify(
    folder: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="A folder that `stlbench run` wrote, or a bundle (.zip).")
    ],
    repair: Annotated[
        bool, typer.Option("--repair", help="Let the next run measure damaged or missing cells again.")
    ] = False,
    rescore: Annotated[
        bool, typer.Option("--rescore", help="Let the referee score the policies of a bundle again.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Check that a folder of results is whole: its ledger, each row, the files of traces and policies.

    Rows and files are compared with the checksums that were recorded with them. Whatever is damaged or missing is
    named, and the exit code is 1. With --repair these cells are marked, and the `stlbench run` that measured them
    measures them again; their results stay until then, and the exit code is 0. Of a ledger that SQLite cannot read it
    says the ways out: --repair does not help there.

    A bundle is compared with its own list of checksums. With --rescore the referee scores the policies in it on this
    machine. The exit code is 1 where the bundle claims more than it finds, and 3 where a policy could not be scored.

    \b
    Examples:
      stlbench verify results
      stlbench verify results --repair
      stlbench verify submission.zip --rescore
    """
    if folder.suffix == ".zip":
        if repair:
            raise UsageError(f"{folder} is a bundle, which cannot be repaired; leave --repair out, and pack it again")
        _verify_bundle(folder, rescore, as_json)
        return
    if rescore:
        raise UsageError("--rescore is for bundles; `stlbench score TASK CELL` scores a stored cell again")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LedgerWarning)  # the text below has the same
        verified = verifying.repair(folder) if repair else verifying.verify(folder)
    show(as_json, _facts(verified, repair), _text(verified, repair, folder))
    if not (verified.is_whole or repair):
        raise typer.Exit(1)


def _facts(verified: Verified, repaired: bool) -> dict[str, object]:
    cells = [
        {"cell": damage.name, "key": damage.key, "what": damage.what, "problem": damage.problem}
        for damage in verified.damages
    ]
    return {"whole": verified.is_whole, **verified._asdict(), "damages": cells, "repaired": repaired}


def _text(verified: Verified, repaired: bool, folder: Path) -> Iterator[str]:
    if verified.structure:
        first, more = one_line(verified.structure[0]), len(verified.structure) - 1
        counted = f" (and {more} more such lines)" if more else ""
        yield f"{folder / FILE} is damaged: {first}{counted}; {way_out(folder / FILE)}"
        return
    damaged, strays = len({damage.key for damage in verified.damages}), verified.strays
    yield from (f"{damage.name}: {damage.what}: {damage.problem}" for damage in verified.damages)
    yield from (f"{name}: the ledger has no result for this file" for name in strays[:_SHOWN])
    if len(strays) > _SHOWN:
        yield f"and {len(strays) - _SHOWN} more files"
    parts = [f"{damaged} with damage"] if damaged else []
    parts += [f"{len(strays)} files without a result"] if strays else []
    verdict = ", ".join(parts) or ("whole" if verified.rows else "empty")
    yield f"{folder}/: {verified.rows} rows, {verified.files} files as they were recorded: {verdict}"
    if verified.marked:
        cells_are = "1 cell is" if verified.marked == 1 else f"{verified.marked} cells are"
        yield f"{cells_are} marked, for the next `stlbench run` to measure again"
    if strays:
        yield "files without a result: rows were lost, or a run was killed; keep them or delete them"
    if verified.damages:
        again = "the `stlbench run` that measured them measures them again"
        yield f"repaired: {again}" if repaired else f"--repair marks the cells, and {again}"


def _verify_bundle(path: Path, rescore: bool, as_json: bool) -> None:
    checked = check(path)
    scored: list[Rescored] = []
    for each in rescore_policies(path) if rescore and not checked.problems else ():
        scored.append(each)
        if not as_json:  # a policy may take seconds
            why = f", {each.why}" if each.why else ""
            typer.echo(f"[{len(scored)}/{checked.policies}] {each.cell.name}: {each.verdict}{why}", err=True)
    facts = {"whole": not checked.problems, **checked._asdict(), "rescored": [_rescored(each) for each in scored]}
    unscored = _unscored(scored)
    said = [f"{unscored}: the bundle is not confirmed"] if rescore and unscored and not checked.problems else []
    show(as_json, facts, [*_bundle_text(path, checked, scored), *said])
    if checked.problems or any(each.verdict == CLAIMS_MORE for each in scored):
        raise typer.Exit(1)
    if rescore and unscored:
        raise typer.Exit(_CANNOT_TELL)


def _unscored(scored: list[Rescored]) -> str:
    """Why not every policy is confirmed; empty where all were scored."""
    count = sum(each.found is None for each in scored)
    if scored and not count:
        return ""
    return f"{count} of {len(scored)} policies could not be scored here" if scored else "no cell has a policy to score"


def _rescored(each: Rescored) -> dict[str, object]:
    sides = {"recorded": each.recorded, "found": each.found or {}}
    numbers = {
        side: {name: {"mean": score.mean, "satisfaction": score.satisfaction} for name, score in scores.items()}
        for side, scores in sides.items()
    }
    return {"cell": each.cell.name, "verdict": each.verdict, "why": each.why, **numbers}


def _bundle_text(path: Path, checked: Checked, scored: list[Rescored]) -> Iterator[str | Table]:
    yield from checked.problems
    verdict = "not what it says" if checked.problems else "every file as it was packed"
    counts = f"{checked.cells} cells, policies of {checked.policies}"
    yield f"{path}: {counts if checked.cells else 'its results were not read'}: {verdict}"
    columns: dict[Column, Callable[[Rescored], Value]] = {
        Column("cell", right=False): lambda each: each.cell.name,
        Column("recorded", digits=3): lambda each: reported(each.recorded).mean,
        Column("found", digits=3): lambda each: reported(each.found).mean if each.found else None,
        Column("satisfied, recorded", digits=3): lambda each: reported(each.recorded).satisfaction,
        Column("satisfied, found", digits=3): lambda each: reported(each.found).satisfaction if each.found else None,
        Column("verdict", right=False): lambda each: each.verdict,
    }
    note = "Robustness and satisfied are of the starts that tables report; the verdict is of all protocols."
    if scored:
        yield Table.of("Scored again", scored, columns, (note,))
