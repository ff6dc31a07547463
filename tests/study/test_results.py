"""Results in Python: tables with every number as it was measured, traces, files of lines."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from helpers.synthetic_results import result

import stlbench
from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.identity import CellId
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.lines import write_lines
from stlbench.records.result import Planned
from stlbench.records.result_files import LINES, cell_files
from stlbench.study.results import Results

THIRD = 1 / 3


@pytest.fixture
def recorded():
    """One finished cell, one that raised, and one whose method does not fit."""
    done = result("funnel[ginf=0.02]", robustness=(THIRD, -0.5), final=(0.25, 0.5), further={"tail": (2.0, 4.0)})
    done = replace(done, key="0123456789abcdef")
    raised = replace(result("flag", 1, "raised", reason="ValueError: no luck"), details="Traceback ...\nValueError")
    return (done, raised, result("tau-mdp", 2, "intractable", reason="6003 inputs"))


@pytest.fixture
def results(recorded, tmp_path):
    return Results.of(recorded, tmp_path)


def test_one_row_per_cell(results):
    table = results.cells()
    assert list(table.columns[:8]) == ["task", "method", "agent", "seed", "budget", "track", "status", "reason"]
    assert table["status"].tolist() == ["raised", "done", "intractable"]
    done = table[table["status"] == "done"].iloc[0]
    assert (done["method"], done["seed"], done["jobs"]) == ("funnel[ginf=0.02]", 0, "2")
    assert (done["training_cpu_seconds"], done["env_steps"]) == (10.0, 2000)
    assert table["env_steps"].isna().tolist() == [True, False, True]


def test_planned_policies_say_what_they_maximise_and_what_the_plan_expects(recorded, tmp_path):
    plan = result(agent="planner", planned=Planned("reward", -1.5))
    table = Results.of([*recorded, plan], tmp_path).cells().set_index("agent")
    assert table.loc["planner", ["maximised", "grid_value"]].tolist() == ["reward", -1.5]
    assert table.loc["dqn", ["maximised", "grid_value"]].isna().all(axis=None)


def test_one_row_per_cell_protocol_and_policy_with_every_digit(results):
    table = results.robustness()
    assert list(table.columns) == [
        *("task", "method", "agent", "seed", "budget", "track"),
        *("protocol", "policy", "robustness_mean", "robustness_min", "satisfaction", "ended_early"),
    ]
    rows = table[["protocol", "policy", "robustness_mean", "robustness_min", "satisfaction"]].values.tolist()
    assert rows == [
        ["formula", "selected", (THIRD - 0.5) / 2, -0.5, 0.5],
        ["formula", "final", 0.375, 0.25, 1.0],
        ["tail", "selected", 3.0, 2.0, 1.0],
        ["tail", "final", 3.0, 2.0, 1.0],
    ]


def test_one_row_per_checkpoint(results):
    table = results.curves()
    rows = table[["steps", "cpu_seconds", "satisfaction", "robustness_mean"]].values.tolist()
    assert rows == [[1000, 1.0, 0.5, -0.1], [2000, 2.0, 1.0, 0.3]]
    assert table["starts"].tolist() == [16, 64]
    assert set(table["method"]) == {"funnel[ginf=0.02]"}


def test_failures_have_reason_and_traceback_and_a_finding_is_none(results):
    (row,) = results.failures().to_dict("records")
    assert (row["method"], row["status"], row["reason"]) == ("flag", "raised", "ValueError: no luck")
    assert row["traceback"] == "Traceback ...\nValueError"


def test_tables_of_nothing_have_their_columns(tmp_path):
    nothing = Results((), tmp_path)
    for table in (nothing.cells(), nothing.robustness(), nothing.curves(), nothing.failures()):
        assert len(table) == 0
        assert list(table.columns[:6]) == ["task", "method", "agent", "seed", "budget", "track"]


def test_what_was_planned_and_did_not_run_is_a_row(recorded, tmp_path):
    missing = CellId.parse("hold-disc/funnel/dqn/4", "quick")
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.plan({"missing": missing, recorded[0].key: recorded[0].id})
        ledger.record(recorded[0])
    loaded = Results.load(tmp_path)
    assert loaded.missing == (missing,)
    assert loaded.cells()[["seed", "status"]].values.tolist() == [[4, "not run"], [0, "done"]]
    assert repr(loaded) == f"<Results of 1 cells in {tmp_path}: 1 done, 1 not run>"


def test_a_cell_by_name_and_by_identity(results, recorded):
    assert results.cell("hold-disc/flag/dqn/1") == recorded[1]
    assert results.cell(recorded[0].id) == recorded[0]
    with pytest.raises(UsageError, match=r"no cell 'hold-disc/flag/dqn/7'; did you mean 'hold-disc/flag/dqn/1'"):
        results.cell("hold-disc/flag/dqn/7")
    for number in (0, None):
        with pytest.raises(UsageError, match=f"^'{number}' names no cell; a name is task/method/agent/seed"):
            results.cell(number)
    with pytest.raises(UsageError, match=r"hold-disc/flag/dqn/1 has no budget '5'; there are: "):
        results.cell("hold-disc/flag/dqn/1", 5)


def test_traces(results, recorded, tmp_path):
    path = cell_files(tmp_path, recorded[0].id, recorded[0].key).traces
    path.parent.mkdir()
    np.savez_compressed(path, traces=np.arange(12.0).reshape(2, 3, 2), signals=np.array(["x", "y"]))
    traces = results.traces(recorded[0].id.name)
    assert traces.names == ("x", "y")
    assert traces.samples[1, 2].tolist() == [10.0, 11.0]
    with pytest.raises(UsageError, match="hold-disc/flag/dqn/1 has no traces at"):
        results.traces("hold-disc/flag/dqn/1")


def test_lines_hold_all_that_a_ledger_holds(recorded, tmp_path):
    odd = result("raw", robustness=(math.inf, -1e-300), reward_nanoseconds=0.1 + 0.2)
    with Ledger(tmp_path / "a" / LEDGER) as ledger:
        for one in (*recorded, odd):
            ledger.record(one)
    assert write_lines(results_folder.read(tmp_path / "a"), tmp_path / "b" / LINES) == 4
    first, second = Results.load(tmp_path / "a"), Results.load(tmp_path / "b")
    assert first.results == second.results
    lines = (tmp_path / "b" / LINES).read_text().splitlines()
    assert [json.loads(line)["method"] for line in lines] == ["flag", "funnel[ginf=0.02]", "raw", "tau-mdp"]


def test_the_ledger_goes_before_the_lines(recorded, tmp_path):
    write_lines(recorded, tmp_path / LINES)
    assert results_folder.locate(tmp_path) == tmp_path / LINES
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.record(recorded[0])
    assert results_folder.locate(tmp_path) == tmp_path / LEDGER
    assert len(Results.load(tmp_path)) == 1
    assert len(Results.load(tmp_path / LINES)) == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}\n", "line 1: not a result as"),
        ("nonsense\n", "line 1: not a result as"),
        ("[1]\n", "line 1: not a result as `stlbench export --format jsonl` writes it: expected an object"),
        (None, "ledger.sqlite nor cells.jsonl; `stlbench run` writes"),
    ],
)
def test_what_is_no_result(recorded, tmp_path, text, message):
    if text is not None:
        (tmp_path / LINES).write_text(text)
    with pytest.raises(UsageError) as caught:
        Results.load(tmp_path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_was_planned_and_not_run_is_a_line_too(recorded, tmp_path):
    planned = CellId.parse("hold-disc/raw/dqn/7", "quick")
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.record(recorded[0])
        ledger.plan({"a key": planned, recorded[0].key: recorded[0].id})
    written = tmp_path / "text" / LINES
    lines = results_folder.missing(tmp_path)
    assert lines == {"a key": planned}
    write_lines(results_folder.read(tmp_path), written, lines)
    assert list(results_folder.read(written)) == [recorded[0]]
    assert results_folder.missing(written) == lines
    assert list(results_folder.missing(written).values()) == [planned]
    assert [json.loads(line)["status"] for line in written.read_text().splitlines()] == ["done", "not run"]
    with pytest.raises(UsageError, match="line 1: not a result as"):
        results_folder.missing(_written(tmp_path / "bad.jsonl", '{"task": "hold-disc", "status": "not run"}'))


def _written(path, text):
    path.write_text(text + "\n")
    return path


def test_the_front_door():
    assert stlbench.Results is Results
    assert set(stlbench.__all__) <= set(dir(stlbench)) | {"Results", "Solution", "run_study", "solve", "wrap"}
    with pytest.raises(AttributeError, match="no attribute 'run_studdy'"):
        stlbench.run_studdy  # noqa: B018


@pytest.mark.parametrize(
    ("statement", "heavy"),
    [
        ("import stlbench", {"numpy", "pandas", "pydantic", "typer", "yaml"}),
        ("import stlbench.stl", {"pandas", "pydantic", "typer", "yaml"}),
        ("import stlbench; stlbench.run_study, stlbench.Results", {"pandas", "matplotlib", "torch", "typer"}),
    ],
)
def test_what_an_import_does_not_load(statement, heavy):
    code = f"{statement}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "stlbench" in done.stdout.split()
    assert not heavy & set(done.stdout.split())


def test_comparisons_are_those_of_the_report(tmp_path):
    scores = {"funnel": (0.38, 0.37, 0.39), "raw": (0.1, 0.2, 0.15)}
    made = [result(method, seed, robustness=(scores[method][seed],)) for method in scores for seed in range(3)]
    table = Results.of(made, tmp_path).comparisons()
    (row,) = table.to_dict("records")
    assert (row["task"], row["method"], row["other"]) == ("hold-disc", "funnel", "raw")
    assert row["difference"] == pytest.approx(0.38 - 0.15)
    assert row["difference 95 % interval low"] < row["difference"] < row["difference 95 % interval high"]
    assert row["verdict"]
    empty = Results.of(made[:3], tmp_path).comparisons()
    assert (len(empty), list(empty.columns)) == (0, list(table.columns))


def test_a_fact_with_the_name_of_a_column_takes_no_place_in_the_table(tmp_path):
    """The table's own columns stay numbers, also where a stranger's fact has such a name."""
    made = replace(result(), provenance={"env_steps": "many", "task": "other", "machine": "m"})
    raised = replace(result(seed=1, status="raised"), provenance={"env_steps": "many"})
    cells = Results.of([made, raised], tmp_path).cells()
    assert list(cells.env_steps.fillna(-1)) == [2000, -1]
    assert list(cells.task) == ["hold-disc", "hold-disc"]
    assert list(cells.machine.fillna("")) == ["m", ""]
