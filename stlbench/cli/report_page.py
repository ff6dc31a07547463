"""`stlbench report --html`: the page of a folder of results."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from stlbench.cli.common import print_json
from stlbench.cli.report import standards_of
from stlbench.errors import UsageError
from stlbench.records.status import NOT_RUN


def report_page(folder: Path, out: Path | None, as_json: bool) -> None:
    """Write the page, with a bar on stderr where that is a terminal, and say where it is."""
    from stlbench.records import stored
    from stlbench.report import condense
    from stlbench.report.page.build import write_page
    from stlbench.report.page.bundle import require

    require()
    groups = condense(stored.read(folder), stored.missing(folder))
    if not any(row.status != NOT_RUN for group in groups for row in group.rows):
        raise UsageError(f"{stored.locate(folder)} holds no result yet")
    console = Console(stderr=True, highlight=False)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    bars = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    known = standards_of(groups)
    with bars as bar, stored.OneByOne(folder) as results:
        stage = bar.add_task("traces of the methods", total=None)
        path = write_page(
            groups,
            results,
            known,
            folder if folder.is_dir() else folder.parent,
            lambda done, total: bar.update(stage, completed=done, total=total),
            out,
        )
    size = path.stat().st_size
    if as_json:
        print_json({"path": str(path), "bytes": size})
    else:
        typer.echo(f"{path}: {size / 1e6:.1f} MB, {len(results)} cells")
