"""The overview's content, from made-up results."""

from __future__ import annotations

import pytest
from helpers.synthetic_results import alike, by_hand, result

from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables.controllers import Known
from stlbench.report.tables.robustness import overview
from stlbench.rollout.standards import Standard


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
    known = {"hold-disc": Standard(alike=alike("hold-disc", funnel_raw="=", flag_raw="~"))}
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


def test_the_best_known_stands_beside_the_controller_where_it_is_known():
    groups = condense([result(task="overlap"), result(task="overlap[without=cuts]"), result(task="other")])
    table = overview(groups, Known(by_hand(overlap=(0.2,)), {Choice("overlap"): 0.25}))
    assert [column.heading for column in table.columns[4:7]] == ["by hand", "best known", "funnel"]
    assert [row[4:6] for row in table.rows] == [(None, None), (0.2, 0.25), (0.2, None)]


def test_learned_is_95_percent_of_the_starts():
    starts = {20: (1.0,) * 19 + (-1.0,), 10: (1.0,) * 9 + (-1.0,)}
    found = {
        count: overview(condense([result(robustness=values)]), Known()).rows[0][4][3:6]
        for count, values in starts.items()
    }
    assert found == {20: (1, 1, 1), 10: (0, 0, 1)}


def test_a_task_by_two_agents_has_two_rows_and_an_ablation_the_controller_of_its_task():
    results = [
        result(agent="dqn", task="overlap"),
        result(agent="sb3-dqn", task="overlap"),
        result(agent="dqn", task="overlap[without=cuts]"),
    ]
    table = overview(condense(results), Known(by_hand(overlap=(0.2,)), {}))
    assert [(row[0], row[1], row[4]) for row in table.rows] == [
        ("overlap", "dqn", 0.2),
        ("overlap", "sb3-dqn", 0.2),
        ("overlap[without=cuts]", "dqn", 0.2),
    ]
