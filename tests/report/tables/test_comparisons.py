"""Which methods are compared, and what is said of them."""

from __future__ import annotations

import csv
import io

import pytest
from helpers.synthetic_results import alike, by_hand, result
from scipy import stats

from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables.comparisons import advice, compare, comparisons_table
from stlbench.report.tables.table import to_csv
from stlbench.report.tables.yardsticks import Known
from stlbench.tracks.references import References

BEST = {Choice("hold-disc"): 0.4}


def seeds(method, values, **words):
    return [result(method, seed, robustness=(value,), **words) for seed, value in enumerate(values)]


RESULTS = [
    *seeds("flag", (0.1, 0.11, 0.12, 0.13, 0.14)),
    *seeds("funnel", (0.391, 0.392, 0.393, 0.394, 0.395)),
    *seeds("raw", (0.391, 0.392, 0.394, 0.393, 0.395)),
    *seeds("noisy", (0.3, 0.4, 0.45, 0.2, 0.5)),
    result("tau-mdp", status="intractable", reason="too many"),
]


def words(comparisons):
    return {
        (str(each.one.setting.method), str(each.other.setting.method)): str(each.difference) for each in comparisons
    }


def test_each_two_methods_with_a_result_are_compared():
    found = words(compare(condense(RESULTS), Known({}, BEST)))
    assert {pair: text for pair, text in found.items() if "noisy" not in pair} == {
        ("flag", "funnel"): "worse",
        ("flag", "raw"): "worse",
        ("funnel", "raw"): "no difference found",
    }
    assert found["flag", "noisy"] == "worse"
    assert found["funnel", "noisy"].startswith("cannot tell, ")
    assert len(found) == 6


def test_the_margin_is_a_share_of_the_best_known_or_of_what_is_reached_by_hand():
    groups = condense(RESULTS)
    hand = by_hand(hold_disc=(0.2,))
    found = [compare(groups, Known(*known))[0].margin for known in ((hand, BEST), (hand, {}), ({}, {}))]
    assert found == [pytest.approx(0.02), pytest.approx(0.01), None]


def test_methods_that_pay_the_same_are_not_tested_but_for_a_function_of_time():
    groups = condense(RESULTS)
    same = {"hold-disc": References(alike=alike("hold-disc", flag_funnel="=", flag_raw="~"))}
    found = compare(groups, Known(same, BEST))
    assert words(found)["flag", "funnel"] == "="
    assert words(found)["flag", "raw"] == "worse"
    tested = [each.difference.chance for each in found if each.difference.chance is not None]
    assert len(tested) == 5


def test_tasks_agents_budgets_and_tracks_are_not_mixed_and_one_correction_is_for_all():
    other = [result("raw", seed, robustness=(0.1 * seed,), task="other") for seed in range(3)]
    apart = [
        result("raw", agent="sb3-dqn"),
        result("raw", budget="paper"),
        *seeds("raw", (0.5, 0.6), track="plain"),
        *seeds("flag", (0.1, 0.3), track="plain"),
    ]
    few, many = compare(condense(RESULTS), Known()), compare(condense([*RESULTS, *other, *apart]), Known())
    assert {each.one.setting.track for each in many} == {"shared", "plain"}
    assert len(many) == len(few) + 1
    by_pair = {(each.one.setting, each.other.setting): each.difference for each in many}
    assert any(each.difference.chance < by_pair[each.one.setting, each.other.setting].chance for each in few)


def test_the_table_has_the_interval_of_scipys_test_and_both_p_values():
    groups = condense(seeds("funnel", (0.1, 0.2, 0.4)) + seeds("raw", (0.1, 0.15, 0.3, 0.2)))
    text = to_csv(comparisons_table(compare(groups, Known({}, BEST))))
    (row,) = csv.DictReader(io.StringIO(text))
    expected = stats.ttest_ind((0.1, 0.2, 0.4), (0.1, 0.15, 0.3, 0.2), equal_var=False)
    assert float(row["p alone"]) == float(row["p"]) > 0.05
    assert row["decided by"] == ""
    ends = tuple(float(row[f"difference 95 % interval {end}"]) for end in ("low", "high"))
    assert ends == pytest.approx(tuple(expected.confidence_interval()))
    assert row["verdict"] == "cannot tell"
    assert int(row["seeds needed"]) > 4
    assert float(row["margin"]) == pytest.approx(0.02)


def test_the_table_says_in_which_respects_a_pair_is_apart():
    """All seeds satisfy with one method and none with the other, so that all three respects decide."""
    one, other = [0.1 * seed + 0.1 for seed in range(6)], [-0.1 * seed - 0.1 for seed in range(6)]
    groups = condense(seeds("funnel", one) + seeds("raw", other))
    (row,) = csv.DictReader(io.StringIO(to_csv(comparisons_table(compare(groups, Known({}, BEST))))))
    assert (row["verdict"], row["decided by"]) == ("better", "mean, rank, learned")
    assert float(row["p"]) == pytest.approx(2 / 924)  # one of the 12! / (6! 6!) deals, and its mirror


def test_the_fewest_seeds_are_advised_first_and_the_rest_is_counted():
    spread = {f"m{i}": 0.3 + 0.02 * i for i in range(5)}
    results = [
        each
        for method, centre in spread.items()
        for each in seeds(method, [centre + step for step in (-0.1, -0.05, 0, 0.05, 0.1)])
    ]
    lines = advice(compare(condense(results), Known()))
    counts = [int(line.split()[0]) for line in lines[:-1]]
    assert len(counts) == 5
    assert counts == sorted(counts)
    assert lines[0] == f"{counts[0]} seeds would be needed to tell m0 from m4 on hold-disc."
    assert lines[-1].startswith("The table of comparisons has ")
    assert advice(compare(condense(RESULTS[:15]), Known({}, BEST))) == ()


def test_the_note_counts_the_pairs_that_are_tested():
    """Of six pairs one pays the same."""
    same = Known({"hold-disc": References(alike=alike("hold-disc", flag_funnel="="))}, BEST)
    table = comparisons_table(compare(condense(RESULTS), same))
    assert "for all pairs that are tested here, 5 of them;" in table.notes[0]
    assert not any(note.startswith("Mixed") for note in table.notes)


def test_one_method_is_compared_with_none():
    assert comparisons_table(compare(condense(seeds("raw", (0.1, 0.2))), Known())).rows == ()
