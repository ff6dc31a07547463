"""The files of a report."""

from __future__ import annotations

import csv

import pytest
from helpers.reports import write
from helpers.synthetic_results import by_hand, plan, result

from stlbench.report import condense

RESULTS = [
    *(result(method, seed) for method in ("funnel", "flag") for seed in range(2)),
    result("mine", status="raised", reason="ValueError: no"),
]
SCORES = by_hand(hold_disc=(0.4, 0.2))
pytestmark = pytest.mark.usefixtures("undrawn")


def test_it_writes_all_files_and_names_them_and_the_report_has_all_tables(tmp_path):
    """The same results give the same files, in whatever order they come."""
    folder = tmp_path / "new" / "folder"
    paths = write(condense(RESULTS), SCORES, folder)
    assert all(path.is_file() for path in paths)
    names = [f"{name}.{end}" for name in ("robustness", "comparisons", "controllers", "time") for end in ("csv", "tex")]
    assert [path.name for path in paths][:10] == ["report.md", *names, "cells.csv"]
    headings = [line for line in (folder / "report.md").read_text().splitlines() if line.startswith("#")]
    tables = ("Robustness", "Comparisons", "Controllers and baselines", "Time")
    tables += ("Cells without a result", "Circumstances")
    assert headings == ["# stlbench report", *(f"## {title}" for title in tables)]
    write(condense(reversed(RESULTS)), SCORES, tmp_path / "other")
    for path in paths[:10]:
        assert path.read_text() == (tmp_path / "other" / path.name).read_text()


def test_cells_csv_has_one_row_per_cell(tmp_path):
    write(condense(RESULTS), SCORES, tmp_path)
    with (tmp_path / "cells.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    done = [(method, seed, "done", "") for method in ("flag", "funnel") for seed in "01"]
    found = [(row["method"], row["seed"], row["status"], row["reason"]) for row in rows]
    assert found == [*done, ("mine", "0", "raised", "ValueError: no")]
    assert list(rows[0]) == [
        *("task", "method", "agent", "seed", "budget", "track", "status", "reason", "satisfaction", "robustness_mean"),
        *("robustness_min", "final_satisfaction", "final_robustness_mean", "selected_steps", "training_cpu_seconds"),
        *("training_wall_seconds", "cpu_seconds", "wall_seconds", "env_steps", "reward_nanoseconds", "inputs_added"),
        *("starts", "satisfaction 95 % interval low", "satisfaction 95 % interval high"),
        *("final_satisfaction 95 % interval low", "final_satisfaction 95 % interval high", "extension", "ended_early"),
    ]


def test_what_was_planned_has_a_table_and_a_figure_of_its_own(tmp_path):
    results = [*RESULTS, plan("flag", value=2.0), plan("flag", "best", 0.5, "formula", robustness=(0.6,))]
    paths = write(condense(results), SCORES, tmp_path)
    names = {path.name for path in paths}
    assert names >= {f"alignment.{end}" for end in ("csv", "tex", "png", "svg", "pdf")}
    with (tmp_path / "alignment.csv").open(newline="") as file:
        formula, flag = csv.DictReader(file)
    assert list(flag) == [
        *("task", "method", "setting", "best_known", "reward_optimal", "satisfied", "grid_value", "selected"),
        *("final", "seeds", "reward_loses", "learner_loses", "resolution", "disagreement", "remarks"),
    ]
    assert (formula["method"], formula["best_known"], formula["reward_optimal"]) == ("(formula)", "0.6", "")
    assert (flag["reward_optimal"], flag["selected"], flag["seeds"], flag["grid_value"]) == ("0.35", "0.35", "2", "2.0")
    assert (float(flag["reward_loses"]), float(flag["learner_loses"])) == (0.25, 0)
    assert "## Alignment" in (tmp_path / "report.md").read_text()
    with (tmp_path / "robustness.csv").open(newline="") as file:
        agents = [(row["method"], row["agent"]) for row in csv.DictReader(file)]
    assert agents == [("flag", "dqn"), ("funnel", "dqn"), ("mine", "dqn")]


def test_a_folder_of_plans_alone_has_a_report(tmp_path):
    paths = write(condense([plan(), plan("raw", status="unsuitable", reason="22 numbers")]), {}, tmp_path)
    figures = {path.name for path in paths if path.parent.name == "figures"}
    assert figures == {f"alignment.{end}" for end in ("png", "svg", "pdf")}
    headings = [line for line in (tmp_path / "report.md").read_text().splitlines() if line.startswith("#")]
    assert headings == ["# stlbench report", "## Alignment", "## Circumstances"]
