"""`stlbench export`: results for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stlbench.cli.common import Json, print_json
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.study.results import Results

TABLES = ("cells", "robustness", "curves")
"""The tables of `Results` that are written, each to a file of its name."""


def export(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS", help="A folder that `stlbench run` wrote.")],
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
    if as_json:
        print_json([str(path) for path in paths])
    else:
        for path in paths:
            typer.echo(path)


def _write(results: Results, folder: Path, form: Literal["csv", "parquet"]) -> list[Path]:
    from stlbench.records.outputs import write

    paths = [folder / f"{name}.{form}" for name in TABLES]
    for name, path in zip(TABLES, paths, strict=True):
        table = getattr(results, name)()
        try:
            content = table.to_csv(index=False) if form == "csv" else table.to_parquet(engine="pyarrow", index=False)
        except ImportError:
            raise UsageError("Parquet needs the package pyarrow: pip install pyarrow") from None
        write(path, content)
    return paths
