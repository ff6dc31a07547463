"""Reports in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from stlbench import report
from stlbench.report import Group, Report, Table, Width
from stlbench.rollout.standards import Standard
from stlbench.study.plugin_guard import load_guarded


def summary(
    groups: Sequence[Group], standards: Mapping[str, Standard], recorded: Sequence[Group] | None = None
) -> tuple[Table, ...]:
    return Report(groups, standards, recorded).summary


def write(
    groups: Sequence[Group], standards: Mapping[str, Standard], folder: Path, width: Width = "page"
) -> list[Path]:
    return report.write(Report(groups, standards), folder, load_guarded, width)
