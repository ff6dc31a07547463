"""Results per group of drawn tasks."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.synthetic_results import result, score

from stlbench.registry.choices import Choice
from stlbench.report import Report, condense
from stlbench.report.tables.across import fields
from stlbench.report.tables.sampled import common, groups_table, pairs_table
from stlbench.report.tables.yardsticks import Known
from stlbench.tracks.references import References

TASKS = {f"{system}-{form}": {"system": system, "template": form} for system in ("arm", "car") for form in "abcde"}
STANDARDS = {
    task: References(score((1.0,)), own_agent="dqn", at_random=score((-1.0,)), groups=groups)
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
    """The common tasks come first; then those that the method fits."""
    found = rows(groups_table(fields(condense(RESULTS), Known(STANDARDS))))
    shared, learned, _, value, _, fits, own_learned, _, own_value, _ = found["all", "good"]
    assert (shared, learned, value) == ("9 of 10", 100.0, pytest.approx(0.75))
    assert (fits, own_learned, own_value) == ("10 of 10", 100.0, pytest.approx(0.75))
    assert found["all", "bad"][:2] == ("9 of 10", 50.0)
    assert found["d", "bad"][:5] == ("1 of 2", 50.0, None, pytest.approx(0.5), None)
    assert found["d", "good"][5] == "2 of 2"
    assert found["car", "good"][:5] == ("4 of 5", 100.0, None, pytest.approx(0.75), None)
    assert found["all", "good"][2].low < 100 == found["all", "good"][2].high
    assert {group for group, _ in found} == {"all", "arm", "car", *"abcde"}


def test_shares_are_compared_on_the_tasks_that_all_methods_fit():
    """One method learns the easy tasks alone that the other fits; on these they are as good."""
    easy = [task for task in TASKS if task[-1] in "abc"]
    broad = [result("broad", 0, task=task, robustness=(0.5 if task in easy else -0.5,)) for task in TASKS]
    narrow = [
        result("narrow", 0, task=task, robustness=(0.5,))
        if task in easy
        else result("narrow", 0, "intractable", task=task, reason="too many")
        for task in TASKS
    ]
    found = rows(groups_table(fields(condense(broad + narrow), Known(STANDARDS))))
    assert [found["all", method][:2] for method in ("broad", "narrow")] == [("6 of 10", 100.0)] * 2
    assert [found["all", method][5:7] for method in ("broad", "narrow")] == [("10 of 10", 60.0), ("6 of 10", 100.0)]


def test_methods_that_fit_less_than_half_leave_the_common_tasks_alone():
    assert common([{0, 1, 2, 3}, {1, 2}, {3}], 4) == {1, 2}
    assert common([{0}, set()], 4) == set()
    few = [
        result("few", 0, task=task, robustness=(0.5,))
        if task == "arm-a"
        else result("few", 0, "intractable", task=task, reason="too many")
        for task in TASKS
    ]
    found = rows(groups_table(fields(condense([*RESULTS, *few]), Known(STANDARDS))))
    assert found["all", "good"][0] == "9 of 10"
    assert found["all", "few"][:7] == ("0 of 10", None, None, None, None, "1 of 10", 100.0)


def test_two_methods_are_compared_on_tasks_that_both_fit():
    found = rows(pairs_table(fields(condense(RESULTS), Known(STANDARDS))))
    other, both, learned, _, more, ends = found["all", "bad"]
    assert (other, both, learned, more) == ("good", "9 of 10", -50.0, pytest.approx(-0.25))
    assert ends.low < -0.25 < ends.high
    assert found["d", "bad"] == ("good", "1 of 2", -50.0, None, pytest.approx(-0.25), None)


def test_they_are_compared_so_whichever_of_the_two_fits_fewer():
    """As above, with the names exchanged: the first of a pair fits all tasks."""
    renamed = {"good": "ace", "bad": "poor"}
    other = [replace(each, id=replace(each.id, method=Choice(renamed[str(each.id.method)]))) for each in RESULTS]
    found = rows(pairs_table(fields(condense(other), Known(STANDARDS))))
    assert found["all", "ace"][:3] == ("poor", "9 of 10", 50.0)
    assert found["d", "ace"][:3] == ("poor", "1 of 2", 50.0)


def test_tasks_that_no_suite_drew_have_no_groups():
    plain = {task: References(score((1.0,)), own_agent="dqn", at_random=score((-1.0,))) for task in TASKS}
    mixed = STANDARDS | {"arm-a": plain["arm-a"]}
    for references in (plain, mixed):
        found = fields(condense(RESULTS), Known(references))
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
