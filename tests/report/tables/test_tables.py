"""The tables' content, from made-up results with numbers that can be checked by hand."""

from __future__ import annotations

import pickle

from helpers.synthetic_results import result, score

from stlbench import report
from stlbench.report import condense, controllers, cost, robustness, summary, unfinished


def cell(table, column, row=0):
    return table.rows[row][[entry.title for entry in table.columns].index(column)]


def test_robustness_is_averaged_over_starts_and_then_over_seeds():
    results = [
        result(seed=0, robustness=(0.1, 0.3)),
        result(seed=1, robustness=(0.5, 0.9)),
        result(seed=2, robustness=(-0.4,)),
    ]
    table = robustness(condense(results))
    assert cell(table, "mean robustness") == "0.167"  # (0.2 + 0.7 - 0.4) / 3
    assert cell(table, "IQM robustness") == "0.167"
    assert cell(table, "IQM 95 % interval") == "[-0.400, 0.700]"
    assert cell(table, "worst start") == "-0.400"
    assert cell(table, "satisfied [%]") == "66.7"
    assert cell(table, "seeds") == "3 of 3"


def test_iqm_leaves_out_the_lowest_and_the_highest_quarter():
    results = [result(seed=seed, robustness=(value,)) for seed, value in enumerate((-9.0, 1.0, 2.0, 50.0))]
    assert cell(robustness(condense(results)), "IQM robustness") == "1.500"


def test_one_seed_has_no_interval():
    table = robustness(condense([result()]))
    assert cell(table, "mean robustness") == "0.350"
    assert cell(table, "IQM 95 % interval") == "-"


def test_the_final_policy_has_columns_of_its_own():
    table = robustness(condense([result(robustness=(0.3, 0.4), final=(-0.1, 0.2))]))
    assert cell(table, "final robustness") == "0.050"
    assert cell(table, "final satisfied [%]") == "50.0"


def test_each_further_protocol_is_a_column():
    results = [
        result(further={"paper": (0.9, 0.7), "tail": (0.2,)}),
        result(seed=1, further={"paper": (0.6,), "tail": (0.4,)}),
        result("flag", task="other"),
    ]
    table = robustness(condense(results))
    assert (cell(table, "paper"), cell(table, "tail")) == ("0.700", "0.300")
    assert (cell(table, "paper", 1), cell(table, "tail", 1)) == ("-", "-")


def test_the_subformula_that_was_lost_first_most_often_is_counted_over_seeds():
    results = [
        result(seed=0, first_failed={"G[0,1] a > 0": 3, "F[0,2] b > 0": 2}),
        result(seed=1, first_failed={"F[0,2] b > 0": 3}),
        result("flag"),
    ]
    table = robustness(condense(results))
    assert cell(table, "lost first", 0) == "-"
    assert cell(table, "lost first", 1) == "F[0,2] b > 0 (62 % of 8 failing starts)"


def test_groups_are_told_apart_by_task_method_agent_and_budget():
    results = [result(), result(task="other"), result("flag"), result(agent="sb3-dqn"), result(budget="paper")]
    table = robustness(condense(results))
    assert len(table.rows) == 5
    assert all(cell(table, "seeds", row) == "1 of 1" for row in range(5))


def test_order_of_the_results_does_not_matter():
    results = [result(method, seed) for method in ("funnel", "flag") for seed in range(3)]
    assert summary(condense(results), {}) == summary(condense(results[::-1]), {})


def test_aggregates_say_over_how_many_seeds_they_are():
    results = [result(seed=seed) for seed in range(9)] + [
        result(seed=9, status="timeout", reason="no result after 60 s")
    ]
    table = robustness(condense(results))
    assert cell(table, "seeds") == "9 of 10, 1 timeout"
    assert cell(table, "mean robustness") == "0.350"
    assert cell(table, "remarks") == "timeout: no result after 60 s"


def test_a_group_without_any_result_stays_with_its_reason():
    reason = "needs 6003 inputs, limit 512"
    results = [result("tau-mdp", seed, "intractable", reason=reason) for seed in range(3)] + [result()]
    groups = condense(results)
    for table in (robustness(groups), cost(groups)):
        assert cell(table, "method", 1) == "tau-mdp"
        assert cell(table, "seeds", 1) == "0 of 3, 3 intractable"
        assert cell(table, "remarks", 1) == "intractable: needs 6003 inputs, limit 512"
    assert cell(robustness(groups), "mean robustness", 1) == "-"
    assert len(summary(groups, {})) == 2  # a finding about the method is no accident


def test_accidents_are_listed_one_by_one():
    results = [
        result(seed=0),
        result(seed=1, status="raised", reason="ValueError: two\nlines"),
        result(seed=2, status="killed", reason="killed by signal 9"),
        result("tau-mdp", status="intractable", reason="too many"),
    ]
    table = unfinished(condense(results))
    assert table.rows == (
        ("hold-disc/funnel/dqn/1", "quick", "raised", "ValueError: two lines"),
        ("hold-disc/funnel/dqn/2", "quick", "killed", "killed by signal 9"),
    )
    assert summary(condense(results), {})[2] == table


def test_cost():
    results = [
        result(training_cpu_seconds=10.0, training_wall_seconds=20.0, cpu_seconds=11.04, env_steps=240_000),
        result(
            seed=1, training_cpu_seconds=12.0, training_wall_seconds=30.0, cpu_seconds=13.0, env_steps=240_000, jobs=4
        ),
    ]
    table = cost(condense(results))
    assert cell(table, "training CPU [s]") == "11.0"
    assert cell(table, "CPU 95 % interval [s]") == "[10.0, 12.0]"
    assert cell(table, "training wall [s]") == "25.0"
    assert cell(table, "wall 95 % interval [s]") == "[20.0, 30.0]"
    assert cell(table, "cell CPU [s]") == "12.0"
    assert cell(table, "env steps") == "240000"
    assert cell(table, "reward [ns/step]") == "21.0"
    assert cell(table, "inputs added") == "0"
    assert cell(table, "jobs at a time") == "2, 4"


def test_controllers_have_a_row_a_task_and_stand_after_the_robustness():
    scores = {"hold-disc": score((0.1, 0.7)), "other": score((0.3, -0.2, -0.1, 0.2))}
    table = controllers(scores)
    assert table.rows == (("hold-disc", "0.400", "0.100", "100.0"), ("other", "0.050", "-0.200", "50.0"))
    groups = condense([result()])
    assert summary(groups, scores) == (robustness(groups), table, cost(groups))
    assert summary(groups, {}) == (robustness(groups), cost(groups))


def test_a_mean_of_minus_nothing_is_zero():
    assert cell(robustness(condense([result(robustness=(-0.0001,))])), "mean robustness") == "0.000"


def test_infinite_robustness_has_a_row():
    results = [result(seed=seed, robustness=(float("inf"),)) for seed in range(2)]
    table = robustness(condense(results))
    assert cell(table, "mean robustness") == "inf"
    assert cell(table, "IQM 95 % interval") == "-"


def test_cells_have_all_numbers_in_full():
    results = [result(robustness=(0.1, 0.2)), result(seed=1, status="raised", reason="ValueError: no")]
    table = report.cells(row for group in condense(results) for row in group.rows)
    assert cell(table, "robustness_mean") == repr((0.1 + 0.2) / 2)
    assert (cell(table, "robustness_min"), cell(table, "selected_steps"), cell(table, "seed")) == ("0.1", "2000", "0")
    assert (cell(table, "status", 1), cell(table, "reason", 1)) == ("raised", "ValueError: no")
    assert cell(table, "robustness_mean", 1) == ""


def test_no_value_of_a_single_start_is_kept():
    (group,) = condense(result(seed=seed, robustness=(0.5,) * 1000) for seed in range(20))
    assert len(group.rows) == 20
    assert max(len(pickle.dumps(row)) for row in group.rows) < 2000
