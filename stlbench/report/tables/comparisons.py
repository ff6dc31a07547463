"""Methods that trained the same task alike: how far each two are apart, in a word which is better, and the answer
that a screen shows after a run.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from stlbench.records.identity import Track
from stlbench.registry.choices import Choice
from stlbench.report.tables.rows import CONTESTANT, Group, shared_columns
from stlbench.report.tables.table import Column, Share, Table, Value
from stlbench.report.tables.yardsticks import Known
from stlbench.statistics.differences import MOST_SEEDS, Difference, Pair, Word, differences
from stlbench.statistics.intervals import Interval, mean, median_interval

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
            learned=(one.learned, other.learned),
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
        where = ", track ".join((str(setting.task), *setting.other_track))
        lines.append(f"{seeds} seeds would be needed to tell {setting.method} from {other.method} on {where}.")
    left = len(by_seeds) - len(lines)
    return (*lines, *([f"The table of comparisons has {left} more such pairs."] if left else []))


MOST_ROWS = 24
"""More results on several tasks get a row for each method on the screen, not for each method on each task."""
_LINES = 10
"""Pairs of methods that have a line."""
_NAMED = 3
"""Tasks that a line names."""
_DECIDED = ("better", "worse", "mixed")
_SAID: Mapping[Word, str] = {
    "better": "better on",
    "worse": "worse on",
    "mixed": "mixed on",
    "no difference found": "no difference on",
    "cannot tell": "cannot tell on",
    "=": "paid the same on",
}


def answer_table(groups: Sequence[Group], known: Known, most: int = MOST_ROWS) -> Table:
    """The results of each method: a row for each method on each task, or for each method where rows are too many.

    The groups are of agents that learn, or of policies from outside. Times are CPU seconds of a cell.
    """
    if len(groups) > most and len({group.setting.task for group in groups}) > 1:
        return _over_tasks(groups)
    columns: dict[Column, Callable[[Group], Value]] = {
        **CONTESTANT,
        Column("learned", kind=Share): (
            lambda group: Share(sum(group.learned), group.tried if group.done else 0, group.seeds.unfinished)
        ),
        Column("robustness", digits=3): lambda group: group.median("robustness_mean"),
        Column("95 % interval", digits=3, kind=Interval, drop=1): (
            lambda group: median_interval(group.values("robustness_mean"))
        ),
        Column("best known", digits=3, drop=2): lambda group: known.best.get(group.setting.task),
        Column("CPU", unit="s", digits=1): lambda group: None if group.outside else group.mean("cpu_seconds"),
        Column("remarks", right=False, below=True): lambda group: group.remarks or None,
    }
    return Table.of("Results", sorted(groups, key=lambda group: (group.setting.task, group.outside)), columns)


def _over_tasks(groups: Sequence[Group]) -> Table:
    by_method = dict[tuple[Choice, bool], list[Group]]()
    for group in groups:
        by_method.setdefault((group.setting.method, group.outside), []).append(group)

    def runs(own: list[Group]) -> str:
        learned, tried = sum(sum(group.learned) for group in own), sum(group.tried for group in own)
        return f"{learned} of {tried}, {100 * learned / tried:.0f} %" if tried else "none"

    columns: dict[Column, Callable[[list[Group]], Value]] = {
        Column("method", right=False): (
            lambda own: f"{own[0].setting.method}{', from outside' if own[0].outside else ''}"
        ),
        Column("tasks"): lambda own: len({group.setting.task for group in own if group.done}),
        Column("learned in all seeds"): _learned_always,
        Column("runs that learned"): runs,
        Column("CPU", unit="s", digits=1): lambda own: mean(
            [each.cpu_seconds for group in own for each in group.done if not group.outside]
        ),
    }
    return Table.of("Results", (own for _, own in sorted(by_method.items())), columns)


def _learned_always(own: list[Group]) -> int:
    """The number of tasks that every run learned, whatever its agent, budget and track."""
    missed = {group.setting.task for group in own if sum(group.learned) < group.tried}
    return len({group.setting.task for group in own if group.done} - missed)


def verdicts(comparisons: Sequence[Comparison]) -> Iterator[str]:
    """A line for each two methods, first of those that differ: what was decided between them, on how many tasks."""
    if comparisons and all(max(len(each.one.done), len(each.other.done)) < 2 for each in comparisons):
        yield "One seed of each method says nothing about the methods; `--seeds 5` does."
        return
    pairs = dict[tuple[Choice, Choice], list[Comparison]]()
    for each in comparisons:
        pairs.setdefault((each.one.setting.method, each.other.setting.method), []).append(each)
    ordered = sorted(pairs.items(), key=lambda pair: -sum(each.difference.word in _DECIDED for each in pair[1]))
    for (one, other), found in ordered[:_LINES]:
        yield _of_one(one, other, found[0].difference) if len(found) == 1 else f"{one} against {other}: {_said(found)}"
    if len(ordered) > _LINES:
        yield f"{len(ordered) - _LINES} more pairs of methods: --explain"


def _of_one(one: Choice, other: Choice, difference: Difference) -> str:
    match difference.word:
        case "better" | "worse":
            return f"{one} is {difference.word} than {other}"
        case "=":
            return f"{one} and {other} pay the same"
        case "mixed":
            return f"{one} and {other} differ, and the respects that decide disagree"
        case "no difference found":
            return f"no difference found between {one} and {other}"
    return f"cannot tell {one} from {other}{difference.needed and f'; {difference.needed}'}"


def _said(found: Sequence[Comparison]) -> str:
    by_word = dict[Word, dict[str, None]]()
    for each in found:
        by_word.setdefault(each.difference.word, {})[str(each.one.setting.task)] = None
    parts = []
    for word, said in _SAID.items():
        if tasks := by_word.get(word):
            named = f" ({', '.join(tasks)})" if word in _DECIDED and len(tasks) <= _NAMED else ""
            parts.append(f"{said} {len(tasks)}{named}")
    return ", ".join(parts)
