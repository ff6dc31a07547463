"""What searches found, as tables: one row for each subject."""

from __future__ import annotations

from collections.abc import Sequence

from stlbench.report.statistics.intervals import Interval
from stlbench.report.tables.table import Column, Table
from stlbench.search.certify import Certificate, plain
from stlbench.search.falsify import Falsification


def falsifications(found: Sequence[Falsification]) -> Table:
    """What was searched, how long, the least robustness, and the counterexample where there is one."""
    columns = (
        Column("searched", right=False),
        Column("optimiser", right=False, shared=True),
        Column("evaluations"),
        Column("least robustness", "least"),
        Column("counterexample", right=False),
        Column("first counterexample", "first", drop=1),
        Column("failed", right=False, drop=2),
        Column("CPU", unit="s", digits=1),
    )
    rows = tuple(
        (
            *(one.subject.name, one.how.optimiser, one.evaluations, one.worst.robustness),
            one.start_text(6) if one.found else None,
            one.first if one.found else None,
            one.failed if one.found or one.open else None,
            one.cpu_seconds,
        )
        for one in found
    )
    count, open_ = sum(one.found for one in found), sum(one.open for one in found)
    notes = [f"{count} of {len(found)} have a counterexample."]
    if open_:
        notes.append(f"Of {open_} the verdict is open: an episode ended early, and some continuations satisfy.")
    return Table("Falsification", columns, rows, tuple(notes))


def certificates(found: Sequence[Certificate]) -> Table:
    """The shares of satisfied starts with their intervals; how many verdicts are open, where any is."""
    some_open = any(one.open for one in found)
    columns = (
        Column("certified", right=False),
        Column("confidence", right=False, shared=True),
        Column("starts"),
        Column("satisfied"),
        *([Column("open")] if some_open else []),
        Column("probability", digits=4),
        Column("interval", digits=4, kind=Interval),
        Column("claim", right=False, shared=True),
        Column("verdict", right=False),
        Column("CPU", unit="s", digits=1),
    )
    rows = tuple(
        (
            *(one.subject.name, plain(one.claim.confidence), one.starts, one.satisfied),
            *([one.open] if some_open else []),
            *(one.satisfied / one.starts, one.interval, _claim(one), one.verdict, one.cpu_seconds),
        )
        for one in found
    )
    notes = ("The probability is of satisfaction by every continuation: open verdicts do not count.",)
    return Table("Certificates", columns, rows, notes if some_open else ())


def _claim(found: Certificate) -> str | None:
    claim = found.claim
    if claim.at_least is not None:
        return f"at least {plain(claim.at_least)}"
    return None if claim.width is None else f"known to {plain(claim.width)}"
