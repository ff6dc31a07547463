"""The files of a report."""

from __future__ import annotations

import csv

from factory import result

from stlbench.report import condense, write

RESULTS = [
    *(result(method, seed) for method in ("funnel", "flag") for seed in range(2)),
    result("mine", status="raised", reason="ValueError: no"),
]


def test_writes_all_files_and_names_them(tmp_path):
    paths = write(condense(RESULTS), tmp_path / "new" / "folder")
    assert all(path.is_file() for path in paths)
    assert [path.name for path in paths][:6] == [
        "report.md",
        "robustness.csv",
        "robustness.tex",
        "time.csv",
        "time.tex",
        "cells.csv",
    ]


def test_the_report_has_all_tables(tmp_path):
    write(condense(RESULTS), tmp_path)
    text = (tmp_path / "report.md").read_text()
    headings = [line for line in text.splitlines() if line.startswith("#")]
    assert headings == ["# stlbench report", "## Robustness", "## Wall time and cost", "## Cells without a result"]


def test_cells_csv_has_a_row_a_cell(tmp_path):
    write(condense(RESULTS), tmp_path)
    with (tmp_path / "cells.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["method"], row["seed"], row["status"]) for row in rows] == [
        ("flag", "0", "done"),
        ("flag", "1", "done"),
        ("funnel", "0", "done"),
        ("funnel", "1", "done"),
        ("mine", "0", "raised"),
    ]
    assert list(rows[0]) == [
        *("task", "method", "agent", "seed", "budget", "status", "reason", "satisfaction", "robustness_mean"),
        *("robustness_min", "final_satisfaction", "final_robustness_mean", "selected_steps", "training_cpu_seconds"),
        *("training_wall_seconds", "cpu_seconds", "wall_seconds", "env_steps", "reward_nanoseconds", "inputs_added"),
    ]


def test_the_same_results_give_the_same_files(tmp_path):
    write(condense(RESULTS), tmp_path / "a")
    write(condense(reversed(RESULTS)), tmp_path / "b")
    for name in ("report.md", "robustness.csv", "time.csv", "robustness.tex", "time.tex", "cells.csv"):
        assert (tmp_path / "a" / name).read_text() == (tmp_path / "b" / name).read_text()
