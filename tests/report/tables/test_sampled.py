"""Results per group of drawn tasks."""

from __future__ import annotations

import pytest
from helpers.synthetic_results import result, score

from stlbench.report import Report, condense
from stlbench.report.tables.across import fields
from stlbench.report.tables.controllers import Known
from stlbench.report.tables.sampled import groups_table, pairs_table
from stlbench.rollout.standards import Standard

TASKS = {f"{system}-{form}": {"system": system, "template": form} for system in ("arm", "car") for form in "abcde"}
STANDARDS = {
    task: Standard(score((1.0,)), own_agent="dqn", at_random=score((-1.0,)), groups=groups)
    for task, groups in TASKS.items()
}
"""Robustness -1 is 0 on the scale, and 1 is 1."""
RESULTS = [
    *(result("good", seed, task=task, robustness=(0.5,)) for task in TASKS for seed in range(2)),
    *(
        result("bad", seed, task=task, robustness=(0.5 if seed else -0.5,))
        for task in TASKS
        if task != "car-d"
        for seed in range(2)
    ),
    *(result("bad", seed, "intractable", task="car-d", reason="too many") for seed in range(2)),
]


def rows(table):
    return {row[3:5]: row[5:] for row in table.rows}


def test_each_group_has_its_tasks():
    found = rows(groups_table(fields(condense(RESULTS), Known(STANDARDS))))
    fits, learned, _, value, _ = found["all", "bad"]
    assert (fits, learned, value) == ("9 of 10", 50.0, pytest.approx(0.5))
    assert found["d", "bad"] == ("1 of 2", 50.0, None, pytest.approx(0.5), None)
    assert found["car", "good"] == ("5 of 5", 100.0, None, pytest.approx(0.75), None)
    assert found["all", "good"][2].low < 100 == found["all", "good"][2].high
    assert {group for group, _ in found} == {"all", "arm", "car", *"abcde"}


def test_two_methods_are_compared_on_tasks_that_both_fit():
    found = rows(pairs_table(fields(condense(RESULTS), Known(STANDARDS))))
    other, both, learned, _, more, ends = found["all", "bad"]
    assert (other, both, learned, more) == ("good", "9 of 10", -50.0, pytest.approx(-0.25))
    assert ends.low < -0.25 < ends.high
    assert found["d", "bad"] == ("good", "1 of 2", -50.0, None, pytest.approx(-0.25), None)


def test_tasks_that_no_suite_drew_have_no_groups():
    plain = {task: Standard(score((1.0,)), own_agent="dqn", at_random=score((-1.0,))) for task in TASKS}
    mixed = STANDARDS | {"arm-a": plain["arm-a"]}
    for standards in (plain, mixed):
        found = fields(condense(RESULTS), Known(standards))
        assert groups_table(found).rows == pairs_table(found).rows == ()


def test_the_report_has_both_tables_and_groups_of_cells():
    report = Report(condense(RESULTS), STANDARDS)
    titles = [table.title for table in report.summary]
    assert {"Groups of drawn tasks", "Differences on drawn tasks"} < set(titles)
    cells = report.tables["cells"]
    at = [column.title for column in cells.columns].index("template")
    assert {(row[0], row[at - 1], row[at]) for row in cells.rows} == {
        (task, groups["system"], groups["template"]) for task, groups in TASKS.items()
    }
