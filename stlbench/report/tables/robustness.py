"""How well trained policies satisfy the formula: all methods at a glance, and one row for each group."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

from stlbench.records.result import LEARNED
from stlbench.registry.choices import Choice
from stlbench.report.tables.cells import ENDED_EARLY, percent
from stlbench.report.tables.comparisons import Contest, contests, mark, mark_notes
from stlbench.report.tables.controllers import Known
from stlbench.report.tables.rows import SETTING, Group, shared_columns
from stlbench.report.tables.table import Column, FirstFailed, Learned, Table, Value
from stlbench.statistics.intervals import FEWEST, Interval, mean, median, median_interval, share_interval


def overview(groups: Sequence[Group], known: Known, advice: Iterable[str] = ()) -> Table:
    """The median robustness of every method on every task with its interval, and on how many seeds it was learned.

    One row for each task, agent, budget and track of the groups. `advice` are lines for the notes.
    """
    rows = contests(groups).values()
    columns: dict[Column, Callable[[Contest], Value]] = shared_columns(lambda contest: contest[0])
    if any(standard.by_hand for standard in known.standards.values()):
        columns[Column("by hand", digits=3)] = lambda contest: known.by_hand(contest[0].setting.task)
    if known.best:
        columns[Column("best known", digits=3)] = lambda contest: known.best.get(contest[0].setting.task)
    for method in sorted({group.setting.method for group in groups}):
        columns[Column(str(method), digits=3, kind=Learned)] = partial(_learned_by, method, known)
    columns[Column("cell CPU", unit="s", digits=0, drop=1)] = lambda contest: mean(
        [numbers.cpu_seconds for group in contest for numbers in group.done]
    )
    note = (
        "Robustness of the selected policies: the median seed, with its 95 % interval, of five seeds or more. In "
        "parentheses the seeds that learned the task, with the selected policy and with the final one: the policy "
        f"satisfies the formula from at least {100 * LEARNED:.0f} % of the starts."
    )
    marks = mark_notes(mark(group, contest, known) for contest in rows for group in contest)
    return Table.of("Overview", rows, columns, (note, *marks, *advice))


def _learned_by(method: Choice, known: Known, contest: Contest) -> Value:
    """The results of a method; how its seeds ended if none finished, and None without any."""
    group = next((group for group in contest if group.setting.method == method), None)
    if group is None:
        return None
    if not group.done:
        return ", ".join(sorted({row.status for row in group.rows}))
    values = group.values("robustness_mean")
    low, high = median_interval(values) or (None, None)
    learned, final = sum(group.values("learned")), sum(group.values("final_learned"))
    return Learned(median(values), low, high, learned, final, group.tried, mark(group, contest, known))


MARK = "o"  # of policies that were not trained by stlbench


def robustness_table(groups: Sequence[Group], known: Known, outside: Sequence[Group] = ()) -> Table:
    """One row for each group of agents that learn, one column for each further protocol.

    `outside` are policies that were not trained here. Their rows follow those of their tasks.
    """
    marks = {group.setting: MARK for group in outside}
    marks |= {group.setting: mark(group, contest, known) for contest in contests(groups).values() for group in contest}
    rows = sorted([*groups, *outside], key=lambda group: (group.setting.task, group.outside))
    done = [numbers for group in rows for numbers in group.done]
    further = sorted({name for numbers in done for name in numbers.further})
    early = any(numbers.ended_early for numbers in done)
    columns: dict[Column, Callable[[Group], Value]] = {
        **SETTING,
        Column("mark", right=False): lambda group: marks[group.setting] or None,
        Column("starts", drop=8): _starts,
        Column("mean robustness", "mean", digits=3, drop=3): lambda group: group.mean("robustness_mean"),
        Column("median robustness", "median", digits=3): lambda group: group.median("robustness_mean"),
        Column("median 95 % interval", digits=3, kind=Interval, drop=1): (
            lambda group: median_interval(group.values("robustness_mean"))
        ),
        Column("worst start", digits=3, drop=5): lambda group: min(group.values("robustness_min"), default=None),
        Column("satisfied", unit="%", digits=1): lambda group: _percent(group.values("satisfaction")),
        Column("ended early", unit="%", digits=1): lambda group: _percent(group.values("ended_early")),
        Column("learned"): lambda group: _count(group, "learned"),
        Column("learned 95 % interval", unit="%", digits=0, kind=Interval, drop=4): (
            lambda group: _percent_interval(group, "learned")
        ),
        Column("share of best known (median, both above 0)", "of best", digits=2, drop=2): (
            lambda group: known.share(group.setting.task, group.median("robustness_mean"))
        ),
        **{
            Column(name, digits=3, drop=4): lambda group, name=name: mean(  # type: ignore[misc]
                [numbers.further[name] for numbers in group.done if name in numbers.further]
            )
            for name in further
        },
        **{column: partial(_unless_outside, value) for column, value in _FINAL.items()},
        Column("failed first", kind=FirstFailed, right=False, below=True): lambda group: group.first_failed,
        Column("remarks", right=False, below=True): lambda group: group.remarks or None,
    }
    absent = {"mark": not any(marks.values()), "ended early": not early, "of best": not known.best}
    shown = {column: value for column, value in columns.items() if not absent.get(column.short or column.title)}
    notes = (*_notes(further, early), *mark_notes(marks.values()), *_outside_notes(outside))
    return Table.of("Robustness", rows, shown, notes)


_FINAL: dict[Column, Callable[[Group], Value]] = {
    Column("final median robustness", "final median", digits=3, drop=6): (
        lambda group: group.median("final_robustness_mean")
    ),
    Column("final median 95 % interval", digits=3, kind=Interval, drop=7): (
        lambda group: median_interval(group.values("final_robustness_mean"))
    ),
    Column("final satisfied", "final sat.", unit="%", digits=1, drop=6): (
        lambda group: _percent(group.values("final_satisfaction"))
    ),
    Column("final learned", drop=6): lambda group: _count(group, "final_learned"),
    Column("final learned 95 % interval", unit="%", digits=0, kind=Interval, drop=7): (
        lambda group: _percent_interval(group, "final_learned")
    ),
}
"""The scores of the policy at the end of training."""


def _unless_outside(value: Callable[[Group], Value], group: Group) -> Value:
    """A policy from outside has no training, and no policy at its end."""
    return None if group.outside else value(group)


def _starts(group: Group) -> Value:
    """The number of starts behind each number; if seeds differ, all these numbers."""
    counts = sorted({numbers.starts for numbers in group.done if numbers.starts is not None})
    return counts[0] if len(counts) == 1 else ", ".join(map(str, counts)) or None


def _percent(shares: Sequence[float | None]) -> float | None:
    return percent(mean([share for share in shares if share is not None]))


def _count(group: Group, name: str) -> int | None:
    return sum(group.values(name)) if group.done else None


def _percent_interval(group: Group, name: str) -> Interval | None:
    """The exact interval of the share of seeds, of all that ran, in percent."""
    ends = share_interval(sum(group.values(name)), group.tried) if group.done else None
    return ends and Interval(100 * ends.low, 100 * ends.high)


def _notes(further: Sequence[str], early: bool) -> tuple[str, ...]:
    notes = [
        "Robustness is in the unit of the task's predicates: averaged over the starts of a seed, then over seeds.",
        "The policy is the checkpoint that did best on other starts; 'final' is the one at the end of training.",
        "Median: half of the seeds reach it. Its interval goes from one seed to another. It covers the median of all "
        "seeds also where many fail: in 94 % of cases with 5 seeds, in 95 % or more with others. "
        f"Fewer than {FEWEST} seeds have none.",
        f"Learned: seeds whose policy satisfies from at least {100 * LEARNED:.0f} % of the starts, of all that ran, "
        "with the exact interval of their share.",
        "Worst start: minimum over starts and seeds. Failed first: what violating starts most often failed first.",
    ]
    if early:
        notes.append(ENDED_EARLY)
    if further:
        names = ", ".join(further)
        notes.append(f"Mean robustness under the task's further protocols (`stlbench show task NAME`): {names}.")
    return tuple(notes)


def _outside_notes(groups: Sequence[Group]) -> Iterator[str]:
    """The meaning of the mark, and the source of each policy."""
    if groups:
        rule = "not trained by stlbench: its budget is unknown. It is in no comparison and in no statistic."
        yield f"Marked {MARK}: {rule}"
    for group in groups:
        sources = []
        for facts in (row.provenance for row in group.rows):
            starts = ", from starts of its own" if facts.get("begun_at") == "starts of its own" else ""
            sources.append(f"{facts.get('source', 'unknown')} (sha256 {facts.get('sha256', 'unknown')[:12]}){starts}")
        yield f"{group.setting.agent} on {group.setting.task}: {'; '.join(dict.fromkeys(sources))}."
