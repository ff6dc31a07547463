"""The tables' content, from made-up results with numbers that can be checked by hand."""

from __future__ import annotations

import pickle
from dataclasses import replace

import pytest
from helpers.reports import summary
from helpers.synthetic_results import alike, by_hand, plan, result, score
from scipy import stats

from stlbench.records.result import MAIN, RANDOM, Score, Summary
from stlbench.registry.choices import Choice
from stlbench.report import condense, only
from stlbench.report.page import cells_shown
from stlbench.report.tables.runs import cells_table, robustness_table, scores_table, time_table, unfinished_table
from stlbench.report.tables.table import FirstFailed, Seeds, to_csv
from stlbench.report.tables.yardsticks import Known, controllers_table
from stlbench.tracks.references import References


def cell(table, column, row=0):
    return table.rows[row][[entry.heading for entry in table.columns].index(column)]


def test_robustness_is_averaged_over_starts_and_then_over_seeds():
    results = [
        result(seed=0, robustness=(0.1, 0.3)),
        result(seed=1, robustness=(0.5, 0.9)),
        result(seed=2, robustness=(-0.4,)),
    ]
    table = robustness_table(condense(results), Known())
    assert cell(table, "mean robustness") == pytest.approx((0.2 + 0.7 - 0.4) / 3)
    assert cell(table, "median robustness") == pytest.approx(0.2)
    assert cell(table, "median 95 % interval") is None
    assert cell(table, "worst start") == -0.4
    assert cell(table, "satisfied [%]") == pytest.approx(200 / 3)
    assert cell(table, "seeds") == Seeds(3, 3)


def test_early_ends_have_a_column_where_there_are_any():
    """Half of the starts of one seed, none of another; of a third, of an older record, nobody knows."""
    ended = [result(seed=seed, robustness=(0.3, 0.4)) for seed in range(3)]
    shares = dict(enumerate((0.5, 0.0)))
    early = [with_ends(each, shares.get(seed)) for seed, each in enumerate(ended)]
    table = robustness_table(condense(early), Known())
    assert cell(table, "ended early [%]") == 25
    assert any("under `hold` the last sample stays" in note for note in table.notes)
    assert "ended early [%]" not in [column.heading for column in robustness_table(condense(ended), Known()).columns]
    rows = condense(early)[0].rows
    assert [cell(cells_table(rows), "ended_early", row) for row in range(3)] == [0.5, 0.0, None]
    _, page = cells_shown(condense(early))
    place = [column.header for column in page.columns].index("ended early [%]")
    assert [row[place] for row in page.rows] == [50, 0, None]
    measured = early[0].measurement
    assert cell(scores_table({"": measured.selected}), "ended early [%]") == 50


def with_ends(of, share):
    scores = {MAIN: replace(of.measurement.selected[MAIN], ended_early=share)}
    return replace(of, measurement=replace(of.measurement, selected=scores))


def test_selected_and_final_policies_have_intervals_and_learned_seeds_side_by_side():
    starts = {True: (0.5,), False: (-0.5,)}
    learned = [(True, True)] * 7 + [(True, False)] * 2 + [(False, False)]
    results = [result(seed=i, robustness=starts[a], final=starts[b]) for i, (a, b) in enumerate(learned)]
    table = robustness_table(condense([*results, result("raw", seed=0)]), Known())
    assert (cell(table, "learned"), cell(table, "final learned")) == (9, 7)
    exact = stats.binomtest(9, 10).proportion_ci()
    assert cell(table, "learned 95 % interval [%]") == pytest.approx((100 * exact.low, 100 * exact.high))
    exact = stats.binomtest(7, 10).proportion_ci()
    assert cell(table, "final learned 95 % interval [%]") == pytest.approx((100 * exact.low, 100 * exact.high))
    assert (cell(table, "median 95 % interval"), cell(table, "final median 95 % interval")) == ((0.5, 0.5), (-0.5, 0.5))
    assert cell(table, "final median 95 % interval", 1) is None


def test_numbers_come_from_the_random_starts_where_there_are_some():
    many = Score((), (), {"G[0,1] a > 0": 60}, Summary(0.25, -0.75, 0.94, 1000))
    one = result(robustness=(0.5,) * 64)
    measured = replace(
        one.measurement, selected=dict(one.measurement.selected) | {RANDOM: many}, final=one.measurement.final
    )
    table = robustness_table(condense([replace(one, measurement=measured), result("raw")]), Known())
    names = ("starts", "mean robustness", "worst start", "satisfied [%]", "learned", "final satisfied [%]")
    assert [cell(table, name) for name in names] == [1000, 0.25, -0.75, 94, 0, 100]
    assert cell(table, "failed first") == FirstFailed("G[0,1] a > 0", 60, 60)
    assert cell(table, "starts", 1) == 2
    assert RANDOM not in [column.title for column in table.columns]
    cells = cells_table(condense([replace(one, measurement=measured)])[0].rows)
    exact = stats.binomtest(940, 1000).proportion_ci()
    assert cell(cells, "starts") == 1000
    assert cell(cells, "satisfaction 95 % interval") == pytest.approx((exact.low, exact.high))


def test_marks_are_a_column_where_there_are_any():
    groups = condense([result("flag", extension="late windows"), result("funnel"), result("raw")])
    table = robustness_table(groups, Known({"hold-disc": References(alike=alike("hold-disc", funnel_raw="="))}, {}))
    assert [cell(table, "mark", row) for row in range(3)] == ["*", "=", "="]
    assert [note[:8] for note in table.notes[-2:]] == ["Marked *", "Marked ="]
    assert "mark" not in [column.title for column in robustness_table(groups[1:], Known()).columns]


def test_what_failed_first_is_counted_and_each_further_protocol_is_a_column():
    results = [
        result(seed=0, first_failed={"G[0,1] a > 0": 3, "F[0,2] b > 0": 2}, further={"paper": (0.9, 0.7)}),
        result(seed=1, first_failed={"F[0,2] b > 0": 3}, further={"paper": (0.6,)}),
        result("flag"),
    ]
    table = robustness_table(condense(results), Known())
    assert (cell(table, "failed first", 0), cell(table, "paper", 0)) == (None, None)
    assert cell(table, "paper", 1) == pytest.approx(0.7)
    assert cell(table, "failed first", 1) == FirstFailed("F[0,2] b > 0", 5, 8)


def test_groups_are_of_task_method_agent_and_budget_and_can_be_narrowed_down():
    results = [result(), result(task="other"), result("flag"), result(agent="sb3-dqn"), result(budget="paper")]
    table = robustness_table(condense(results), Known())
    assert len(table.rows) == 5
    assert all(cell(table, "seeds", row) == Seeds(1, 1) for row in range(5))
    more = [*results, result(seed=1)]
    (group,) = only(condense(more), {more[-1].id})
    assert [row.id for row in group.rows] == [more[-1].id]


def test_planned_cells_without_a_result_are_rows_and_count_as_seeds():
    ids = [result(seed=seed).id for seed in (3, 4)] + [result("raw").id]
    table = robustness_table(condense([result(seed=seed) for seed in range(3)], ids), Known())
    assert [cell(table, "seeds", row) for row in (0, 1)] == [Seeds(3, 5, "2 not run"), Seeds(0, 1, "1 not run")]
    assert cell(table, "mean robustness") == pytest.approx(0.35)
    assert (cell(table, "mean robustness", 1), cell(table, "remarks", 1)) == (None, None)


def test_a_group_without_any_result_stays_with_its_reason():
    reason = "needs 6003 inputs, limit 512"
    results = [result("tau-mdp", seed, "intractable", reason=reason) for seed in range(3)] + [result()]
    groups = condense(results)
    for table in (robustness_table(groups, Known()), time_table(groups)):
        assert cell(table, "method", 1) == "tau-mdp"
        assert cell(table, "seeds", 1) == Seeds(0, 3, "3 intractable")
        assert cell(table, "remarks", 1) == "intractable: needs 6003 inputs, limit 512"
    assert cell(robustness_table(groups, Known()), "mean robustness", 1) is None
    assert len(summary(groups, {})) == 2  # a finding about the method is no accident


def test_accidents_are_listed_one_by_one():
    results = [
        result(seed=0),
        result(seed=1, status="raised", reason="ValueError: two\nlines"),
        result(seed=2, status="killed", reason="killed by signal 9"),
        result("tau-mdp", status="intractable", reason="too many"),
    ]
    table = unfinished_table(condense(results))
    assert table.rows == (
        ("hold-disc/funnel/dqn/1", "quick", "raised", "ValueError: two lines"),
        ("hold-disc/funnel/dqn/2", "quick", "killed", "killed by signal 9"),
    )
    assert summary(condense(results), {})[2] == table


def test_controllers_have_one_row_per_task_and_stand_after_the_robustness():
    scores = by_hand(hold_disc=(0.1, 0.7), other=(0.3, -0.2, -0.1, 0.2))
    assert [row[0] for row in controllers_table(scores).rows] == ["hold-disc", "other"]
    groups = condense([result()])
    own = controllers_table(by_hand(hold_disc=(0.1, 0.7)))
    assert summary(groups, scores) == (robustness_table(groups, Known()), own, time_table(groups))
    assert summary(groups, {}) == (robustness_table(groups, Known()), time_table(groups))


def test_baselines_stand_beside_the_controller_and_a_trivial_task_is_marked():
    known = by_hand(hold_disc=(0.25, 0.75))
    baselines = {"zero": score((0.5, 0.25)), "constant": score((0.5, 0.75)), "trivial": True}
    known["hold-disc"] = replace(known["hold-disc"], **baselines)
    known["other"] = References(zero=score((-1.0, 1.0)), constant=score((-0.5, 1.0)))
    known["third"] = References(own_agent="dqn")
    table = controllers_table(known)
    assert [row[4:] for row in table.rows] == [(0.375, 100.0, 0.625, 100.0, "trivial"), (0.0, 50.0, 0.25, 50.0, None)]
    assert any("at least 95 %" in note for note in table.notes)
    assert controllers_table({"third": known["third"]}).rows == ()
    del known["hold-disc"]
    assert "trivial" not in [column.heading for column in controllers_table(known).columns]


SHARE = "share of best known (median, both above 0)"


def test_robustness_is_a_share_of_the_best_known_where_both_are_above_zero():
    tasks = {"one": (0.1, 0.3), "two": (-0.1,), "three": (0.2,), "four": (0.2,)}
    groups = condense(result(task=task, robustness=robustness) for task, robustness in tasks.items())
    table = robustness_table(groups, Known({}, {Choice("one"): 0.4, Choice("two"): 0.4, Choice("three"): -0.1}))
    shares = {row: cell(table, SHARE, i) for i, row in enumerate(["four", "one", "three", "two"])}
    assert shares == {"four": None, "one": pytest.approx(0.5), "three": None, "two": None}
    assert SHARE not in [column.heading for column in robustness_table(groups, Known()).columns]


def test_what_was_planned_is_in_the_table_of_alignment_alone():
    learned, other = [result(seed=seed) for seed in range(2)], result(task="other")
    planned = [plan(), plan(task="third"), plan(maximised="formula", agent="best")]
    titles = {table.title: table for table in summary(condense([*learned, other, *planned]), {})}
    assert list(titles) == ["Overview", "Robustness", "Alignment", "Time"]
    plain = summary(condense([*learned, other]), {})
    assert [row[-2:] for row in titles["Overview"].rows] == [row[-2:] for row in plain[0].rows]
    assert [cell(titles["Overview"], "best known", row) for row in (0, 1)] == [0.35, None]
    assert titles["Time"] == plain[2]
    assert [row[:-1] for row in titles["Alignment"].rows] == [
        ("hold-disc", "(formula)", "recipe", 0.35, None, 1.0, 1.0, *(None,) * 5, 1.0, None),
        ("hold-disc", "funnel", "recipe", 0.35, 0.35, 1.0, 1.0, 0.35, 0.35, 2, 0.0, 0.0, 1.0, None),
        ("third", "funnel", "recipe", None, 0.35, 1.0, 1.0, *(None,) * 5, 1.0, None),
    ]


def test_cells_say_what_was_planned_only_where_something_was():
    groups = condense([result(), plan("raw", value=-2.5), plan("slow", status="timeout", reason="late")])
    table = cells_table(row for group in groups for row in group.rows)
    assert [column.title for column in table.columns[-2:]] == ["maximised", "grid_value"]
    assert [row[-2:] for row in table.rows] == [(None, None), ("reward", -2.5), (None, None)]
    assert "maximised" not in to_csv(cells_table(condense([result()])[0].rows))


def test_no_value_of_a_single_start_is_kept():
    (group,) = condense(result(seed=seed, robustness=(0.5,) * 1000) for seed in range(20))
    assert len(group.rows) == 20
    assert max(len(pickle.dumps(row)) for row in group.rows) < 2000
