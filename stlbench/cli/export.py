"""`stlbench export` and `stlbench export-policy`: results and policies for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stlbench.cli.common import Json, show
from stlbench.cli.options import Budget, Cell, Folder, TaskFolders, Which
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.study.results import Results

TABLES = ("cells", "robustness", "curves")  # the tables of `Results` that are written, each to a file of its name


def export(
    folder: Folder,
    form: Annotated[
        Literal["csv", "parquet", "jsonl"],
        typer.Option("--format", help="Tables as CSV or Parquet, or all that is recorded, as lines of JSON."),
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
    reported, compared, plotted and loaded, and be kept in git. Prints the files; --json prints a list of them.

    \b
    Examples:
      stlbench export results --format csv
      stlbench export results/reference --format jsonl
    """
    from stlbench.records import stored
    from stlbench.records.outputs import inside
    from stlbench.study.results import Results

    if form == "jsonl":
        path = (out or (folder if folder.is_dir() else folder.parent)) / stored.LINES
        stored.write_lines(list(stored.read(folder)), path, stored.missing_by_key(folder))
        paths = [path]
    else:
        results = Results.load(folder)
        paths = _write(results, out or inside(results.folder / "export", results.folder), form)
    names = list(map(str, paths))
    show(as_json, names, names)


def _write(results: Results, folder: Path, form: Literal["csv", "parquet"]) -> list[Path]:
    from stlbench.records.outputs import write

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
    results: Annotated[Path, typer.Option(metavar="DIR", help="Folder of results that has the cell.")] = Path(
        "results"
    ),
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
    from stlbench.rollout.questions import Question, plugins_of
    from stlbench.share import onnx
    from stlbench.study.plugin_guard import ask_one
    from stlbench.study.results import Results

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
