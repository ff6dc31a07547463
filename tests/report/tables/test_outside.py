"""Policies from outside: beside what was trained, whatever they are called, and in no statistic."""

from __future__ import annotations

from dataclasses import replace

from helpers.reports import summary
from helpers.synthetic_results import plan, result

from stlbench.records.result import Result
from stlbench.report import condense, to_records
from stlbench.report.tables.controllers import Known, best_known
from stlbench.report.tables.robustness import robustness_table
from stlbench.report.tables.rows import maximised, split

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
