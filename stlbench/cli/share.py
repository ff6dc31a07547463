"""`stlbench bundle`, `export` and `export-policy`: results and policies, given away."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stlbench.cli.options import Budget, Cell, Folder, From, TaskFolders, Which
from stlbench.cli.output import Json, show
from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.identity import safe_line
from stlbench.records.lines import write_lines
from stlbench.records.result_files import PACKED, csv_value, inside, write
from stlbench.share import onnx
from stlbench.share.bundle import About, name_for, pack
from stlbench.share.minari import export as export_episodes
from stlbench.simulation.faults import Question, plugins_of
from stlbench.study.plugin_guard import ask_one
from stlbench.study.results import Results

if TYPE_CHECKING:
    import pandas as pd


def bundle(
    folder: Folder,
    target: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="The bundle.", show_default="RESULTS.zip")
    ] = None,
    title: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Title of the results.", show_default="the folder's name")
    ] = None,
    description: Annotated[str, typer.Option(metavar="TEXT", help="A sentence about the results.")] = "",
    author: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="An author. May be given several times.")
    ] = None,
    license: Annotated[str, typer.Option(metavar="SPDX", help="Licence by which others may use them.")] = "CC-BY-4.0",
    traces: Annotated[bool, typer.Option("--traces", help="Include the recorded traces, which are large.")] = False,
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
    if not all(text.strip() for text in (*(author or ()), license)):
        raise UsageError("--author and --license need a text; leave out the option that has none")
    name = results_folder.folder_of(folder).resolve().name
    path = Path(f"{name_for(name)}.zip") if target is None else target
    what = description or f"Cells of stlbench, recorded in {name}."
    authors, date = tuple(map(safe_line, author or ())), datetime.now(UTC).date().isoformat()
    about = About(safe_line(title or name), safe_line(what), authors, safe_line(license), date)
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
    writes cells.jsonl.xz: one cell per line, nothing left out. A folder with this file in place of a ledger can be
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
        path = (out or (folder if folder.is_dir() else folder.parent)) / PACKED
        write_lines(list(results_folder.read(folder)), path, results_folder.missing(folder))
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
            content = _csv(table) if form == "csv" else table.to_parquet(engine="pyarrow", index=False)
        except ImportError:
            raise UsageError('Parquet needs the package pyarrow: pip install "stlbench-rl[parquet]"') from None
        write(path, content)
    return paths


def _csv(table: pd.DataFrame) -> str:
    texts = table.select_dtypes(exclude=["number", "bool"]).columns
    safe = table.assign(**{name: table[name].map(csv_value) for name in texts})
    return str(safe.rename(columns=csv_value).to_csv(index=False))


def export_policy(
    cell: Cell,
    out: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write; it ends in .onnx.")],
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
    loaded = Results.load(results)
    result = loaded.cell(cell, budget)
    plugins, failed = plugins_of(result.id), f"{result.id.name} cannot be exported"
    exported = ask_one(Question(onnx.export, (loaded.folder, result, which, out), plugins, failed))
    share, away = f"{100 * exported.same:.4g} %", f"{exported.largest:.2g}"
    text = [
        str(out),
        f"its observation: {exported.observation}",
        f"the same action in {share} of {exported.observations} observations; largest difference {away} of a span",
    ]
    show(as_json, {"file": str(out), **exported._asdict()}, text)
