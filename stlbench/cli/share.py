"""`stlbench verify`, `bundle`, `export` and `export-policy`: results and policies, checked and given away."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

import typer

from stlbench.cli.common import Json, show
from stlbench.cli.options import Budget, Cell, Folder, From, TaskFolders, Which
from stlbench.errors import UsageError
from stlbench.records import stored
from stlbench.records import verify as verifying
from stlbench.records.outputs import inside, write
from stlbench.records.reader import LedgerWarning
from stlbench.records.result import reported
from stlbench.records.verify import Verified
from stlbench.report import Column, Table, Value
from stlbench.rollout.questions import Question, plugins_of
from stlbench.share import onnx
from stlbench.share.bundle import About, pack
from stlbench.share.checked import Checked, check
from stlbench.share.minari import export as export_episodes
from stlbench.share.rescored import Rescored
from stlbench.share.rescored import rescore as rescore_policies
from stlbench.study.plugin_guard import ask_one
from stlbench.study.results import Results

_SHOWN = 10  # the most files without a result that are listed


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
    damaged, strays = len({damage.key for damage in verified.damages}), verified.strays
    yield from (f"ledger: {line}" for line in verified.structure)
    yield from (f"{damage.name}: {damage.what}: {damage.problem}" for damage in verified.damages)
    yield from (f"{name}: the ledger has no result for this file" for name in strays[:_SHOWN])
    if len(strays) > _SHOWN:
        yield f"and {len(strays) - _SHOWN} more files"
    parts = [f"{damaged} with damage"] if damaged else ["its structure is damaged"] if verified.structure else []
    parts += [f"{len(strays)} files without a result"] if strays else []
    verdict = ", ".join(parts) or "whole"
    yield f"{folder}/: {verified.rows} rows, {verified.files} files as they were recorded: {verdict}"
    if verified.marked:
        cells_are = "1 cell is" if verified.marked == 1 else f"{verified.marked} cells are"
        yield f"{cells_are} marked, for the next `stlbench run` to measure again"
    if strays:
        yield "files without a result: rows were lost, or a run was killed; keep them or delete them"
    if verified.structure or verified.damages:
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
    show(as_json, facts, _bundle_text(path, checked, scored))
    if checked.problems or any(each.verdict == "claims more" for each in scored):
        raise typer.Exit(1)


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
    note = "Robustness and share that satisfies, of the starts that tables report; the verdict is of all protocols."
    if scored:
        yield Table.of("Scored again", scored, columns, (note,))


def bundle(
    folder: Folder,
    target: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="The bundle.", show_default="RESULTS.zip")
    ] = None,
    title: Annotated[
        str | None, typer.Option(metavar="TEXT", help="What the results are called.", show_default="the folder's name")
    ] = None,
    description: Annotated[str, typer.Option(metavar="TEXT", help="What they are of, in a sentence.")] = "",
    author: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Who made them; may be said more than once.")
    ] = None,
    license: Annotated[
        str, typer.Option(metavar="SPDX", help="Under which licence others may use them.")
    ] = "CC-BY-4.0",
    traces: Annotated[bool, typer.Option("--traces", help="Take the recorded traces along, which are large.")] = False,
    as_json: Json = False,
) -> None:
    """Pack results, tables and policies into one file with checksums, for others to check and to score again.

    The file is a zip and an RO-Crate. Unzipped, it is a folder of results: `report`, `compare`, `score` and `export`
    read it. The tables are those of the last `stlbench report`. With --author it has a citation file.

    \b
    Examples:
      stlbench bundle results --author "Ada Lovelace" --title "Funnels on reach-stay"
      stlbench bundle results submission.zip --license CC0-1.0
    """
    name = folder.resolve().name
    path = Path(f"{name}.zip") if target is None else target
    what = description or f"Cells of stlbench, recorded in {name}."
    about = About(title or name, what, tuple(author or ()), license, datetime.now(UTC).date().isoformat())
    packed = pack(folder, path, about, traces)
    counts = f"{packed.cells} cells, policies of {packed.policies}, {packed.files} files, {packed.size / 1e6:.1f} MB"
    text = [f"Written to {path}: {counts}; licence {license}"]
    text += [] if author else ["It has no citation file: name the authors with --author"]
    show(as_json, {"file": str(path), **packed._asdict()}, text)


TABLES = ("cells", "robustness", "curves")  # the tables of `Results` that are written, each to a file of its name


def export(
    folder: Folder,
    form: Annotated[
        Literal["csv", "parquet", "jsonl", "minari"],
        typer.Option(
            "--format", help="Tables as CSV or Parquet; all that is recorded, as lines of JSON; episodes for Minari."
        ),
    ] = "csv",
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the files.", show_default="RESULTS/export; for jsonl RESULTS"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write results for other programs, in full precision.

    csv and parquet write three tables: cells, robustness and curves, as `stlbench.Results` has them in Python. jsonl
    writes cells.jsonl: one cell per line, nothing left out. A folder with this file in place of a ledger can be
    reported, compared, plotted and loaded, and be kept in git. minari lets the stored policies act again, and writes
    their episodes with robustness as labels: a data set for each task and track, each with a card. It needs the extra
    `minari`. Prints the files; --json prints a list of them.

    \b
    Examples:
      stlbench export results --format csv
      stlbench export results --format minari
      stlbench export results/reference --format jsonl
    """
    if form == "jsonl":
        path = (out or (folder if folder.is_dir() else folder.parent)) / stored.LINES
        stored.write_lines(list(stored.read(folder)), path, stored.missing_by_key(folder))
        paths = [path]
    else:
        results = Results.load(folder)
        target = out or inside(results.folder / "export", results.folder)
        paths = export_episodes(results.folder, target) if form == "minari" else _write(results, target, form)
    names = list(map(str, paths))
    show(as_json, names, names)


def _write(results: Results, folder: Path, form: Literal["csv", "parquet"]) -> list[Path]:
    paths = [folder / f"{name}.{form}" for name in TABLES]
    for name, path in zip(TABLES, paths, strict=True):
        table = getattr(results, name)()
        try:
            content = table.to_csv(index=False) if form == "csv" else table.to_parquet(engine="pyarrow", index=False)
        except ImportError:
            raise UsageError('Parquet needs the package pyarrow: pip install "stlbench-rl[parquet]"') from None
        write(path, content)
    return paths


def export_policy(
    cell: Cell,
    out: Annotated[Path, typer.Argument(metavar="FILE", help="What is written; its ending is .onnx.")],
    results: From = Path("results"),
    budget: Budget = None,
    which: Which = "selected",
    task_folders: TaskFolders = None,
    as_json: Json = False,
) -> None:
    """Write a stored policy as an ONNX file, and compare the two.

    The file has one input, 'observation', and the output 'action' in the task's units. It is run by onnxruntime on all
    observations of the report's episodes; the share of equal actions is printed. Needs the extra onnx.

    \b
    Example:
      stlbench export-policy reach-stay/funnel/dqn/0 policy.onnx
    """
    if out.suffix.lower() != ".onnx":
        raise UsageError(f"{out}: a policy is written as .onnx")
    result = Results.load(results).cell(cell, budget)
    plugins, failed = plugins_of(result.id), f"{result.id.name} cannot be exported"
    exported = ask_one(Question(onnx.export, (results, result, which, out), plugins, failed))
    share, away = f"{100 * exported.same:.4g} %", f"{exported.largest:.2g}"
    text = [
        str(out),
        f"its observation: {exported.observation}",
        f"the same action in {share} of {exported.observations} observations; largest difference {away} of a span",
    ]
    show(as_json, {"file": str(out), **exported._asdict()}, text)
