"""Methods that trained the same task alike: how far each two are apart, and in a word which is better."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

from stlbench.records.identity import Track
from stlbench.registry.choices import Choice
from stlbench.report.tables.controllers import Known
from stlbench.report.tables.rows import Group, shared_columns
from stlbench.report.tables.table import Column, Table
from stlbench.statistics.differences import MOST_SEEDS, Difference, Pair, differences
from stlbench.statistics.intervals import Interval

Contest = tuple[Group, ...]  # groups that differ in the method alone, in the order of their names
MATTERS = 0.05
"""Share of the best known robustness. A smaller difference does not matter."""
_ADVICE = 5  # lines of advice at most
_MARKS = {
    "*": "the task is outside the form that the method's source was published for: there it is our extension.",
    "=": "pays the same as another method there, up to a constant: a difference between the two is chance.",
    "~": "pays the same as another method there, up to a function of time: the same policies are best by both, and "
    "they are learned differently.",
}


def contests(groups: Iterable[Group]) -> dict[tuple[Choice, Choice, str, Track], Contest]:
    by_key = dict[tuple[Choice, Choice, str, Track], list[Group]]()
    for group in groups:
        setting = group.setting
        by_key.setdefault((setting.task, setting.agent, setting.budget, setting.track), []).append(group)
    return {key: tuple(sorted(members, key=lambda group: group.setting.method)) for key, members in by_key.items()}


def mark(group: Group, contest: Contest, known: Known) -> str:
    """The marks that a reader has to know of a group: some of the characters *, = and ~, or none."""
    likenesses = {known.likeness(group.setting, other.setting) for other in contest if other is not group}
    return "".join(["*" if group.extension else "", *sorted(each for each in likenesses if each)])


def mark_notes(marks: Iterable[str]) -> tuple[str, ...]:
    there = set("".join(marks))
    return tuple(f"Marked {character}: {note}" for character, note in _MARKS.items() if character in there)


@dataclass(frozen=True)
class Comparison:
    """Two groups that differ in the method alone."""

    one: Group
    other: Group
    difference: Difference  # of the robustness of the selected policies, the one less the other
    margin: float | None  # a smaller difference does not matter; None if nobody knows what is possible


def compare(groups: Sequence[Group], known: Known) -> tuple[Comparison, ...]:
    """Compare each two methods that trained a task alike, with one correction for all.

    The groups are of agents that learn. Methods without a result on a task are not compared there.
    """
    couples = [
        (one, other)
        for contest in contests(groups).values()
        for one, other in combinations([group for group in contest if group.done], 2)
    ]
    pairs = list[Pair]()
    for one, other in couples:
        level = known.level(one.setting.task)
        pair = Pair(
            one=one.values("robustness_mean"),
            other=other.values("robustness_mean"),
            margin=None if level is None else MATTERS * abs(level),
            alike=known.likeness(one.setting, other.setting) == "=",
            learned=(one.values("learned"), other.values("learned")),
        )
        pairs.append(pair)
    compared = zip(couples, pairs, differences(pairs), strict=True)
    return tuple(Comparison(one, other, difference, pair.margin) for (one, other), pair, difference in compared)


def comparisons_table(comparisons: Sequence[Comparison]) -> Table:
    tested = sum(each.difference.chance is not None for each in comparisons)
    mixed = any(each.difference.word == "mixed" for each in comparisons)
    notes = (
        "Difference of the selected policies' robustness, mean over seeds; its interval is Welch's, of the pair alone. "
        "Verdict: of the method against the other, by one exact test of means, ranks and seeds that learned. "
        f"p: after Holm's correction for all pairs that are tested here, {tested} of them; better or worse below 0.05. "
        "Decided by: the respects in which the two are that far apart.",
        f"No difference found: the interval lies within the margin, {100 * MATTERS:.0f} % of the best known "
        "robustness, or of that by hand. Cannot tell: with the seeds needed of each method a verdict would come out in "
        f"80 % of cases, if all is as it looks; {MOST_SEEDS + 1} stands for more than {MOST_SEEDS}. =: both pay the "
        "same up to a constant.",
        *(["Mixed: the two differ, and the respects that decide disagree on which is better."] if mixed else []),
    )
    return Table.of(
        "Comparisons",
        comparisons,
        {
            **shared_columns(lambda each: each.one),
            Column("method", right=False): lambda each: str(each.one.setting.method),
            Column("other", right=False): lambda each: str(each.other.setting.method),
            Column("difference", digits=3): lambda each: each.difference.value,
            Column("difference 95 % interval", "95 % interval", digits=3, kind=Interval, drop=1): (
                lambda each: each.difference.interval
            ),
            Column("p alone", digits=4, drop=4): lambda each: each.difference.alone,
            Column("p", digits=4, drop=2): lambda each: each.difference.chance,
            Column("margin", digits=3, drop=3): lambda each: each.margin,
            Column("verdict", right=False): lambda each: each.difference.word,
            Column("seeds needed", digits=0): lambda each: each.difference.seeds,
            Column("decided by", right=False, drop=1): lambda each: ", ".join(each.difference.decided) or None,
        },
        notes,
    )


def advice(comparisons: Iterable[Comparison]) -> tuple[str, ...]:
    """How many seeds would decide the pairs that are open, first those that need the fewest."""
    by_seeds = [(seeds, each) for each in comparisons if (seeds := each.difference.seeds) and seeds <= MOST_SEEDS]
    by_seeds.sort(key=lambda item: item[0])
    lines = list[str]()
    for seeds, each in by_seeds[:_ADVICE]:
        setting, other = each.one.setting, each.other.setting
        where = f"{setting.task}" if setting.track == "shared" else f"{setting.task}, track {setting.track}"
        lines.append(f"{seeds} seeds would be needed to tell {setting.method} from {other.method} on {where}.")
    left = len(by_seeds) - len(lines)
    return (*lines, *([f"The table of comparisons has {left} more such pairs."] if left else []))
