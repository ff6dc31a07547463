"""`stlbench suite`, and tasks of a suite in other commands."""

from __future__ import annotations

import json
from pathlib import Path

from typer.testing import CliRunner

from stlbench.cli import app

TASK = "suite:integrator/reach-stay/1"


def test_list() -> None:
    listed = json.loads(CliRunner().invoke(app, ["suite", "list", "suite:integrator/reach-stay", "--json"]).stdout)
    assert [row["task"] for row in listed][1] == TASK
    assert [row["splits"][0] for row in listed] == ["dev", "core", "core", "hard"]
    assert all(0 < row["best_known"] <= row["upper_bound"] for row in listed)
    text = CliRunner().invoke(app, ["suite", "list", "suite:quick"]).stdout
    assert "24 tasks" in text
    assert "tier " in text
    assert listed[1]["groups"]["template"] == "reach-stay"


def test_without_a_name_it_lists_what_there_is() -> None:
    counts = json.loads(CliRunner().invoke(app, ["suite", "list", "--json"]).stdout)
    assert {row["tasks"] for row in counts} > {"suite:dev", "suite:quick", "suite:unicycle"}
    assert next(row["count"] for row in counts if row["tasks"] == "suite:quick") == 24
    assert "suite:unicycle" in CliRunner().invoke(app, ["suite", "list"]).stdout


def test_an_unknown_part_gets_few_names_and_a_task_of_no_suite_how_they_are_named() -> None:
    nothing, alone = (CliRunner().invoke(app, ["suite", "list", name]) for name in ("suite:nothing", "reach-stay"))
    assert (nothing.exit_code, alone.exit_code) == (2, 2)
    assert nothing.stderr.startswith("error: suite suite has no 'nothing'; there are: dev, core, hard, fresh, quick, ")
    assert len(nothing.stderr) < 250
    assert "as in suite:unicycle/sequence/7" in alone.stderr


def test_draw(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["suite", "draw", TASK, "--out", str(tmp_path)])
    assert done.exit_code == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"suite-integrator-reach-stay-1.{end}" for end in ("pdf", "png", "svg")]


def test_run(tmp_path: Path) -> None:
    words = ["run", "--tasks", TASK, "--methods", "raw", "--budget", "smoke", "--jobs", "1", "--results", str(tmp_path)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "suite-integrator-reach-stay-1" in done.stdout
