"""`stlbench run` and `stlbench report`, on made-up plugins, from the words to the files."""

from __future__ import annotations

import csv
import importlib
import json
import lzma
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from cli.conftest import TOY
from helpers.imports import HEAVY, imported
from helpers.refusals import refused
from helpers.synthetic_results import result

from stlbench.records.ledger import LEDGER, Ledger
from stlbench.registry import plugins
from stlbench.study.study import Study


@pytest.fixture
def run(say, toy):
    """Say `run` with these methods, and further words."""
    return lambda methods, *words: say(*TOY, "--methods", methods, *words)


def cells():
    with Path("results/cells.csv").open(newline="") as file:
        return [(row["method"], row["seed"], row["status"]) for row in csv.DictReader(file)]


def test_runs_every_cell_prints_what_was_learned_and_says_how_each_cell_ended(run, say):
    done = run("toy-raw,toy-large,toy-raw[weight=2]")
    assert done.exit_code == 0
    shown = [line.split() for line in done.stdout.splitlines()]
    assert done.stdout.startswith("Results: task toy-line, agent toy-agent, budget quick, track shared\n")
    assert [line[:4] for line in shown if line[1:3] == ["2", "of"]] == [
        [method, "2", "of", "2"] for method in ("toy-raw", "toy-raw[weight=2]")
    ]
    assert any("toy-raw" in line and "toy-raw[weight=2]" in line for line in done.stdout.splitlines()[-3:])
    assert len(shown) < 15
    explained = say("report", "results", "--explain").stdout
    for title in ("Robustness", "Time", "Comparisons"):
        assert f"{title}: task toy-line, agent toy-agent, budget quick" in explained
    large, *others = ("toy-large", "intractable"), ("toy-raw", "done"), ("toy-raw[weight=2]", "done")
    assert cells() == [(method, seed, status) for method, status in (large, *others) for seed in "01"]
    lines = done.stderr.splitlines()
    assert (lines[0], len(lines)) == ("6 cells", 7)
    assert lines[1].startswith("[1/6] toy-line/toy-raw/toy-agent/0 done: robustness 1.")
    assert lines[2] == "[2/6] toy-line/toy-large/toy-agent/0 intractable: needs 6003 inputs, limit 512"


def test_the_same_words_run_nothing_and_files_have_more_cells_than_the_screen(run, say, monkeypatch):
    first = run("toy-raw")
    shown = run("toy-large").stdout
    assert "toy-raw" not in shown
    assert {method for method, _, _ in cells()} == {"toy-large", "toy-raw"}
    report = Path("results/report.md").read_text()
    assert "| toy-raw" in report
    assert say("report", "results").exit_code == 0
    assert Path("results/report.md").read_text() == report
    monkeypatch.setattr("stlbench.study.trial.run_cell", lambda *_: pytest.fail("ran a cell again"))
    again = run("toy-raw")
    assert (again.exit_code, again.stderr) == (0, "2 cells, 2 of them done before\n")
    assert again.stdout == first.stdout


@pytest.mark.slow
def test_what_is_done_already_is_reported_without_the_heavy_packages(tmp_path):
    """The first report draws, the second finds the figures as they are."""
    study = Study.of({"tasks": "hold-disc", "methods": "funnel,flag", "seeds": "1", "results": tmp_path})
    with Ledger(tmp_path / LEDGER) as ledger:
        for cell in study.cells():
            ledger.record(replace(result(cell.id.method.name), key=cell.key))
    words = ("run", "--tasks", "hold-disc", "--methods", "funnel,flag", "--seeds", "1", "--results", tmp_path)
    assert "matplotlib" in imported(words, folder=tmp_path)
    packages = imported(words, folder=tmp_path)
    assert "numpy" in packages
    assert not (HEAVY - {"scipy"}) & packages  # intervals need SciPy


def test_an_accident_is_a_row_and_exit_code_1_and_runs_again_where_that_is_asked_for(run, monkeypatch):
    done = run("toy-wrong,toy-raw")
    assert done.exit_code == 1
    assert "Cells without a result" in done.stdout
    assert "ValueError: no [such] luck" in done.stdout
    assert cells() == [*(("toy-raw", seed, "done") for seed in "01"), *(("toy-wrong", seed, "raised") for seed in "01")]
    assert run("toy-wrong,toy-raw").stderr == "4 cells, 4 of them done before\n"
    module = importlib.import_module("toy_plugins.methods")
    monkeypatch.setattr(module.Wrong, "along", module.Raw.along)
    done = run("toy-wrong,toy-raw", "--retry", "failed", "--seeds", "0-2")
    assert done.exit_code == 0
    assert done.stderr.splitlines()[0] == "6 cells, 2 of them done before"
    assert {status for _, _, status in cells()} == {"done"}


def test_ctrl_c_keeps_what_is_done_says_what_is_missing_and_the_next_run_goes_on(run, say, monkeypatch):
    run("toy-raw", "--results", "warm-up")
    # A cell trains twice, as there is a warm-up before the clock.
    monkeypatch.setattr(importlib.import_module("toy_plugins.agents"), "interrupt_after", 6)
    done = run("toy-raw", "--seeds", "5")
    assert done.exit_code == 130
    message = "interrupted: 3 of 5 cells are recorded in results/; run the same command again to continue"
    assert done.stderr.splitlines()[-1] == message
    shown = say("report", "results").stdout
    assert "toy-raw  3 of 3, 2 not run" in shown
    assert cells() == [*(("toy-raw", seed, "done") for seed in "012"), *(("toy-raw", seed, "not run") for seed in "34")]
    monkeypatch.setattr(importlib.import_module("toy_plugins.agents"), "interrupt_after", None)
    assert run("toy-raw", "--seeds", "5").stderr.splitlines()[0] == "5 cells, 3 of them done before"
    assert len(cells()) == 5


def test_report_as_json(run, say):
    run("toy-raw,toy-large")
    found = json.loads(say("report", "results", "--json").stdout)
    pairs = {"comparisons", "differences", "improvement"}
    rest = {"overview", "robustness", "aggregates", "groups", "controllers", "alignment", "time", "cells"}
    assert set(found) == pairs | rest
    assert [name for name, rows in found.items() if rows] == ["robustness", "controllers", "time", "cells"]
    large, raw = found["robustness"]
    assert (large["mean robustness"], large["remarks"]) == (None, "intractable: needs 6003 inputs, limit 512")
    assert (raw["satisfied [%]"], raw["seeds done"]) == (100.0, 2)
    assert raw["mean robustness"] == raw["end"]


def test_the_controller_is_scored_once_however_many_cells_there_are(run, say, down):
    """From the starts of the report, on which the policy that stands still also gets 1 - x_0."""
    done = run("toy-raw,toy-raw[weight=2],toy-large", "--seeds", "3")
    assert done.exit_code == 0
    assert down == [0, 0, 1, 2, 3]
    report = json.loads(say("report", "results", "--json").stdout)
    (row,), shown = report["controllers"], report["robustness"][1]
    for key in ("mean robustness", "worst start", "satisfied [%]"):
        assert row[key] == shown[key]
    assert row["at random"] < row["mean robustness"] == row["zero action"] <= row["best constant action"]
    assert row["trivial"] == "trivial"
    assert Path("results/controllers.csv").read_text().splitlines()[1].startswith("toy-line,")
    assert "## Controllers and baselines" in Path("results/report.md").read_text()


def test_a_ledger_whose_tasks_are_unknown_is_reported_without_controllers(run, say, down, monkeypatch):
    run("toy-raw")
    monkeypatch.setattr(plugins, "available", lambda kind: {})
    done = say("report", "results")
    assert (done.exit_code, done.stderr.count("\n")) == (0, 1)
    assert done.stderr.startswith("warning: not installed: toy-line; what needs the task is left out.")
    assert "Results: task toy-line" in done.stdout
    assert "Controllers and baselines" not in say("report", "results", "--explain").stdout
    assert "Controllers and baselines" not in Path("results/report.md").read_text()


def test_a_folder_that_cannot_be_written_is_reported_on_the_screen(run, say):
    run("toy-raw")
    Path("results/report.md").unlink()
    Path("results/report.md").mkdir()
    done = say("report", "results")
    assert done.exit_code == 0
    assert done.stderr.startswith("warning: cannot write results/report.md: ")
    assert "toy-raw" in done.stdout
    assert "Written to" not in done.stdout
    assert json.loads(say("report", "results", "--json").stdout)["cells"]


def test_bad_input_exits_2_with_one_line(run, say):
    with Ledger(Path("empty") / LEDGER) as ledger:
        ledger.plan({})
    assert say("report", "empty").stderr == "error: empty/ledger.sqlite holds no result yet\n"
    shutil.rmtree("empty")
    Path("file").write_text("")
    for words, message in (
        (["--methods", "toy-rwa"], "no method 'toy-rwa'; did you mean 'toy-raw'?"),
        (["--methods", "toy-raw[wieght=2]"], "toy-raw[wieght=2]: no parameter 'wieght'; did you mean 'weight'?"),
        (["--methods", "./toy-raw"], "methods: './toy-raw': a name consists of a-z, 0-9 and -, as in funnel"),
        (["--tasks", "toy-line[without=hold]"], "toy-line[without=hold]: the task is without hold as it is"),
        (["--seeds", "0"], "seeds: '0': at least one seed"),
        (["--results", "file"], "cannot write results in file: "),
    ):
        assert message in refused(run("toy-raw", *words))
        assert [path.name for path in Path().iterdir()] == ["file"]  # neither a ledger nor a folder


def test_a_reader_that_goes_away_gets_no_traceback_and_the_files_are_written(tmp_path):
    """As with `stlbench report results | head -1`."""
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        ledger.record(result(task="not-installed", status="raised"))  # which needs no figure
    read, write = os.pipe()
    os.close(read)
    program = "import sys; from stlbench.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "report", str(tmp_path)]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (done.returncode, done.stderr.count("\n")) == (141, 1)  # that the task is not installed
    assert {"report.md", "cells.csv", "robustness.tex"} <= {path.name for path in tmp_path.iterdir()}


def test_a_task_that_is_a_folder_is_run_and_found_again_by_its_results(say, toy, monkeypatch):
    folder = toy / "elsewhere" / "zz-line"
    shutil.copytree(toy / "toy_plugins" / "line", folder)
    with (folder / "system.py").open("a") as file:
        file.write("    def controller(self, state, t): return 0 * state - 1\n")
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    words = ("--methods", "toy-raw", "--executor", "toy-here")
    done = say("run", "--tasks", folder, *words)
    assert done.exit_code == 0, done.stderr
    assert "zz-line/toy-raw/toy-agent/0 done" in done.stderr
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    assert "Controllers and baselines" not in say("report", "results", "--explain").stdout
    explained = say("report", "results", "--explain", "--task-folder", folder).stdout
    assert "Controllers and baselines: task zz-line" in explained
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    assert say("export", "results", "--format", "jsonl", "--out", "lines").exit_code == 0
    assert str(folder) not in lzma.decompress(Path("lines/cells.jsonl.xz").read_bytes()).decode()
    moved = folder.parent / "other" / "zz-line"
    moved.parent.mkdir()
    folder.rename(moved)
    assert say("run", "--tasks", moved, *words).stderr == "2 cells, 2 of them done before\n"


def test_a_dry_run_says_what_would_run_and_writes_nothing(run, say):
    assert run("toy-raw", "--dry-run").stdout == "2 of 2 cells would run, 1 at a time; nobody knows for how long\n"
    assert not Path("results").exists()
    run("toy-raw")
    before = {path: path.stat().st_mtime_ns for path in Path("results").rglob("*")}
    assert run("toy-raw", "--dry-run").stdout == "nothing would run: all 2 cells have a result\n"
    more = run("toy-raw", "--seeds", "6", "--dry-run").stdout
    assert re.fullmatch(r"4 of 6 cells would run, 1 at a time, for about .+\n", more)
    assert {path: path.stat().st_mtime_ns for path in Path("results").rglob("*")} == before


def test_a_dry_run_refuses_a_log_as_the_run_does(run):
    for words in ((), ("--dry-run",)):
        done = run("toy-raw", "--log", "nope", *words)
        assert (done.exit_code, "no log 'nope'" in done.stderr) == (2, True)


def test_a_dry_run_refuses_a_parameter_as_the_run_does(run):
    for words in ((), ("--dry-run",)):
        assert "weight should be a number, got 'x'" in refused(run("toy-raw[weight=x]", *words))


@pytest.mark.parametrize(
    ("words", "said"),
    [(("--executor", "local", "--memory", "4X"), "got '4X'"), (("--executor", "nope"), "no executor 'nope'")],
)
def test_a_dry_run_refuses_an_executor_as_the_run_does_even_where_all_is_done(run, words, said):
    run("toy-raw")
    for more in ((), ("--dry-run",)):
        assert said in refused(run("toy-raw", *words, *more))


def test_a_dry_run_expects_no_time_from_another_budget(run):
    with Ledger(Path("results") / LEDGER) as ledger:
        ledger.record(result(budget="smoke"))
    assert run("toy-raw", "--dry-run").stdout.endswith("; nobody knows for how long\n")


def test_a_dry_run_knows_which_cells_a_run_gives_up(run):
    words = "toy-wrong", "--retry", "failed", "--attempts", "2"
    for left in ("2 of 2 cells would run", "2 of 2 cells would run", "nothing would run: all 2 cells have a result"):
        assert run(*words, "--dry-run").stdout.startswith(left)
        run(*words)
