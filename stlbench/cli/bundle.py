"""`stlbench bundle`: results as one file for others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stlbench.cli.common import Json, show


def bundle(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS", help="A folder that `stlbench run` wrote.")],
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
      stlbench bundle results --author "Ada Lovelace" --title "Funnels on hold-disc"
      stlbench bundle results submission.zip --license CC0-1.0
    """
    from datetime import UTC, datetime

    from stlbench.share.bundle import About, pack

    name = folder.resolve().name
    path = Path(f"{name}.zip") if target is None else target
    what = description or f"Cells of stlbench, recorded in {name}."
    about = About(title or name, what, tuple(author or ()), license, datetime.now(UTC).date().isoformat())
    packed = pack(folder, path, about, traces)
    counts = f"{packed.cells} cells, policies of {packed.policies}, {packed.files} files, {packed.size / 1e6:.1f} MB"
    text = [f"Written to {path}: {counts}; licence {license}"]
    text += [] if author else ["It has no citation file: name the authors with --author"]
    show(as_json, {"file": str(path), **packed._asdict()}, text)
