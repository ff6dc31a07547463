"""`stlbench results` and `stlbench verify`: take cells out of a folder of results, put folders together, and say
whether one, or a bundle, is whole.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from stlbench.cli.common import CANNOT_TELL, warn
from stlbench.cli.options import Folder
from stlbench.cli.output import Json, show
from stlbench.errors import UsageError, counted, one_line
from stlbench.records import upkeep
from stlbench.records.ledger import LEDGER
from stlbench.records.result import reported
from stlbench.records.result_files import LINES
from stlbench.records.results_folder import locate
from stlbench.records.rows import LedgerWarning
from stlbench.records.schema import way_out
from stlbench.records.upkeep import Merged, Verified
from stlbench.report.tables.table import Column, Table, Value
from stlbench.share.bundle import Checked, check
from stlbench.share.rescored import CLAIMS_MORE, Rescored
from stlbench.share.rescored import rescore as rescore_policies

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
        list[str] | None,
        typer.Option(metavar="STATUS", help="Only cells that ended so, or 'not run'. May be given several times."),
    ] = None,
    budget: Annotated[str | None, typer.Option(metavar="NAME", help="Only cells of this budget.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    as_json: Json = False,
) -> None:
    """Remove cells from the ledger, with their traces, policies and logs: `stlbench run` measures them again.

    At least one of CELL, --status and --budget is needed; a cell is removed if all that are given fit. Prints the
    cells, and asks before it removes them. Where other seeds of a cell stay, tables count it as not run; a setting that
    was planned and has no result can be removed too. --json prints a list of them and needs --yes.

    \b
    Examples:
      stlbench results remove results reach-stay/funnel/dqn/0
      stlbench results remove results "reach-stay/*" --status raised --status timeout --yes
    """
    chosen = upkeep.choose(folder, cells, status, budget)
    if as_json and not yes:
        raise UsageError("--json cannot ask for a yes; add --yes")
    if not as_json:
        for cell, how in chosen.items():
            typer.echo(f"{cell.name} {cell.budget} {how}")
        if not yes:
            typer.confirm(f"Remove {counted(len(chosen), 'cell')} from {folder}/?", abort=True, err=True)
    upkeep.remove(folder, chosen)
    facts = [{"cell": cell.name, "budget": cell.budget, "status": how} for cell, how in chosen.items()]
    removed = f"Removed {counted(len(chosen), 'cell')} from {folder}/"
    show(as_json, facts, [f"{removed}; the tables there change with `stlbench report`"])


@app.command("merge")
def merge(
    into: Annotated[Path, typer.Argument(metavar="INTO", help="Folder of results that takes the cells.")],
    sources: Annotated[
        list[Path], typer.Argument(metavar="FROM...", help="Folders of results; they stay as they are.")
    ],
    as_json: Json = False,
) -> None:
    """Copy the cells of other folders of results, with their traces and policies.

    Of a cell that several folders have, a result that is no failure stays, then one whose key INTO has planned, then
    one whose files are whole, then the one that was measured last. Cells that were planned and have no result are
    planned in INTO too. Files are checked against their checksums.

    \b
    Example:
      stlbench results merge results machine-a/results machine-b/results
    """
    for source in sources:  # before any of them is merged
        upkeep.refuse_merging(into, source)
    counts = [(source, upkeep.merge(into, source)) for source in sources]
    facts = [{"from": str(source), **count._asdict()} for source, count in counts]
    show(as_json, facts, _merged(into, counts))


def _merged(into: Path, counts: Sequence[tuple[Path, Merged]]) -> Iterator[str]:
    for source, count in counts:
        planned = f", {count.planned} planned without a result" if count.planned else ""
        yield f"{source}: {count.added} new, {count.replaced} better or newer, {count.kept} left out{planned}"
        for name in count.conflicts:
            warn(f"{name} has other scores in {source}/ than in {into}/, though the keys are the same")
        if count.other_code:
            of = f"the keys of {counted(count.other_code, 'cell')} in {source}/ and {into}/ differ"
            warn(f"{of}, as after a change of code; a result that {into}/ has planned stays, else the later one")
        for file in count.damaged:
            warn(f"{file} is not as it was recorded, and not copied")


_SHOWN = 10  # the most files without a result that are listed


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
    measures them again; their results stay until then, and the exit code is 0. Lines of cells.jsonl that cannot be read
    are written anew from the ledger. Of a ledger that SQLite cannot read it says the ways out: --repair does not help
    there.

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
        verified = upkeep.repair(folder) if repair else upkeep.verify(folder)
    show(as_json, _facts(verified, repair), _text(verified, repair, folder))
    if not (verified.is_whole or repair):
        raise typer.Exit(1)


def _facts(verified: Verified, repaired: bool) -> dict[str, object]:
    cells = [
        {"cell": damage.name, "key": one_line(damage.key), "what": damage.what, "problem": damage.problem}
        for damage in verified.damages
    ]
    return {"whole": verified.is_whole, **verified._asdict(), "damages": cells, "repaired": repaired}


def _text(verified: Verified, repaired: bool, folder: Path) -> Iterator[str]:
    if verified.structure:
        first, more = one_line(verified.structure[0]), len(verified.structure) - 1
        others = f" (and {more} more such lines)" if more else ""
        file = folder if folder.is_file() else folder / LEDGER
        yield f"{file} is damaged: {first}{others}; {way_out(file)}"
        return
    damaged, strays = len({damage.key for damage in verified.damages}), verified.strays
    yield from [verified.lines] if verified.lines else []
    yield from (f"{damage.name}: {damage.what}: {damage.problem}" for damage in verified.damages)
    yield from (f"{name}: the ledger has no result for this file" for name in strays[:_SHOWN])
    if len(strays) > _SHOWN:
        yield f"and {len(strays) - _SHOWN} more files"
    parts = [f"{damaged} with damage"] if damaged else []
    parts += [f"{counted(len(strays), 'file')} without a result"] if strays else []
    parts += [f"{LINES} is damaged"] if verified.lines else []
    verdict = ", ".join(parts) or ("whole" if verified.rows else "empty")
    where = folder if folder.is_file() else f"{folder}/"
    yield f"{where}: {counted(verified.rows, 'row')}, {verified.files} files as they were recorded: {verdict}"
    if verified.marked:
        are = "is" if verified.marked == 1 else "are"
        yield f"{counted(verified.marked, 'cell')} {are} marked, for the next `stlbench run` to measure again"
    if strays:
        yield "files without a result: rows were lost, or a run was killed; keep them or delete them"
    if verified.lines:
        yield f"--repair writes {LINES} anew from a ledger of which no row is damaged"
    if verified.damages and locate(folder) == folder / LEDGER:
        again = "the `stlbench run` that measured them measures them again"
        yield f"repaired: {again}" if repaired else f"--repair marks the cells, and {again}"


def _verify_bundle(path: Path, rescore: bool, as_json: bool) -> None:
    checked = check(path)
    scored: list[Rescored] = []
    for each in rescore_policies(path) if rescore and not checked.problems else ():
        scored.append(each)
        if not as_json:  # a policy may take seconds
            typer.echo(f"[{len(scored)}/{each.of}] {each.cell.name}: {each.told}", err=True)
    facts = {"whole": not checked.problems, **checked._asdict(), "rescored": [_rescored(each) for each in scored]}
    unscored = _unscored(scored)
    said = [f"{unscored}: the bundle is not confirmed"] if rescore and unscored and not checked.problems else []
    show(as_json, facts, [*_bundle_text(path, checked, scored), *said])
    if checked.problems or any(each.verdict == CLAIMS_MORE for each in scored):
        raise typer.Exit(1)
    if rescore and unscored:
        raise typer.Exit(CANNOT_TELL)


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
