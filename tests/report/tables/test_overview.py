"""The overview, how results came about, and policies from outside, from made-up results."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.reports import summary
from helpers.synthetic_results import alike, by_hand, plan, result

from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables.rows import maximised, split
from stlbench.report.tables.runs import circumstances, overview, robustness_table
from stlbench.report.tables.table import to_records
from stlbench.report.tables.yardsticks import Known, best_known
from stlbench.tracks.references import References


def test_one_row_per_task_and_one_column_per_method():
    results = [
        *(
            result("funnel", seed=seed, robustness=(value, value), final=(0.1, 0.1))
            for seed, value in enumerate((0.1, 0.2, -0.6))
        ),
        result("raw", seed=0, robustness=(0.5,), cpu_seconds=7.0),
        result("tau-mdp", seed=0, status="intractable", reason="needs 6000 inputs, limit 512"),
        result("raw", seed=0, task="other", robustness=(-0.0001,)),
    ]
    table = overview(condense(results), Known(by_hand(hold_disc=(0.4,)), {}))
    assert [column.heading for column in table.columns[4:]] == ["by hand", "funnel", "raw", "tau-mdp", "cell CPU [s]"]
    assert [row[0] for row in table.rows] == ["hold-disc", "other"]
    assert table.rows[0][4] == 0.4
    assert table.rows[0][5] == (0.1, None, None, 2, 3, 3, "")
    assert table.rows[0][6:] == ((0.5, None, None, 1, 1, 1, ""), "intractable", pytest.approx((3 * 14 + 7) / 4))
    assert table.rows[1][4:] == (None, None, (-0.0001, None, None, 0, 0, 1, ""), None, 14.0)


def test_seeds_that_crashed_did_not_learn_and_those_that_did_not_run_do_not_count():
    results = [result(seed=seed) for seed in range(3)] + [result(seed=3, status="timeout")]
    missing = [result(seed=seed).id for seed in (4, 5)]
    assert overview(condense(results, missing), Known()).rows[0][4][3:6] == (3, 3, 4)


def test_marks_are_explained_below():
    results = [
        result("flag", extension="its source has no absolute intervals"),
        result("funnel"),
        result("raw"),
        result("raw", task="other"),
        result("raw", track="plain"),
        result("funnel", track="plain"),
    ]
    known = {"hold-disc": References(alike=alike("hold-disc", funnel_raw="=", flag_raw="~"))}
    table = overview(condense(results), Known(known))
    marks = {(row[0], row[3]): [value.mark if value else None for value in row[4:-1]] for row in table.rows}
    assert marks == {
        ("hold-disc", "plain"): [None, "", ""],
        ("hold-disc", "shared"): ["*~", "=", "=~"],
        ("other", "shared"): [None, None, ""],
    }
    assert [note[:8] for note in table.notes[1:]] == ["Marked *", "Marked =", "Marked ~"]
    assert len(overview(condense(results[3:]), Known(known)).notes) == 1


def test_advice_stands_below():
    assert overview(condense([result()]), Known(), advice=("6 seeds would do.",)).notes[-1] == "6 seeds would do."


def test_learned_is_95_percent_of_the_starts():
    starts = {20: (1.0,) * 19 + (-1.0,), 10: (1.0,) * 9 + (-1.0,)}
    found = {
        count: overview(condense([result(robustness=values)]), Known()).rows[0][4][3:6]
        for count, values in starts.items()
    }
    assert found == {20: (1, 1, 1), 10: (0, 0, 1)}
    told = " ".join(robustness_table(condense([result()]), Known()).notes)
    assert "satisfies from at least 95 % of the starts" in told


def test_a_task_by_two_agents_has_two_rows_and_an_ablation_its_task_s_controller():
    results = [
        result(agent="dqn", task="overlap"),
        result(agent="sb3-dqn", task="overlap"),
        result(agent="dqn", task="overlap[without=cuts]"),
    ]
    table = overview(condense(results), Known(by_hand(overlap=(0.2,)), {Choice("overlap"): 0.25}))
    assert [(row[0], row[1], *row[4:6]) for row in table.rows] == [
        ("overlap", "dqn", 0.2, 0.25),
        ("overlap", "sb3-dqn", 0.2, 0.25),
        ("overlap[without=cuts]", "dqn", 0.2, None),
    ]


def test_versions_machine_days_and_hours():
    facts = {"code": "harness 3, dqn 2, funnel 1", "time": "2026-11-20T23:00:00+00:00"}
    found = dict(circumstances(condense([replace(result(), provenance=facts)])).rows)
    assert (found["code of stlbench"], found["begun"]) == ("3", "2026-11-20")
    common = {"python": "3.12.1", "numpy": "2.4.6", "machine": "a laptop", "training_calibration_seconds": "0.1"}
    provenance = [
        common | {"jobs": "2", "time": "2026-11-20T23:00:00+00:00"},
        common | {"jobs": "2", "time": "2026-11-21T01:00:00+00:00", "numpy": "2.5.0"},
    ]
    results = [
        replace(result(seed=seed, cpu_seconds=1800.0), provenance=found) for seed, found in enumerate(provenance)
    ]
    results.append(replace(result(seed=2, status="timeout"), provenance=provenance[1]))
    assert dict(circumstances(condense(results)).rows) == {
        "machine": "a laptop",
        "versions": "numpy 2.4.6; 2.5.0, python 3.12.1",
        "cells at a time": "2",
        "begun": "2026-11-20 to 2026-11-21",
        "cells": "3, 2 of them with a result",
        "CPU time": "1.00 hours, training and evaluation",
    }


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(59.94, "59.9 seconds"), (60, "1.0 minutes"), (90, "1.5 minutes"), (3599, "60.0 minutes"), (3600, "1.00 hours")],
)
def test_short_runs_are_said_in_seconds_or_minutes_and_what_is_not_known_is_not_said(seconds, said):
    found = dict(circumstances(condense([replace(result(cpu_seconds=seconds), provenance={})])).rows)
    assert found == {"cells": "1, 1 of them with a result", "CPU time": f"{said}, training and evaluation"}


FACTS = {"source": "net.onnx", "sha256": 64 * "a", "begun_at": "starts of its own"}


def outside(agent: str, **words: object) -> Result:
    made = result("unknown", agent=agent, track="outside", **words)  # type: ignore[arg-type]
    return replace(made, provenance=FACTS)


TRAINED = [result("funnel", seed, robustness=(0.1 * seed, 0.2)) for seed in range(2)]
PLANNED = [plan(agent="planner", robustness=(0.5, 0.5)), plan(agent="best-possible", maximised="formula")]


def test_one_that_is_called_as_an_agent_that_plans_is_no_plan() -> None:
    groups = condense([*TRAINED, *PLANNED, outside("planner", robustness=(9.0, 9.0)), outside("dqn")])
    alone = condense([*TRAINED, *PLANNED])
    assert maximised(groups) == maximised(alone)
    assert split(groups) == split(alone)
    assert best_known(groups, {}) == best_known(alone, {})


def test_its_row_comes_behind_those_of_its_task_with_its_origin() -> None:
    other = result("flag", task="overlap")
    groups = condense([*TRAINED, other])
    table = robustness_table(groups, Known(), condense([outside("net", robustness=(-0.5, 0.1))]))
    rows = to_records(table)
    assert [(row["task"], row["agent"], row["mark"]) for row in rows] == [
        ("hold-disc", "dqn", None),
        ("hold-disc", "net", "o"),
        ("overlap", "dqn", None),
    ]
    assert rows[1]["mean robustness"] == -0.2
    assert table.notes[-1] == "net on hold-disc: net.onnx (sha256 aaaaaaaaaaaa), from starts of its own."


def test_no_other_table_of_a_report_knows_of_it() -> None:
    tables, alone = (
        {table.title: table for table in summary(condense(results), {})}
        for results in ([*TRAINED, outside("net")], TRAINED)
    )
    assert len(tables.pop("Robustness").rows) == len(alone.pop("Robustness").rows) + 1
    assert tables == alone
