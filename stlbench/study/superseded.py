"""Cells that have a result of other code than today's: which they are, and what has changed since."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice

from stlbench.records.ledger import Ledger
from stlbench.records.result import Result
from stlbench.study.cell import Cell
from stlbench.study.provenance import code_of

_LOOKED_AT = 100
"""Results of which is said what has changed; to read all of a long study would take seconds."""


def superseded(missing: Iterable[Cell], ledger: Ledger) -> dict[str, Cell]:
    """Those of the cells that have a result under another key, which was no accident: that key -> the cell."""
    counted = ledger.counted(accidents=False)
    return {key: cell for cell in missing if (key := counted.get(cell.id)) is not None and key != cell.key}


def note(found: Mapping[str, Cell], ledger: Ledger, today: Mapping[str, str], keep: bool | None) -> str:
    """One line: how many there are, what has changed, and what becomes of them.

    Args:
        found: as `superseded` gives them.
        ledger: has their results.
        today: the provenance of cells that start now.
        keep: whether the old results count; None where the user cannot say so.
    """
    looked_at = {key: found[key] for key in islice(found, _LOOKED_AT)}
    results = ledger.results(looked_at)
    causes = dict.fromkeys(cause for old in results for cause in _causes(old, looked_at[old.key], today))
    have = "1 cell has a result" if len(found) == 1 else f"{len(found)} cells have results"
    fate = f"{'is' if len(found) == 1 else 'are'} {'not ' if keep else ''}measured anew"
    hint = "; --keep-old counts the old results as done" if keep is False else ""
    said = ", ".join(islice(causes, 4)) or "not known"
    return f"{have} of other code and {fate}{hint}; what has changed: {said}{', ...' if len(causes) > 4 else ''}"


def _causes(old: Result, cell: Cell, today: Mapping[str, str]) -> list[str]:
    then = code_of(old.provenance)
    if not then:
        return ["not known, as the old results do not say of which code they are"]
    changed = [name for name, said in cell.parts if not said.startswith(then.get(name, "?"))]
    names = {
        "harness": ["stlbench's own code"],
        "task": [f"task {cell.id.task}"],
        "method": [f"method {cell.id.method}"],
        "agent": [f"agent {cell.id.agent} or its recipe"],
        "packages": _packages(old.provenance, today),
    }
    return [cause for name in changed for cause in names[name]]


def _packages(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Those of which the provenance has versions; time and machine have their own names there."""
    other = ("time", "jobs", "machine")
    moved = [name for name in now if name not in other and then.get(name, now[name]) != now[name]]
    return [f"{name} {then[name]} to {now[name]}" for name in moved] or ["packages that the plugins import"]
