"""How the tables of a report and of searches show their numbers: decimals, units and short titles, column by column."""

from __future__ import annotations

import re
from dataclasses import replace

from helpers.made_subjects import still
from helpers.synthetic_results import by_hand, measurement, plan, result, score

from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.page import cells_shown
from stlbench.report.tables.across import aggregates_table, fields, improvement_table
from stlbench.report.tables.comparisons import compare, comparisons_table
from stlbench.report.tables.runs import overview, robustness_table, scores_and_cost, time_table
from stlbench.report.tables.sampled import groups_table, pairs_table
from stlbench.report.tables.table import Table, show
from stlbench.report.tables.yardsticks import Known, align, alignment_table, controllers_table
from stlbench.search.certify import Certificate, Claim
from stlbench.search.falsify import How, falsify
from stlbench.search.outputs import certificates, falsifications
from stlbench.statistics.intervals import Interval
from stlbench.task.file import BestKnown
from stlbench.tracks.references import References

THIRDS = (1 / 3, -1 / 3, 2 / 3, 2 / 3, 2 / 3, 2 / 3)  # mean 4 / 9, satisfied 5 / 6
RESULTS = [
    result(
        seed=seed,
        robustness=tuple(value + seed / 7 for value in THIRDS),
        final=tuple(value - seed / 10 for value in THIRDS),
        further={"tail": (1 / 7 + seed,)},
        training_cpu_seconds=100 / 7 + seed,
        training_wall_seconds=100 / 3 + seed,
        cpu_seconds=200 / 7 + seed,
        env_steps=1000 + seed,
        reward_nanoseconds=20 / 3 + seed,
        inputs_added=seed,
        selected_steps=500,
    )
    for seed in range(6)
]
OTHERS = [result("raw", seed, robustness=(value / 7,)) for seed, value in enumerate((1, 2, 4, 3, 5, 8))]
GROUPS = condense(RESULTS)
KNOWN = Known(by_hand(hold_disc=(2 / 3, 4 / 7)), {Choice("hold-disc"): 20 / 7})


def shown(table: Table, place: int = 0) -> dict[str, str]:
    """Header on a screen -> what stands below it, without what says which row it is, and without what is not known."""
    texts = {
        column.header: show(value, column.digits)
        for column, value in zip(table.columns, table.rows[place], strict=True)
        if column.right and value is not None
    }
    return {header: text for header, text in texts.items() if text}


def test_robustness() -> None:
    """Means over seeds 0 to 5: 4/9 + 2.5/7 = .80159; of the final policies 4/9 - .25 = .19444; of tail 2.64286.

    The first seed satisfies from 5 of 6 starts, as the second does; from the third seed on -1/3 + 2/7 stays below 0,
    and from the fourth on all satisfy: 3 of 6 learned. Of the finals none: four from 5 of 6, two from 4 of 6.
    """
    assert shown(robustness_table(GROUPS, KNOWN)) == {
        "starts": "6",
        "mean": "0.802",
        "median": "0.802",
        "median 95 % interval": "[0.444, 1.159]",
        "worst start": "-0.333",
        "satisfied [%]": "91.7",
        "learned": "3",
        "learned 95 % interval [%]": "[12, 88]",
        "of best": "0.28",
        "tail": "2.643",
        "final median": "0.194",
        "final median 95 % interval": "[-0.056, 0.444]",
        "final sat. [%]": "77.8",
        "final learned": "0",
        "final learned 95 % interval [%]": "[0, 46]",
    }


def test_overview() -> None:
    assert shown(overview(GROUPS, KNOWN)) == {
        "by hand": "0.619",
        "best known": "2.857",
        "funnel": "0.802 (3, 0 of 6)\n[0.444, 1.159]",
        "cell CPU [s]": "31",
    }


def test_time() -> None:
    """Means of x to x + 5, so x + 2.5, and 2.5706 standard errors of sqrt(3.5 / 6) around it."""
    assert shown(time_table(GROUPS)) == {
        "train wall [s]": "35.8",
        "wall 95 % interval [s]": "[33.9, 37.8]",
        "train CPU [s]": "16.8",
        "CPU 95 % interval [s]": "[14.8, 18.7]",
        "cell CPU [s]": "31.1",
        "env steps": "1002",
        "reward [ns/step]": "9.2",
        "inputs added": "2",
        "jobs at a time": "2",
    }


def test_cells() -> None:
    _, table = cells_shown(GROUPS)
    numbers = {"mean robustness": "0.444", "worst start": "-0.333", "satisfied [%]": "83.3", "cell CPU [s]": "28.6"}
    assert shown(table) == numbers
    scores, cost = scores_and_cost(measurement(THIRDS, training_cpu_seconds=100 / 7), outside=False)
    assert shown(scores) == {"mean": "0.444", "worst start": "-0.333", "satisfied [%]": "83.3", "starts": "6"}
    assert shown(cost, 3) == {"value": "14.2857"}
    ended = replace(score(THIRDS), ended_early=1 / 6)
    (scores,) = scores_and_cost(replace(measurement(), selected={"formula": ended}), outside=True)
    assert shown(scores)["ended early [%]"] == "16.7"
    measured = replace(measurement(), selected={"formula": ended})
    table = robustness_table(condense([replace(RESULTS[0], measurement=measured)]), KNOWN)
    assert shown(table)["ended early [%]"] == "16.7"


def test_comparisons() -> None:
    (row,) = [shown(comparisons_table(compare(condense([*RESULTS, *OTHERS]), KNOWN)))]
    assert row.keys() == {"difference", "95 % interval", "p alone", "p", "margin", "seeds needed"}
    assert (row["difference"], row["margin"]) == ("0.254", "0.143")
    assert (len(row["p alone"]), len(row["p"])) == (6, 6)
    assert row["seeds needed"].isdigit()
    assert row["95 % interval"].startswith("[-0.")


def test_controllers() -> None:
    reference = References(
        by_hand=score((2 / 3, -1 / 3, -2 / 3)),
        zero=score((-2 / 3, 1 / 7, 1 / 7)),
        constant=score((-1 / 3, -1 / 7, 1 / 7)),
        at_random=score((-4 / 3, -6 / 7, 1 / 7, 1, 1, 1)),
        best_known=BestKnown(robustness=10 / 7, upper_bound=20 / 7),
    )
    assert shown(controllers_table({"hold-disc": reference})) == {
        "mean": "-0.111",
        "worst start": "-0.667",
        "satisfied [%]": "33.3",
        "zero": "-0.127",
        "zero sat. [%]": "66.7",
        "constant": "-0.111",
        "constant sat. [%]": "33.3",
        "random": "0.159",
        "random sat. [%]": "66.7",
        "best known": "1.429",
        "upper bound": "2.857",
    }


def test_alignment() -> None:
    plans = [
        plan(value=50 / 7, robustness=(2 / 3, 1 / 7, -1 / 7)),
        plan(agent="planner[resolution=2]", robustness=(2 / 7,)),
        plan(value=1.0, agent="best", maximised="formula", robustness=(2 / 3, 4 / 7)),
    ]
    table = alignment_table(align(condense([*RESULTS, *plans]), {}))
    assert table.rows[1][-1] == "resolutions differ by 0.0635, more than 5 % of the best known"
    assert shown(table, 1) == {
        "best known": "0.619",
        "reward optimal": "0.222",
        "satisfied": "0.67",
        "grid value": "7.14286",
        "selected": "0.802",
        "final": "0.194",
        "seeds": "6",
        "reward loses": "0.397",
        "learner loses": "-0.579",
        "resolution": "1",
        "disagree": "0.063",
    }


TASKS = [f"{system}-{form}" for system in ("arm", "car") for form in "abcde"]
STANDARDS = {
    task: References(
        score((1.0,)), own_agent="dqn", at_random=score((-1.0,)), groups={"system": task[:3], "template": task[-1]}
    )
    for task in TASKS
}


def test_across_and_drawn_tasks() -> None:
    """Scores of good on the tasks: 2/3 by two seeds of three, and 1/3; of bad 1/7. So 5/9, and .413 more.

    Of the 30 runs of good the middle 16 are 13 of 2/3 and 3 of 1/3: .604.
    """
    results = [
        each
        for task in TASKS
        for seed in range(3)
        for each in (
            result("good", seed, task=task, robustness=(1 / 3 if seed else -1 / 3,)),
            result("bad", seed, task=task, robustness=(-5 / 7,)),
        )
    ]
    several = fields(condense(results), Known(STANDARDS))
    good = shown(aggregates_table(several), 1)
    assert (good["runs"], good["mean"], good["IQM"], good["rank"]) == ("30", "0.556", "0.604", "1.00")
    assert {len(good[f"{name} 95 % interval"]) for name in ("mean", "IQM")} == {len("[0.600, 0.600]")}
    assert good["rank 95 % interval"] == "[1.00, 1.00]"
    pair = shown(improvement_table(several))
    assert pair == {"probability": "0.00", "95 % interval": "[0.00, 0.00]"}
    groups, pairs = shown(groups_table(several), 1), shown(pairs_table(several))
    assert (groups["learned [%]"], groups["score"]) == ("67", "0.56")
    for found, title in ((groups, "learned"), (pairs, "learned more often")):
        ends = [value for name, value in found.items() if name.startswith("learned 95") and name.endswith("[%]")]
        assert re.fullmatch(r"\[-?\d+, -?\d+\]", ends[0]), title
        assert re.fullmatch(r"\[-?\d\.\d\d, -?\d\.\d\d\]", found["score 95 % interval"])
    assert (pairs["learned more often [%]"], pairs["higher score"]) == ("-67", "-0.41")


def test_searches() -> None:
    made = Certificate(still(), Claim(0.9), 7, 5, 1, Interval(1 / 3, 2 / 3), 20 / 3)
    assert shown(certificates([made])) == {
        **{"starts": "7", "satisfied": "5", "open": "1", "probability": "0.7143"},
        **{"interval": "[0.3333, 0.6667]", "CPU [s]": "6.7"},
    }
    found = falsify(still("G[0,8] a <= -2"), How(evaluations=5))
    table = falsifications([replace(found, first=3, evaluations=5, cpu_seconds=20 / 3)])
    numbers = {"evaluations": "5", "least": f"{found.worst.robustness:.6g}", "first": "3", "CPU [s]": "6.7"}
    assert shown(table) == numbers
