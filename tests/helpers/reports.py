"""Reports in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from stlbench.report import Report, files
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Table, Width
from stlbench.study.plugin_guard import load_guarded
from stlbench.tracks.references import References


def summary(
    groups: Sequence[Group], references: Mapping[str, References], recorded: Sequence[Group] | None = None
) -> tuple[Table, ...]:
    return Report(groups, references, recorded).summary


def write(
    groups: Sequence[Group], references: Mapping[str, References], folder: Path, width: Width = "page"
) -> list[Path]:
    return files.write(Report(groups, references), folder, load_guarded, width)
