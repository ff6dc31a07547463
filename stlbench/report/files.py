"""A report as files: all tables as Markdown, CSV and LaTeX, and figures."""

from pathlib import Path

from stlbench.records import result_files
from stlbench.report import ACROSS, Report
from stlbench.report.figures.files import write_figures
from stlbench.report.figures.regions import Load
from stlbench.report.tables.table import Width, to_csv, to_latex, to_markdown


def write(report: Report, folder: Path, load: Load, width: Width = "page") -> list[Path]:
    """Write every table into `folder`, and every figure that has changed; the paths of all files.

    report.md has all tables and the circumstances. Each table has a .csv and a .tex, cells a .csv alone. There are no
    files of the overview of one task, of aggregates below three, of groups without drawn tasks, and of alignment
    without a plan. figures/ has a few figures of each task. Figures and LaTeX fit the `width`. `load` loads a task, for
    the units of its axes. Raises `UsageError` if the folder cannot be written, or a file or folder in it is a link.
    """
    figures = result_files.inside(folder / "figures", folder)
    text = "\n".join(map(to_markdown, (*report.summary, report.circumstances)))
    files = {"report.md": f"# stlbench report\n\n{text}"}
    for name, table in report.tables.items():
        if table.rows or name not in ("overview", *ACROSS, "alignment"):
            files[f"{name}.csv"] = to_csv(table)
            if name != "cells":
                files[f"{name}.tex"] = to_latex(table, width)
    texts = [result_files.write(folder / name, text) for name, text in files.items()]
    return [*texts, *write_figures(report, figures, load, width)]
