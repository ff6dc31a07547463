"""The tables of a leaderboard: one row per task, method and agent of each bundle, and one row per bundle."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from stlbench.leaderboard.entry import Entry, Scored, Scores
from stlbench.records.identity import Setting
from stlbench.report import Column, Table, Value
from stlbench.report.statistics.differences import Pair, differences
from stlbench.report.statistics.intervals import Interval, median, median_interval, share_interval
from stlbench.report.tables.rows import LEARNED
from stlbench.report.tables.table import Seeds

_PLAIN = re.compile(r"[^A-Za-z0-9 .,;:()%/+'-]")
"""Characters that may be more than themselves in Markdown or HTML."""


class _Line(NamedTuple):
    """The cells of one bundle that differ in nothing but the seed."""

    entry: Entry
    setting: Setting
    cells: tuple[Scored, ...]

    @property
    def values(self) -> tuple[float, ...]:
        """Robustness of each seed, as the referee found it."""
        return tuple(cell.found.robustness for cell in self.cells if cell.found)

    @property
    def shares(self) -> tuple[float, ...]:
        """Share of the fresh starts that satisfy, of each seed."""
        return tuple(cell.found.satisfaction for cell in self.cells if cell.found)

    @property
    def contest(self) -> tuple[str, ...]:
        """What has to be the same for two lines to be compared."""
        setting = self.setting
        return str(setting.task), str(setting.agent), setting.budget, setting.track


def _lines(entries: Sequence[Entry]) -> list[_Line]:
    """By task; within a task the most robust first, and those that could not be scored last."""
    found = list[_Line]()
    for entry in entries:
        settings = dict[Setting, list[Scored]]()
        for cell in entry.cells:
            settings.setdefault(cell.id.setting, []).append(cell)
        found += [_Line(entry, setting, tuple(cells)) for setting, cells in settings.items()]
    return sorted(found, key=_place)


def _place(line: _Line) -> tuple[str, float, Setting, str]:
    worst_last = -median(line.values) if line.values else float("inf")
    return str(line.setting.task), worst_last, line.setting, line.entry.bundle


def results(scores: Scores) -> Table:
    """One row per setting of each bundle; the numbers are the referee's, and the claims beside them."""
    lines = _lines(scores.entries)
    words = _beside_the_best(lines)
    columns = (
        Column("task", right=False),
        Column("method", right=False),
        Column("median robustness", "median", digits=3),
        Column("median 95 % interval", digits=3, kind=Interval, drop=1),
        Column("beside the best", right=False, drop=2),
        Column("satisfied", unit="%", digits=1),
        Column("learned", drop=1),
        Column("learned 95 % interval", unit="%", digits=0, kind=Interval, drop=3),
        Column("seeds", right=False, kind=Seeds),
        Column("claimed", digits=3, drop=1),
        Column("claimed less found", "less found", digits=3, drop=2),
        Column("record", right=False),
        Column("bundle", right=False, drop=2),
        Column("agent", right=False, shared=True),
        Column("budget", right=False, shared=True),
        Column("track", right=False, shared=True),
    )
    rows = tuple(_row(line, word) for line, word in zip(lines, words, strict=True))
    return Table("Results", columns, rows, (*_NOTES, *_remarks(lines)))


_NOTES = (
    "Robustness, satisfied and learned are what the referee found for the selected policies, from fresh random starts. "
    "Median: of the seeds, with its exact 95 % interval.",
    f"Learned: seeds whose policy satisfies from at least {100 * LEARNED:.0f} % of the starts, of all that ran.",
    "Beside the best: against the first row of the same task, agent, budget and track, by the report's exact test, "
    "after Holm's correction over the whole table. Unlike a report, it does not know which methods pay the same there.",
    "Claimed: the same median as the bundle has it, of the starts that all reports use. Claimed less found is the mean "
    "over seeds: chance makes it small, and training on the reported starts makes it larger.",
    "Record: whether the bundle's own numbers are found again from the reported starts (stlbench verify --rescore).",
)


def _row(line: _Line, word: str) -> tuple[Value, ...]:
    setting, entry, found = line.setting, line.entry, line.values
    claims = [cell.claimed.robustness for cell in line.cells if cell.claimed]
    pairs = [(cell.claimed, cell.found) for cell in line.cells]
    less = [claimed.robustness - seen.robustness for claimed, seen in pairs if claimed and seen]
    return (
        *(str(setting.task), str(setting.method)),
        median(found) if found else None,
        median_interval(found),
        word or None,
        100 * float(np.mean(line.shares)) if found else None,
        *_learned(line),
        Seeds(len(found), len(line.cells), _unfinished(line.cells)),
        median(claims) if claims else None,
        float(np.mean(less)) if less else None,
        _record(line.cells),
        entry.bundle.removesuffix(".zip"),
        *(str(setting.agent), setting.budget, setting.track),
    )


def _unfinished(cells: Sequence[Scored]) -> str | None:
    words = ["not scored" if cell.status == "done" else cell.status for cell in cells if cell.found is None]
    return ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words)) or None


def _learned(line: _Line) -> tuple[Value, Value]:
    """How many seeds learned the task, and the interval of their share in percent."""
    if not line.shares:
        return None, None
    count = sum(share >= LEARNED for share in line.shares)
    ends = share_interval(count, len(line.cells))
    return count, ends and Interval(100 * ends.low, 100 * ends.high)


def _record(cells: Sequence[Scored]) -> str | None:
    """The worst that is said of any seed."""
    said = {cell.record for cell in cells}
    return next(
        (word for word in ("claims more", "not scored", "within rounding", "as recorded") if word in said), None
    )


def _beside_the_best(lines: Sequence[_Line]) -> list[str]:
    best: dict[tuple[str, ...], _Line] = {}
    for line in lines:
        if line.values:
            best.setdefault(line.contest, line)
    others = [i for i, line in enumerate(lines) if line.values and best[line.contest] is not line]
    found = differences(_pair(lines[i], best[lines[i].contest]) for i in others)
    words = {i: str(each) for i, each in zip(others, found, strict=True)}
    alone = {contest for contest in best if sum(line.contest == contest for line in lines) == 1}
    return [words.get(i, "first" if line.values and line.contest not in alone else "") for i, line in enumerate(lines)]


def _pair(line: _Line, best: _Line) -> Pair:
    one, other = ([share >= LEARNED for share in each.shares] for each in (line, best))
    return Pair(line.values, best.values, learned=(one, other))


def _remarks(lines: Sequence[_Line]) -> Iterator[str]:
    """Why cells have no result, or no score, each said once for a line."""
    for line in lines:
        whys = dict.fromkeys(f"{cell.status}: {cell.reason}" for cell in line.cells if cell.reason)
        whys |= dict.fromkeys(f"{cell.record}: {cell.why}" for cell in line.cells if cell.why)
        for why in whys:
            yield f"{line.setting.name} in {line.entry.bundle}: {why}"


def bundles(scores: Scores) -> Table:
    """One row per bundle: who submitted it, and whether it is on the leaderboard."""
    titles = ("bundle", "by", "title", "licence", "packed", "cells", "SHA-256")
    columns = tuple(Column(title, right=title == "cells") for title in titles)
    rows = [
        (
            *(entry.bundle, ", ".join(entry.authors), entry.title, entry.license, entry.date),
            *(len(entry.cells), entry.sha256[:12]),
        )
        for entry in scores.entries
    ]
    refused = (f"{each.bundle} is refused: {problem}." for each in scores.refused for problem in each.problems)
    note = (
        f"The seed of the fresh starts is {scores.draw}, drawn when stlbench {scores.scored_by} scored all of these; "
        "with it anybody finds the same numbers."
    )
    return Table("Bundles", columns, tuple(rows), (note, *refused))


def in_markup(table: Table) -> Table:
    """The table for Markdown: whatever its texts hold is text there, no tag, no link, no name that is called."""
    rows = tuple(tuple(_safe(value) if isinstance(value, str) else value for value in row) for row in table.rows)
    return Table(table.title, table.columns, rows, tuple(map(_safe, table.notes)))


def _safe(text: str) -> str:
    return _PLAIN.sub(lambda found: f"&#{ord(found[0])};", text.replace("@", "(at)"))
