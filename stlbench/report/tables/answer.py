"""The answer that a screen shows after a run: what each method learned, and one line for each two of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from stlbench.registry.choices import Choice
from stlbench.report.tables.comparisons import Comparison
from stlbench.report.tables.controllers import Known
from stlbench.report.tables.rows import CONTESTANT, Group
from stlbench.report.tables.table import Column, Share, Table, Value
from stlbench.statistics.differences import Difference, Word
from stlbench.statistics.intervals import Interval, mean, median_interval

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
            lambda group: Share(sum(group.values("learned")), group.tried if group.done else 0, group.seeds.unfinished)
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
    by_method = dict[Choice, list[Group]]()
    for group in sorted(groups, key=lambda group: group.setting.method):
        by_method.setdefault(group.setting.method, []).append(group)

    def runs(own: list[Group]) -> str:
        learned, tried = sum(sum(group.values("learned")) for group in own), sum(group.tried for group in own)
        return f"{learned} of {tried}, {100 * learned / tried:.0f} %" if tried else "none"

    columns: dict[Column, Callable[[list[Group]], Value]] = {
        Column("method", right=False): lambda own: str(own[0].setting.method),
        Column("tasks"): lambda own: len({group.setting.task for group in own if group.done}),
        Column("learned in all seeds"): lambda own: sum(
            bool(group.done) and all(group.values("learned")) and group.tried == len(group.done) for group in own
        ),
        Column("runs that learned"): runs,
        Column("CPU", unit="s", digits=1): lambda own: mean([each.cpu_seconds for group in own for each in group.done]),
    }
    return Table.of("Results", by_method.values(), columns)


def verdicts(comparisons: Sequence[Comparison]) -> Iterator[str]:
    """A line for each two methods, first of those that differ: what was decided between them, on how many tasks."""
    if comparisons and all(min(len(each.one.done), len(each.other.done)) < 2 for each in comparisons):
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
    by_word = dict[Word, list[str]]()
    for each in found:
        by_word.setdefault(each.difference.word, []).append(str(each.one.setting.task))
    parts = []
    for word, said in _SAID.items():
        if tasks := by_word.get(word):
            names = dict.fromkeys(tasks)
            named = f" ({', '.join(names)})" if word in _DECIDED and len(names) <= _NAMED else ""
            parts.append(f"{said} {len(tasks)}{named}")
    return ", ".join(parts)
