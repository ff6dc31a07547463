"""Tables of trained policies: all methods at a glance, one row for each group, one row for each cell, the numbers of
one cell, and what training took on which machine.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter
from typing import TypeVar

from stlbench.records.identity import IDENTITY
from stlbench.records.result import ACCIDENTS, LEARNED, MAIN, RANDOM, SCHEMA, Datum, Measurement, Score
from stlbench.registry.choices import Choice
from stlbench.report.tables.comparisons import Contest, contests, mark, mark_notes
from stlbench.report.tables.rows import SETTING, Group, Row, columns_of, shared_columns
from stlbench.report.tables.table import Column, FirstFailed, Learned, Table, Value
from stlbench.report.tables.yardsticks import Known
from stlbench.statistics.intervals import FEWEST, Interval, mean, mean_interval, median, median_interval, share_interval

_T = TypeVar("_T")
_EARLY = Column("ended early", unit="%", digits=1)
_FIRST = ("satisfaction", "robustness_mean", "robustness_min", "final_satisfaction")
"""The columns that stand before the others of `SCHEMA` in cells.csv."""


CELL: Mapping[Column, Callable[[Row], Value]] = {
    Column("cell", right=False): lambda row: row.id.name,
    Column("budget", right=False): lambda row: row.id.budget,
    Column("status", right=False): lambda row: row.status,
    Column("reason", right=False): lambda row: row.reason or None,
}
"""The columns that say which cell a row is, and how it ended."""
MEASUREMENT: Callable[[Row], Measurement | None] = attrgetter("measurement")
_IDENTITY: Mapping[Column, Callable[[Row], Value]] = {
    Column(name, right=name == "seed"): lambda row, name=name: row.id.plain[name]  # type: ignore[misc]
    for name in IDENTITY
}


def cells_table(rows: Iterable[Row], groups: Mapping[str, Mapping[str, str]] | None = None) -> Table:
    """One row for each cell with its numbers, for other programs. If any was planned, also what its plan says.

    `groups` are those of tasks that a suite drew, such as system and template, by the task's name.
    """
    listed, of_tasks = list(rows), groups or {}
    kinds = dict.fromkeys(kind for row in listed for kind in of_tasks.get(row.id.task.name, ()))
    done = [row.measurement for row in listed if row.measurement]
    measured = dict[Column, Callable[[Measurement], Value]]()
    for name in dict.fromkeys((*_FIRST, *SCHEMA)):
        part = SCHEMA[name].path.partition(".")[0]
        if getattr(Measurement, part, "") is not None or any(getattr(each, part) is not None for each in done):
            measured[Column(name)] = partial(_shown, SCHEMA[name])
        if name == "starts":
            measured |= _INTERVALS
    of_cell = {column: value for column, value in CELL.items() if column.title in ("status", "reason")}
    drawn = {
        Column(kind, right=False): lambda row, kind=kind: of_tasks.get(row.id.task.name, {}).get(kind) for kind in kinds
    }
    return Table.of("Cells", listed, {**_IDENTITY, **drawn, **of_cell, **columns_of(MEASUREMENT, measured)})


def _shown(datum: Datum, measured: Measurement) -> Value:
    """An empty text is no value."""
    value: Value = datum.of(measured)
    return None if value == "" else value


def percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _of_starts(score: Score) -> Interval | None:
    """The exact interval of the share of the starts that satisfy, for this one policy."""
    return share_interval(round(score.satisfaction * score.starts), score.starts)


_INTERVALS: Mapping[Column, Callable[[Measurement], Value]] = {
    Column("satisfaction 95 % interval", kind=Interval): lambda each: _of_starts(each.score),
    Column("final_satisfaction 95 % interval", kind=Interval): lambda each: _of_starts(each.final_score),
}


def unfinished_table(groups: Iterable[Group]) -> Table:
    """The cells that ended by accident: raised, out of time, killed."""
    rows = [row for group in groups for row in group.rows if row.status in ACCIDENTS]
    return Table.of("Cells without a result", rows, CELL, ("`stlbench run --retry failed` runs them again.",))


ENDED_EARLY = (
    "Ended early: share of the starts whose episode the environment ended before the formula's horizon. The task's "
    "`terminated` says how such an episode is judged: under `hold` the last sample stays, so an early end can satisfy."
)
"""The note on the column of that name."""


def score_columns(
    of: Callable[[_T], Score], rows: Sequence[_T]
) -> tuple[dict[Column, Callable[[_T], Value]], tuple[str, ...]]:
    """The columns of each row's score, and notes on them: one says what an early end is, where there was any."""
    columns: dict[Column, Callable[[_T], Value]] = {
        Column("mean robustness", "mean", digits=3): lambda row: of(row).mean,
        Column("worst start", digits=3): lambda row: of(row).minimum,
        Column("satisfied", unit="%", digits=1): lambda row: 100 * of(row).satisfaction,
    }
    if not any(of(row).ended_early for row in rows):
        return columns, ()
    columns[_EARLY] = lambda row: percent(of(row).ended_early)
    return columns, (ENDED_EARLY,)


def scores_table(policies: Mapping[str, Mapping[str, Score]]) -> Table:
    """One row for each protocol and policy, from name -> protocol -> score. A single policy may have an empty name."""
    protocols = next(iter(policies.values()))
    rows = [(protocol, name, scores[protocol]) for protocol in protocols for name, scores in policies.items()]
    scores, notes = score_columns(lambda row: row[2], rows)
    columns: dict[Column, Callable[[tuple[str, str, Score]], Value]] = {
        Column("protocol", right=False): lambda row: row[0],
        **({Column("policy", right=False): lambda row: row[1]} if any(policies) else {}),
        **scores,
        Column("starts", digits=0): lambda row: row[2].starts,
        Column("failed first", right=False): (
            lambda row: "\n".join(f"{formula}: {count}" for formula, count in row[2].first_failed.items()) or None
        ),
    }
    return Table.of("Scores", rows, columns, notes)


def scores_and_cost(measurement: Measurement, *, outside: bool) -> list[Table]:
    """The tables of one cell. A policy from outside has one score, and no cost."""
    if outside:
        return [scores_table({"": measurement.selected})]
    cost = {
        "selected at environment step": measurement.selected_steps,
        "environment steps": measurement.env_steps,
        "checkpoints": len(measurement.curve),
        "training CPU [s]": measurement.training_cpu_seconds,
        "training wall [s]": measurement.training_wall_seconds,
        "cell CPU [s]": measurement.cpu_seconds,
        "cell wall [s]": measurement.wall_seconds,
        "reward [ns/step]": measurement.reward_nanoseconds,
        "inputs added": measurement.inputs_added,
    }
    return [
        scores_table({"selected": measurement.selected, "final": measurement.final}),
        Table("Cost", (Column("what", right=False), Column("value")), tuple(cost.items())),
    ]


def time_table(groups: Sequence[Group]) -> Table:
    columns: dict[Column, Callable[[Group], Value]] = {
        **SETTING,
        Column("training wall", "train wall", unit="s", digits=1): lambda group: group.mean("training_wall_seconds"),
        Column("wall 95 % interval", unit="s", digits=1, kind=Interval, drop=2): _interval_of("training_wall_seconds"),
        Column("training CPU", "train CPU", unit="s", digits=1): lambda group: group.mean("training_cpu_seconds"),
        Column("CPU 95 % interval", unit="s", digits=1, kind=Interval, drop=2): _interval_of("training_cpu_seconds"),
        Column("cell CPU", unit="s", digits=1, drop=5): lambda group: group.mean("cpu_seconds"),
        Column("env steps", digits=0): lambda group: group.mean("env_steps"),
        Column("reward", unit="ns/step", digits=1): lambda group: group.mean("reward_nanoseconds"),
        Column("inputs added", digits=0, drop=3): lambda group: group.mean("inputs_added"),
        Column("jobs at a time", drop=4): _jobs,
        Column("remarks", right=False, below=True): lambda group: group.remarks or None,
    }
    notes = (
        "Means over seeds, with t intervals, cut at 0. 'Cell' is training, checkpoints and evaluation.",
        "Reward: CPU nanoseconds of the method's reward per step and copy, in a batch of 1024.",
    )
    return Table.of("Time", groups, columns, notes)


def _interval_of(name: str) -> Callable[[Group], Value]:
    """The interval of the mean, cut at 0: the interval of two seeds is wide."""
    return lambda group: (ends := mean_interval(group.values(name))) and Interval(max(ends.low, 0.0), ends.high)


def _jobs(group: Group) -> str | None:
    jobs = {row.provenance.get("jobs", "") for row in group.rows if row.measurement}
    return ", ".join(sorted(jobs - {""})) or None


_NO_VERSIONS = {"machine", "jobs", "time", "code", "task_folder", "load"}
_NO_VERSIONS |= {"training_calibration_seconds", "reward_calibration_seconds"}
"""Keys of provenance that are no versions of packages."""


def circumstances(groups: Sequence[Group]) -> Table:
    """Machine, versions, code, jobs, days, cells and CPU time: one row each. If cells differ, it has all values."""
    rows = [row for group in groups for row in group.rows]
    values: dict[str, set[str]] = {}
    for row in rows:
        for name, value in row.provenance.items():
            values.setdefault(name, set()).add(value)
    texts = {name: "; ".join(sorted(several)) for name, several in values.items()}
    parts = (part.partition(" ") for row in rows for part in row.provenance.get("code", "").split(", "))
    days = sorted({time.partition("T")[0] for time in values.get("time", ())})
    seconds = sum(row.measurement.cpu_seconds for row in rows if row.measurement)
    lines = {
        "machine": texts.get("machine", ""),
        "versions": ", ".join(f"{name} {texts[name]}" for name in sorted(texts.keys() - _NO_VERSIONS)),
        "code of stlbench": "; ".join(sorted({version for part, _, version in parts if part == "harness"})),
        "cells at a time": texts.get("jobs", ""),
        "begun": days[0] if len(days) == 1 else " to ".join([*days[:1], *days[-1:]]),
        "cells": f"{len(rows)}, {sum(row.measurement is not None for row in rows)} of them with a result",
        "CPU time": f"{_time(seconds)}, training and evaluation",
    }
    columns = (Column("what", right=False), Column("value", right=False))
    return Table("Circumstances", columns, tuple((name, text) for name, text in lines.items() if text))


def _time(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.1f} seconds"
    return f"{seconds / 60:.1f} minutes" if seconds < 3600 else f"{seconds / 3600:.2f} hours"


def overview(groups: Sequence[Group], known: Known, advice: Iterable[str] = ()) -> Table:
    """The median robustness of every method on every task with its interval, and on how many seeds it was learned.

    One row for each task, agent, budget and track of the groups. `advice` are lines for the notes.
    """
    rows = contests(groups).values()
    columns: dict[Column, Callable[[Contest], Value]] = shared_columns(lambda contest: contest[0])
    if any(reference.by_hand for reference in known.references.values()):
        columns[Column("by hand", digits=3)] = lambda contest: known.by_hand(contest[0].setting.task)
    if known.best:
        columns[Column("best known", digits=3)] = lambda contest: known.best.get(contest[0].setting.task)
    for method in sorted({group.setting.method for group in groups}):
        columns[Column(str(method), digits=3, kind=Learned)] = partial(_learned_by, method, known)
    columns[Column("cell CPU", unit="s", digits=0, drop=1)] = lambda contest: mean(
        [value for group in contest for value in group.values("cpu_seconds")]
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
    learned, final = sum(group.learned), sum(group.final_learned)
    return Learned(median(values), low, high, learned, final, group.tried, mark(group, contest, known))


MARK = "o"  # of policies that were not trained by stlbench


def robustness_table(groups: Sequence[Group], known: Known, outside: Sequence[Group] = ()) -> Table:
    """One row for each group of agents that learn, one column for each further protocol.

    `outside` are policies that were not trained here. Their rows follow those of their tasks.
    """
    marks = {group.setting: MARK for group in outside}
    marks |= {group.setting: mark(group, contest, known) for contest in contests(groups).values() for group in contest}
    rows = sorted([*groups, *outside], key=lambda group: (group.setting.task, group.outside))
    done = [measured for group in rows for measured in group.done]
    further = sorted({name for measured in done for name in measured.selected} - {MAIN, RANDOM})
    early = any(measured.score.ended_early for measured in done)
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
        _EARLY: lambda group: _percent(group.values("ended_early")),
        Column("learned"): lambda group: _count(group, group.learned),
        Column("learned 95 % interval", unit="%", digits=0, kind=Interval, drop=4): (
            lambda group: _percent_interval(group, group.learned)
        ),
        Column("share of best known (median, both above 0)", "of best", digits=2, drop=2): (
            lambda group: known.share(group.setting.task, group.median("robustness_mean"))
        ),
        **{
            Column(name, digits=3, drop=4): lambda group, name=name: mean(  # type: ignore[misc]
                [measured.selected[name].mean for measured in group.done if name in measured.selected]
            )
            for name in further
        },
        **columns_of(lambda group: None if group.outside else group, _FINAL),
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
    Column("final learned", drop=6): lambda group: _count(group, group.final_learned),
    Column("final learned 95 % interval", unit="%", digits=0, kind=Interval, drop=7): (
        lambda group: _percent_interval(group, group.final_learned)
    ),
}
"""The scores of the policy at the end of training, which a policy from outside does not have."""


def _starts(group: Group) -> Value:
    """The number of starts behind each number; if seeds differ, all these numbers."""
    counts = sorted(set(group.values("starts")))
    return counts[0] if len(counts) == 1 else ", ".join(map(str, counts)) or None


def _percent(shares: Sequence[float | None]) -> float | None:
    return percent(mean([share for share in shares if share is not None]))


def _count(group: Group, learned: Sequence[bool]) -> int | None:
    return sum(learned) if group.done else None


def _percent_interval(group: Group, learned: Sequence[bool]) -> Interval | None:
    """The exact interval of the share of seeds, of all that ran, in percent."""
    ends = share_interval(sum(learned), group.tried) if group.done else None
    return ends and ends.percent


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
