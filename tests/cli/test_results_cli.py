"""`export`, `show cell`, `show method`, `results remove` and `merge`, and a study in a file, from words to files."""

from __future__ import annotations

import csv
import importlib
import json
import os
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.refusals import refused
from helpers.synthetic_results import result

import stlbench
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.lines import write_lines
from stlbench.records.result_files import LINES
from stlbench.share.bundle import METADATA, read_metadata

STUDY = "tasks: toy-line\nmethods: [toy-raw, toy-wrong]\nagents: [toy-agent]\nexecutor: toy-here\nseeds: 1\n"


@pytest.fixture
def study(toy, tmp_path, monkeypatch):
    """A file that describes a study of two cells, of which one raises, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    Path("study.yaml").write_text(STUDY)
    return "study.yaml"


@pytest.fixture
def ledger(say):
    """Three synthetic cells in results/."""
    with Ledger(Path("results") / LEDGER) as ledger:
        for one in (result("funnel"), result("flag", 1, "raised", reason="ValueError: no luck"), result("raw", 2)):
            ledger.record(one)


def rows(path):
    with Path(path).open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_study_in_a_file_runs_and_options_go_before_it(say, study):
    assert say("run", study).exit_code == 1
    found = [(row["method"], row["status"]) for row in rows("results/cells.csv")]
    assert found == [("toy-raw", "done"), ("toy-wrong", "raised")]
    assert say("run", study, "--methods", "toy-raw[weight=2]", "--seeds", "3,4", "--results", "other").exit_code == 0
    found = [(row["method"], row["seed"]) for row in rows("other/cells.csv")]
    assert found == [("toy-raw[weight=2]", "3"), ("toy-raw[weight=2]", "4")]


def test_shards_merge_into_what_one_run_gives_and_a_killed_one_goes_on(say, study, monkeypatch):
    toy_agents = importlib.import_module("toy_plugins.agents")
    words = ("run", study, "--methods", "toy-raw,toy-raw[weight=2]", "--seeds", "3")
    assert say(*words, "--results", "whole").exit_code == 0
    say(*words, "--results", "warm-up")
    monkeypatch.setattr(toy_agents, "interrupt_after", 3)
    assert say(*words, "--shard", "1/2").exit_code == 130
    monkeypatch.setattr(toy_agents, "interrupt_after", None)
    again = say(*words, "--shard", "1/2")
    assert (again.exit_code, again.stderr.splitlines()[0]) == (0, "3 cells, 1 of them done before")
    assert "nothing would run: all 3 cells" in say(*words, "--shard", "1/2", "--dry-run").stdout
    assert say(*words, "--shard", "2/2").exit_code == 0
    merged = say("results", "merge", "results", "results/shard-1-of-2", "results/shard-2-of-2")
    assert merged.stdout.count("3 new, 0 better") == 2
    done = say(*words)
    assert done.stderr.splitlines()[0] == "6 cells, 6 of them done before"
    parts, whole = (
        [[row[name] for name in ("method", "seed", "status", "robustness_mean")] for row in rows(f"{folder}/cells.csv")]
        for folder in ("results", "whole")
    )
    assert parts == whole


def test_a_shard_without_cells_is_no_error_and_one_out_of_range_is(say, study):
    assert say("run", study, "--methods", "toy-raw", "--shard", "2/2").exit_code == 0
    said = refused(say("run", study, "--shard", "3/2"))
    assert said == "error: study.yaml: shard: K/N is expected, as in 3/40, with K from 1 to N, got '3/2'"


def test_a_file_with_errors_is_one_line(say, study):
    Path(study).write_text(STUDY.replace("seeds: 1", "seeds: -1\nbudgt: quick"))
    line = refused(say("run", study))
    assert line.startswith("error: study.yaml: ")
    assert "no key 'budgt'; did you mean 'budget'?" in line


def test_from_python_it_is_the_same_study(say, study):
    results = stlbench.run_study(study, methods=["toy-raw"], seeds=2)
    assert results.cells()["status"].tolist() == ["done", "done"]
    assert say("run", study, "--methods", "toy-raw", "--seeds", "2").stderr == "2 cells, 2 of them done before\n"
    wrong = stlbench.run_study(study, methods="toy-wrong", seeds=[0])
    assert wrong.failures()["reason"].tolist() == ["ValueError: no [such] luck"]
    assert len(stlbench.Results.load("results")) == 3


def test_tables_in_full_precision(say, ledger):
    done = say("export", "results", "--format", "csv")
    assert done.exit_code == 0
    assert done.stdout.split() == [f"results/export/{name}.csv" for name in ("cells", "robustness", "curves")]
    assert [row["status"] for row in rows("results/export/cells.csv")] == ["raised", "done", "done"]
    (first, *_) = rows("results/export/robustness.csv")
    assert (first["method"], float(first["robustness_mean"])) == ("funnel", (0.3 + 0.4) / 2)


def test_lines_take_the_place_of_the_ledger(say, ledger):
    done = say("export", "results", "--format", "jsonl", "--out", "text", "--json")
    assert json.loads(done.stdout) == ["text/cells.jsonl.xz"]
    same = say("compare", "results", "text", "--json"), say("compare", "results", "results", "--json")
    first, second = (json.loads(done.stdout) for done in same)
    assert first["comparisons"] == second["comparisons"]
    assert (first["findings"], first["new"]["cells"]) == (second["findings"], 3)
    assert say("report", "text", "--json").stdout == say("report", "results", "--json").stdout
    assert say("show", "cell", "hold-disc/raw/dqn/2", "text").exit_code == 0
    drawn = say("plot", "text")
    assert drawn.exit_code == 0
    assert "learning-hold-disc" in drawn.stdout
    assert drawn.stderr.splitlines()[0] == "warning: there are no traces in text; learning curves are all that is drawn"
    assert drawn.stderr.count("warning") == 1


def test_parquet(say, ledger, monkeypatch):
    pytest.importorskip("pyarrow")
    import pandas as pd

    assert say("export", "results", "--format", "parquet", "--out", "out").exit_code == 0
    table = pd.read_parquet("out/robustness.parquet")
    pd.testing.assert_frame_equal(table, stlbench.Results.load("results").robustness())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["export", "nowhere"], "there is neither nowhere/ledger.sqlite nor cells.jsonl"),
        (["export", "results", "--format", "xls"], "'xls' is not one of"),
        (["report", "results", "--width", "wide"], "'wide' is not one of"),
        (["show", "cell", "hold-disc/funnel/dqn/7"], "there is no cell 'hold-disc/funnel/dqn/7'; did you mean"),
        (["show", "method", "funel"], "no method 'funel'; did you mean 'funnel'?"),
        (["results", "remove", "results"], "which cells?"),
        (["results", "remove", "results", "*", "--json"], "--json cannot ask for a yes; add --yes"),
    ],
)
def test_bad_input_exits_2_with_one_line(say, ledger, words, message):
    assert message in refused(say(*words))


def test_a_cell_that_raised_says_why(say, study):
    say("run", study)
    done = say("show", "cell", "toy-line/toy-wrong/toy-agent/0")
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["cell:", "toy-line/toy-wrong/toy-agent/0"]
    assert any(line.split() == ["status:", "raised"] for line in lines)
    assert "ValueError: no [such] luck" in done.stdout
    shown = json.loads(say("show", "cell", "toy-line/toy-wrong/toy-agent/0", "--json").stdout)
    assert (shown["status"], shown["reason"]) == ("raised", "ValueError: no [such] luck")
    assert shown["provenance"]["machine"]


def test_a_method_with_parameters_and_limits(say):
    shown = json.loads(say("show", "method", "funnel", "--json").stdout)
    assert shown["description"].startswith("Robustness inside a funnel")
    assert "Saxena" in shown["source"]
    ginf = shown["parameters"]["ginf"]
    assert (ginf["type"], ginf["default"], ginf["meaning"][:9]) == ("float", 0.01, "gamma_inf")
    assert all(parameter["meaning"] for parameter in shown["parameters"].values())
    assert "outside the fragment of eq. 2" in shown["limits"]["Unsuitable"]
    screen = say("show", "method", "funnel").stdout
    assert "Parameters" in screen
    assert "Where it does not fit" in screen


def test_removing_says_what_and_asks(say, ledger):
    for answer in ("n\n", ""):  # the second is what a program says that is not asked by a person
        asked = say("results", "remove", "results", "--status", "raised", stdin=answer)
        assert asked.exit_code == 1
        assert "hold-disc/flag/dqn/1 quick raised" in asked.stdout
        assert "error: the question was not answered with yes; nothing was changed" in asked.stderr
        assert len(stlbench.Results.load("results")) == 3
    asked = say("results", "remove", "results", "--status", "raised", stdin="y\n")
    assert asked.exit_code == 0
    assert asked.stdout.splitlines()[-1].startswith("Removed 1 cell from results/")
    assert len(stlbench.Results.load("results")) == 2


def test_merging_says_how_many(say, ledger):
    write_lines([result("funnel"), result("funnel", 5)], Path("more") / LINES)
    done = say("results", "merge", "results", "more")
    assert done.stdout == "more: 1 new, 0 better or newer, 1 left out\n"
    again = json.loads(say("results", "merge", "results", "more", "--json").stdout)
    assert again == [
        {"from": "more", "added": 0, "replaced": 0, "kept": 2, "planned": 0, "conflicts": [], "damaged": []}
        | {"other_code": 0},
    ]
    write_lines([replace(result("funnel"), key="of older code")], Path("old") / LINES)
    done = say("results", "merge", "results", "old")
    assert done.stderr == (
        "warning: the keys of 1 cell in old/ and results/ differ, as after a change of code; "
        "a result that results/ has planned stays, else the later one\n"
    )


def test_the_last_two_lines_say_where_all_tables_are(ledger, say):
    done = say("report", "results")
    assert done.exit_code == 0
    notes = "Robustness is in the unit of the task's predicates"
    assert notes not in done.stdout
    assert done.stdout.splitlines()[-2:] == [
        "All tables: results/report.md; as .csv and .tex, and figures/, beside it.",
        "All tables here, with notes: stlbench report results --explain",
    ]
    assert notes in Path("results/report.md").read_text()
    explained = say("report", "results", "--explain")
    assert notes in explained.stdout
    assert "All tables here" not in explained.stdout


@pytest.mark.slow  # tests/report measures the figures
def test_a_report_for_a_column_has_narrow_figures_and_tables(ledger, say, drawn):
    say("report", "results")
    wide = Path("results/figures/robustness-hold-disc.svg").read_text()
    assert say("report", "results", "--width", "column").exit_code == 0
    narrow = Path("results/figures/robustness-hold-disc.svg").read_text()
    inches = [float(re.search(r'width="([0-9.]+)pt"', text)[1]) / 72 for text in (wide, narrow)]
    assert inches == pytest.approx([7.16, 3.5], abs=0.01)
    assert "% Left out: " in Path("results/robustness.tex").read_text()


def test_sources_are_looked_at_before_any_is_merged_and_each_has_a_line(say, ledger):
    write_lines([result("funnel", 5)], Path("more") / LINES)
    assert "there is neither nowhere" in refused(say("results", "merge", "results", "more", "nowhere"))
    assert len(stlbench.Results.load("results")) == 3
    lines = say("results", "merge", "results", "more", "more/").stdout.splitlines()
    assert lines == ["more: 1 new, 0 better or newer, 0 left out", "more: 0 new, 0 better or newer, 1 left out"]


def test_what_is_no_text_in_a_title_is_its_escape(say, ledger):
    wrong = os.fsdecode(b"a\xff")
    Path("results").rename(wrong)
    assert say("bundle", wrong, "b.zip", "--author", wrong, "--license", wrong).exit_code == 0
    about = read_metadata(zipfile.ZipFile("b.zip").read(METADATA).decode()).about
    assert (about.title, about.authors, about.license) == ("a\\udcff", ("a\\udcff",), "a\\udcff")
