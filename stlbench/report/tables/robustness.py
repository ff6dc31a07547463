"""How well trained policies satisfy the formula: all methods at a glance, and one row per group with intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stlbench.records.identity import Setting
from stlbench.records.result import LEARNED
from stlbench.registry.choices import Choice
from stlbench.report.statistics.intervals import FEWEST, Interval, median, median_interval, share_interval
from stlbench.report.tables.cells import ENDED_EARLY
from stlbench.report.tables.comparisons import Contest, contests, mark, mark_notes
from stlbench.report.tables.rows import SETTING, Group, setting_values
from stlbench.report.tables.table import Column, FirstFailed, Learned, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard


def overview(
    groups: Sequence[Group],
    standards: Mapping[str, Standard],
    best: Mapping[Choice, float] | None = None,
    advice: Iterable[str] = (),
) -> Table:
    """The median robustness of every method on every task with its interval, and on how many seeds it was learned.

    Args:
        groups: of one or more tasks, agents, budgets and tracks, which are the rows.
        standards: what is known of the tasks, such as what their controllers get.
        best: the best known robustness of the tasks, where it is known.
        advice: lines to say below.
    """
    by_hand = any(standard.by_hand for standard in standards.values())
    methods = sorted({group.setting.method for group in groups})
    columns = (
        Column("task", right=False, shared=True),
        Column("agent", right=False, shared=True),
        Column("budget", right=False, shared=True),
        Column("track", right=False, shared=True),
        *([Column("by hand", digits=3)] if by_hand else []),
        *([Column("possible", digits=3)] if best else []),
        *(Column(str(method), digits=3, kind=Learned) for method in methods),
        Column("cell CPU", unit="s", digits=0, drop=1),
    )
    by_key = contests(groups)
    body = tuple(
        (
            *map(str, key),
            *([_by_hand(key[0], standards)] if by_hand else []),
            *([best.get(key[0])] if best else []),
            *_entries(contest, methods, standards),
            _cpu_seconds(contest),
        )
        for key, contest in by_key.items()
    )
    marks = mark_notes(mark(group, contest, standards) for contest in by_key.values() for group in contest)
    return Table("Overview", columns, body, (_OVERVIEW, *marks, *advice))


_OVERVIEW = (
    "Robustness of the selected policies: the median seed, with its 95 % interval, of five seeds or more. In "
    "parentheses the seeds that learned the task, with the selected policy and with the final one: the policy "
    f"satisfies the formula from at least {100 * LEARNED:.0f} % of the starts."
)


def _by_hand(task: Choice, standards: Mapping[str, Standard]) -> float | None:
    """What the controller of the task, or of the task that it is an ablation of, gets."""
    standard = standards.get(task.name)
    return standard.by_hand.mean if standard and standard.by_hand else None


def _entries(contest: Contest, methods: Iterable[Choice], standards: Mapping[str, Standard]) -> list[Value]:
    by_method = {group.setting.method: _median_learned(group, mark(group, contest, standards)) for group in contest}
    return [by_method.get(method) for method in methods]


def _median_learned(group: Group, marks: str) -> Value:
    """Where no seed finished, how they ended."""
    if not group.done:
        return ", ".join(sorted({row.status for row in group.rows}))
    values = group.values(lambda numbers: numbers.robustness_mean)
    low, high = median_interval(values) or (None, None)
    learned, final = sum(each.learned for each in group.done), sum(each.final_learned for each in group.done)
    return Learned(median(values), low, high, learned, final, group.tried, marks)


def _cpu_seconds(groups: Iterable[Group]) -> float | None:
    """Per cell, mean over all of them."""
    seconds = [numbers.cpu_seconds for group in groups for numbers in group.done]
    return float(np.mean(seconds)) if seconds else None


def robustness_table(
    groups: Sequence[Group],
    best: Mapping[Choice, float] | None = None,
    standards: Mapping[str, Standard] | None = None,
    outside: Sequence[Group] = (),
) -> Table:
    """One row per group, one column per further protocol.

    Args:
        groups: of agents that learn.
        best: the best known of their tasks (`best_known`); where any is known, robustness is also a share of it.
        standards: of their tasks; they know which methods pay the same.
        outside: policies that were not trained here, which stand behind those of their tasks.
    """
    own, groups = groups, sorted([*groups, *outside], key=lambda group: (group.setting.task, group.outside))
    further = sorted({name for group in groups for numbers in group.done for name in numbers.further})
    by_group = _marks(own, standards or {})
    marks = [by_group.get(group.setting, MARK) for group in groups]
    early = any(numbers.ended_early for group in groups for numbers in group.done)
    columns = (
        *SETTING,
        *([Column("mark", right=False)] if any(marks) else []),
        Column("starts", drop=8),
        Column("mean robustness", "mean", digits=3, drop=3),
        Column("median robustness", "median", digits=3),
        Column("median 95 % interval", digits=3, kind=Interval, drop=1),
        Column("worst start", digits=3, drop=5),
        Column("satisfied", unit="%", digits=1),
        *([Column("ended early", unit="%", digits=1)] if early else []),
        Column("learned", drop=2),
        Column("learned 95 % interval", unit="%", digits=0, kind=Interval, drop=4),
        *([Column(_SHARE, "of best", digits=2, drop=2)] if best else []),
        *(Column(name, digits=3, drop=4) for name in further),
        Column("final median robustness", "final median", digits=3, drop=6),
        Column("final median 95 % interval", digits=3, kind=Interval, drop=7),
        Column("final satisfied", "final sat.", unit="%", digits=1, drop=6),
        Column("final learned", drop=6),
        Column("final learned 95 % interval", unit="%", digits=0, kind=Interval, drop=7),
        Column("failed first", kind=FirstFailed, right=False, below=True),
        Column("remarks", right=False, below=True),
    )
    rows = tuple(
        (*setting_values(group), *([each or None] if any(marks) else []), *_values(group, further, best or {}, early))
        for group, each in zip(groups, marks, strict=True)
    )
    shown = tuple(map(partial(_only_selected, columns), rows, (group.outside for group in groups)))
    return Table("Robustness", columns, shown, (*_notes(further, early), *mark_notes(marks), *outside_notes(outside)))


def _only_selected(columns: Sequence[Column], row: tuple[Value, ...], outside: bool) -> tuple[Value, ...]:
    """Of a policy from outside there is one, and none at the end of its training."""
    if not outside:
        return row
    return tuple(
        None if column.title.startswith("final ") else value for column, value in zip(columns, row, strict=True)
    )


MARK = "o"
"""Of policies that were not trained by stlbench."""
_SHARE = "share of best known (median, both above 0)"


def _marks(groups: Sequence[Group], standards: Mapping[str, Standard]) -> dict[Setting, str]:
    found = contests(groups).values()
    return {group.setting: mark(group, contest, standards) for contest in found for group in contest}


def _values(group: Group, further: Sequence[str], best: Mapping[Choice, float], early: bool) -> tuple[Value, ...]:
    values = group.values(lambda numbers: numbers.robustness_mean)
    final = group.values(lambda numbers: numbers.final_robustness_mean)
    centre = median(values) if values else None
    return (
        _starts(group),
        float(np.mean(values)) if values else None,
        centre,
        median_interval(values),
        min(group.values(lambda numbers: numbers.robustness_min), default=None),
        _percent(group.values(lambda numbers: numbers.satisfaction)),
        *([_percent([each.ended_early for each in group.done if each.ended_early is not None])] if early else []),
        *_learned(group, [numbers.learned for numbers in group.done]),
        *([_share(centre, best.get(group.setting.task))] if best else []),
        *(_mean([numbers.further[name] for numbers in group.done if name in numbers.further]) for name in further),
        median(final) if final else None,
        median_interval(final),
        _percent(group.values(lambda numbers: numbers.final_satisfaction)),
        *_learned(group, [numbers.final_learned for numbers in group.done]),
        group.first_failed,
        group.remarks or None,
    )


def _starts(group: Group) -> Value:
    """From how many starts each number is; where seeds differ, all that there are."""
    counts = sorted({numbers.starts for numbers in group.done if numbers.starts is not None})
    return counts[0] if len(counts) == 1 else ", ".join(map(str, counts)) or None


def _learned(group: Group, learned: Iterable[bool]) -> tuple[Value, Value]:
    """How many seeds, of all that ran, and the exact interval of their share in percent; None where none finished."""
    if not group.done:
        return None, None
    count = sum(learned)
    ends = share_interval(count, group.tried)
    return count, ends and Interval(100 * ends.low, 100 * ends.high)


def _share(value: float | None, best: float | None) -> float | None:
    """Robustness as a share of the best known; None where it says nothing, as of what violates."""
    return value / best if value is not None and best is not None and value > 0 < best else None


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _percent(shares: Sequence[float]) -> float | None:
    return 100 * float(np.mean(shares)) if shares else None


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


def outside_notes(groups: Sequence[Group]) -> tuple[str, ...]:
    """What the mark means, and a line for each policy: where it comes from."""
    if not groups:
        return ()
    rule = "not trained by stlbench: its budget is unknown. It is in no comparison and in no statistic."
    return (f"Marked {MARK}: {rule}", *(_origin(group) for group in groups))


def _origin(group: Group) -> str:
    sources = []
    for row in group.rows:
        facts = row.provenance
        starts = ", from starts of its own" if facts.get("begun_at") == "starts of its own" else ""
        sources.append(f"{facts.get('source', 'unknown')} (sha256 {facts.get('sha256', 'unknown')[:12]}){starts}")
    return f"{group.setting.agent} on {group.setting.task}: {'; '.join(dict.fromkeys(sources))}."
