"""Methods that trained the same task alike: how far each two are apart, and in a word which is better."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

from stlbench.records.identity import Setting, Track
from stlbench.registry.choices import Choice
from stlbench.report.statistics.differences import MOST_SEEDS, Difference, Pair, differences
from stlbench.report.statistics.intervals import Interval
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Column, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

Contest = tuple[Group, ...]
"""Groups that differ in the method alone, in the order of their names."""
Key = tuple[Choice, Choice, str, Track]
"""Task, agent, budget and track."""

_MARKS = {
    "*": "the task is outside the form that the method's source was published for: there it is our extension.",
    "=": "pays the same as another method there, up to a constant: a difference between the two is chance.",
    "~": "pays the same as another method there, up to a function of time: the same policies are best by both, and "
    "they are learned differently.",
}


def contests(groups: Iterable[Group]) -> dict[Key, Contest]:
    """The groups by what they have in common, in the order given."""
    by_key = dict[Key, list[Group]]()
    for group in groups:
        by_key.setdefault(_key(group.setting), []).append(group)
    return {key: tuple(sorted(members, key=lambda group: group.setting.method)) for key, members in by_key.items()}


def _key(setting: Setting) -> Key:
    return setting.task, setting.agent, setting.budget, setting.track


def mark(group: Group, contest: Sequence[Group], standards: Mapping[str, Standard]) -> str:
    """What a reader has to know of a group: some of the characters *, = and ~; empty where there is nothing."""
    standard = standards.get(group.setting.task.name)
    rivals = [other.setting for other in contest if other is not group]
    likenesses = {standard.likeness(group.setting, other) for other in rivals} if standard else set()
    return "".join(["*" if group.extension else "", *sorted(each for each in likenesses if each)])


def mark_notes(marks: Iterable[str]) -> tuple[str, ...]:
    """What the marks mean, of those that there are."""
    there = set("".join(marks))
    return tuple(f"Marked {character}: {note}" for character, note in _MARKS.items() if character in there)


def level(task: Choice, standards: Mapping[str, Standard], best: Mapping[Choice, float]) -> float | None:
    """The best known robustness of a task, or what its controller by hand gets where the best is not known."""
    standard = standards.get(task.name)
    by_hand = standard.by_hand.mean if standard and standard.by_hand else None
    return best.get(task, by_hand)


MATTERS = 0.05
"""Share of the best known robustness up to which a difference is none that matters."""
_ADVICE = 5
"""Lines of advice at most."""


@dataclass(frozen=True)
class Comparison:
    """Two groups that differ in the method alone."""

    one: Group
    other: Group
    difference: Difference
    """Of the robustness of the selected policies, the one less the other."""
    margin: float | None
    """Differences up to it do not matter; None where nobody knows what is possible."""


def compare(
    groups: Sequence[Group], standards: Mapping[str, Standard], best: Mapping[Choice, float]
) -> tuple[Comparison, ...]:
    """Compare each two methods that trained a task alike, with one correction for all. Methods without a result on a
    task are not compared there.

    Args:
        groups: of agents that learn.
        standards: of their tasks.
        best: the best known robustness of their tasks, where it is known.
    """
    couples = [
        (one, other)
        for contest in contests(groups).values()
        for one, other in combinations([group for group in contest if group.done], 2)
    ]
    pairs = [_pair(one, other, standards, best) for one, other in couples]
    compared = zip(couples, pairs, differences(pairs), strict=True)
    return tuple(Comparison(one, other, difference, pair.margin) for (one, other), pair, difference in compared)


def _pair(one: Group, other: Group, standards: Mapping[str, Standard], best: Mapping[Choice, float]) -> Pair:
    task = one.setting.task
    standard, reached = standards.get(task.name), level(task, standards, best)
    alike = standard is not None and standard.likeness(one.setting, other.setting) == "="
    margin = None if reached is None else MATTERS * abs(reached)
    first, second = (group.values(lambda numbers: numbers.robustness_mean) for group in (one, other))
    learned = [numbers.learned for numbers in one.done], [numbers.learned for numbers in other.done]
    return Pair(first, second, margin, alike, learned)


def comparisons_table(comparisons: Iterable[Comparison]) -> Table:
    """One row per pair of methods on a task."""
    listed = list(comparisons)
    columns = (
        Column("task", right=False, shared=True),
        Column("agent", right=False, shared=True),
        Column("budget", right=False, shared=True),
        Column("track", right=False, shared=True),
        Column("method", right=False),
        Column("other", right=False),
        Column("difference", digits=3),
        Column("difference 95 % interval", "95 % interval", digits=3, kind=Interval, drop=1),
        Column("p alone", digits=4, drop=4),
        Column("p", digits=4, drop=2),
        Column("margin", digits=3, drop=3),
        Column("verdict", right=False),
        Column("decided by", right=False, drop=1),
    )
    return Table("Comparisons", columns, tuple(map(_row, listed)), _notes(listed))


def _row(comparison: Comparison) -> tuple[Value, ...]:
    setting, difference = comparison.one.setting, comparison.difference
    return (
        *(str(setting.task), str(setting.agent), setting.budget, setting.track),
        *(str(setting.method), str(comparison.other.setting.method)),
        *(
            difference.value,
            difference.interval,
            difference.alone,
            difference.chance,
            comparison.margin,
            str(difference),
        ),
        ", ".join(difference.decided) or None,
    )


def _notes(comparisons: Sequence[Comparison]) -> tuple[str, ...]:
    tested = sum(comparison.difference.chance is not None for comparison in comparisons)
    mixed = any(comparison.difference.word == "mixed" for comparison in comparisons)
    return (
        "Difference of the selected policies' robustness, mean over seeds; its interval is Welch's, of the pair alone. "
        "Verdict: of the method against the other, by one exact test of means, ranks and seeds that learned. "
        f"p: after Holm's correction for all pairs that are tested here, {tested} of them; better or worse below 0.05. "
        "Decided by: the respects in which the two are that far apart.",
        f"No difference found: the interval lies within the margin, {100 * MATTERS:.0f} % of the best known "
        "robustness, or of that by hand. Cannot tell: with that many seeds of each method a verdict would come out in "
        "80 % of cases, if all is as it looks. =: both pay the same up to a constant.",
        *(["Mixed: the two differ, and the respects that decide disagree on which is better."] if mixed else []),
    )


def advice(comparisons: Iterable[Comparison]) -> tuple[str, ...]:
    """How many seeds would tell methods apart that cannot be told apart yet; first where the fewest would."""
    open_ones = [each for each in comparisons if each.difference.seeds and each.difference.seeds <= MOST_SEEDS]
    open_ones.sort(key=lambda each: each.difference.seeds or 0)
    lines = [_advice(each) for each in open_ones[:_ADVICE]]
    left = len(open_ones) - len(lines)
    return (*lines, *([f"The table of comparisons has {left} more such pairs."] if left else []))


def _advice(comparison: Comparison) -> str:
    setting, other = comparison.one.setting, comparison.other.setting
    where = f"{setting.task}" if setting.track == "shared" else f"{setting.task}, track {setting.track}"
    return (
        f"{comparison.difference.seeds} seeds would be needed to tell {setting.method} from {other.method} on {where}."
    )
