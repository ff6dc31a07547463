"""Scores on one scale, and what counts in aggregates over tasks."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.synthetic_results import result, score

from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables.across import aggregates, aggregates_table, fields, improvement_table
from stlbench.report.tables.summary import summary
from stlbench.rollout.standards import Standard

TASKS = ("one", "two", "three", "four")
STANDARDS = {task: Standard(score((1.0,)), own_agent="dqn", at_random=score((-1.0,))) for task in TASKS}
"""Robustness -1 is 0 on the scale, and 1 is 1."""


def seeds(method, *values, **words):
    return [result(method, seed, robustness=(value,), **words) for seed, value in enumerate(values)]


RESULTS = [
    *(each for task in TASKS for each in seeds("good", 0.9, 0.8, task=task)),
    *(each for task in TASKS[:3] for each in seeds("bad", -0.2, 0.0, task=task)),
    *(result("bad", seed, "intractable", task="four", reason="too many") for seed in range(2)),
]


def test_robustness_is_normalised_from_random_to_best_and_cells_without_a_result_count_as_random():
    every, common = fields(condense(RESULTS), STANDARDS, {Choice("one"): 3.0})
    assert (every.name, common.name) == ("all 4", "the 3 of 4 that all finished")
    bad, good = every.entries
    assert every.tasks == ("four", "one", "three", "two")
    assert good.scores == tuple(pytest.approx(x) for x in ((0.95, 0.9), (0.475, 0.45), (0.95, 0.9), (0.95, 0.9)))
    assert bad.scores[0] == (0, 0)
    assert bad.scores[1] == pytest.approx((0.2, 0.25))
    assert (bad.unfinished, good.unfinished) == ("2 intractable", "")
    assert common.tasks == ("one", "three", "two")
    assert common.entries[0].unfinished == ""


def test_every_way_to_end_without_a_result_stays_visible():
    ends = [result("bad", seed, status, task="four") for seed, status in enumerate(("timeout", "raised", "killed"))]
    missing = [result("bad", 9, task="four").id]
    every, *_ = fields(condense([*RESULTS[:-2], *ends], missing), STANDARDS, {})
    assert every.entries[0].unfinished == "1 timeout, 1 raised, 1 killed, 1 not run"
    assert every.entries[0].scores[0] == (0, 0, 0, 0)


def test_a_robustness_without_bound_counts_as_random():
    (field,) = fields(condense([*RESULTS[:12], *seeds("bad", float("-inf"), 0.0, task="four")]), STANDARDS, {})
    bad = next(entry for entry in field.entries if entry.method == "bad")
    assert bad.scores[0] == (0, 0.5)


def test_tasks_count_if_they_are_no_ablation_by_their_own_agent_and_on_a_known_scale():
    others = [
        *seeds("good", 1.0, 1.0, task="one[without=cuts]"),
        *seeds("bad", 1.0, 1.0, task="one[without=cuts]"),
        *seeds("good", 1.0, 1.0, task="one", agent="sb3-dqn"),
        *seeds("bad", 1.0, 1.0, task="one", agent="sb3-dqn"),
        *seeds("good", 1.0, 1.0, task="elsewhere"),
        *seeds("bad", 1.0, 1.0, task="elsewhere"),
    ]
    assert fields(condense([*RESULTS, *others]), STANDARDS, {}) == fields(condense(RESULTS), STANDARDS, {})
    flat = STANDARDS | {task: replace(STANDARDS[task], at_random=score((2.0,))) for task in ("one", "two")}
    assert fields(condense(RESULTS), flat, {}) == ()


def test_methods_that_were_not_tried_everywhere_are_left_out_and_budgets_and_tracks_stay_apart():
    some = seeds("special", 1.0, task="one")
    plain = [replace(each, id=replace(each.id, track="plain")) for each in RESULTS]
    found = fields(condense([*RESULTS, *some, *plain]), STANDARDS, {})
    assert [(field.track, len(field.tasks)) for field in found] == [
        ("plain", 4),
        ("plain", 3),
        ("shared", 4),
        ("shared", 3),
    ]
    assert {entry.method for field in found for entry in field.entries} == {"good", "bad"}


def test_two_tasks_or_one_method_have_no_aggregate():
    assert fields(condense([each for each in RESULTS if each.id.task.name in TASKS[:2]]), STANDARDS, {}) == ()
    assert fields(condense(RESULTS[:8]), STANDARDS, {}) == ()


def test_aggregates_have_intervals_and_ranks():
    every, _ = fields(condense(RESULTS), STANDARDS, {})
    bad, good = aggregates(every)
    assert good.mean.value == pytest.approx(0.925)
    assert good.mean.interval.low < 0.925 < good.mean.interval.high
    assert (bad.rank, good.rank) == ((2.0, (2.0, 2.0)), (1.0, (1.0, 1.0)))


def test_both_tables_say_of_which_tasks_they_are():
    found = fields(condense(RESULTS), STANDARDS, {})
    table = aggregates_table(found)
    columns = [column.title for column in table.columns]
    assert [(row[2], row[3], row[columns.index("without a result")]) for row in table.rows] == [
        ("all 4", "bad", "2 intractable"),
        ("all 4", "good", None),
        ("the 3 of 4 that all finished", "bad", None),
        ("the 3 of 4 that all finished", "good", None),
    ]
    assert [row[2:6] for row in improvement_table(found).rows] == [
        ("all 4", "bad", "good", 0.0),
        ("the 3 of 4 that all finished", "bad", "good", 0.0),
    ]


def test_they_stand_after_the_overview():
    titles = [table.title for table in summary(condense(RESULTS), STANDARDS)]
    assert titles[:4] == ["Overview", "Across tasks", "Probability of improvement", "Robustness"]
