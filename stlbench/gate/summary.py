"""How `stlbench compare` and `stlbench gate` say what they found: as values for JSON, and as Markdown for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from stlbench.gate.judge import EXIT, Comparison, Finding, Judgement
from stlbench.gate.metrics import METRICS
from stlbench.gate.snapshot import Snapshot
from stlbench.report import Column, Table, Value, to_markdown

Named = tuple[str, Snapshot]
"""Where a snapshot lies, and what it holds."""


# ------------------------------------------------------------------------------------------------------------- JSON


def facts(judgement: Judgement, base: Named, new: Named) -> dict[str, Any]:
    """All that was found, as values that JSON has. Changes: robustness relative, satisfaction absolute, times x/y."""
    return {
        "verdict": judgement.verdict,
        "exit_code": EXIT[judgement.verdict],
        "base": _source(*base),
        "new": _source(*new),
        "notes": notes(base[1], new[1]),
        "comparisons": [_record(comparison) for comparison in judgement.comparisons],
        "findings": [vars(finding) | {"cell": finding.cell.name} for finding in judgement.findings],
    }


def _source(path: str, snapshot: Snapshot) -> dict[str, Any]:
    return {"path": path, "cells": len(snapshot.samples), "provenance": dict(snapshot.provenance)}


def _record(comparison: Comparison) -> dict[str, Any]:
    metric, limits = (
        comparison.metric,
        sorted((comparison.metric.change(comparison.low), comparison.metric.change(comparison.high))),
    )
    numbers = {
        "base": comparison.base,
        "new": comparison.new,
        "change": metric.change(comparison.gain),
        "low": limits[0],
        "high": limits[1],
        "tolerated": metric.change(-metric.tolerated),
        "p_value": comparison.chance,
    }
    setting = {name: str(part) for name, part in vars(comparison.setting).items()}
    finite = {name: value if math.isfinite(value) else None for name, value in numbers.items()}
    turns = {"turns": [metric.change(gain) for gain in comparison.gains]} if comparison.gains else {}
    said = {"metric": metric.name, "pairs": comparison.pairs, **finite, "verdict": comparison.verdict}
    return {**setting, **said, **turns}


# --------------------------------------------------------------------------------------------------------- Markdown


def markdown(title: str, judgement: Judgement, base: Named, new: Named) -> str:
    """A summary for a terminal, a file, or the page of a CI job: the verdict, what led to it, and all settings."""
    tables = [table for table in (trouble(judgement), settings(judgement)) if table.rows]
    return "\n".join([head(title, judgement, base, new), *map(to_markdown, tables)])


def head(title: str, judgement: Judgement, base: Named, new: Named) -> str:
    """The verdict, where the two come from, and what a reader should know of them."""
    lines = [f"# {title}: {judgement.verdict}", "", _said("base", *base), _said("new", *new)]
    return "\n".join([*lines, *(f"- {note}" for note in notes(base[1], new[1])), ""])


def _said(role: str, path: str, snapshot: Snapshot) -> str:
    provenance = ", ".join(f"{name} {value}" for name, value in snapshot.provenance.items())
    return f"- {role}: `{path}`, {len(snapshot.samples)} cells{'; ' if provenance else ''}{provenance}"


def notes(base: Snapshot, new: Snapshot) -> list[str]:
    """What a reader should know of the two before believing the verdict."""
    further = len(new.samples.keys() - base.samples.keys())
    machines = {snapshot.provenance.get("machine") for snapshot in (base, new)}
    possible = [
        (further, f"Cells of the new snapshot alone, which were not compared: {further}."),
        (len(machines) > 1, "The two were measured on different machines, which may round differently."),
    ]
    return [note for applies, note in possible if applies]


def trouble(judgement: Judgement) -> Table:
    """One row for each thing that is not fine, the worst first; as texts, since each row has its metric's unit."""
    titles = ("verdict", "where", "metric", "base", "new", "change", "95 % limits", "tolerated", "pairs", "p", "reason")
    rows = [(EXIT[finding.verdict], _finding(finding)) for finding in judgement.findings]
    rows += [
        (EXIT[comparison.verdict], _comparison(comparison))
        for comparison in judgement.comparisons
        if EXIT[comparison.verdict]
    ]
    columns = tuple(Column(title, right=title not in ("verdict", "where", "metric", "reason")) for title in titles)
    return Table("What is not fine", columns, tuple(row for _, row in sorted(rows, key=lambda row: row[0])))


def _finding(finding: Finding) -> tuple[Value, ...]:
    return (finding.verdict, finding.cell.name, *[None] * 8, finding.reason or None)


def _comparison(comparison: Comparison) -> tuple[Value, ...]:
    metric = comparison.metric
    limits = sorted((comparison.low, comparison.high), key=metric.change)
    return (
        *(comparison.verdict, comparison.setting.name, metric.name, f"{comparison.base:.4g}", f"{comparison.new:.4g}"),
        *(metric.text(comparison.gain), f"[{metric.text(limits[0])}, {metric.text(limits[1])}]"),
        *(metric.text(-metric.tolerated), comparison.pairs, f"{comparison.chance:.2g}", None),
    )


def settings(judgement: Judgement) -> Table:
    """One row per setting, one column per metric."""
    compared = {(comparison.setting, comparison.metric.name): comparison for comparison in judgement.comparisons}
    names = [metric.name for metric in METRICS]
    titles = ("task", "method", "agent", "budget", "track", "pairs", *names)
    columns = tuple(Column(title, right=place > 3) for place, title in enumerate(titles))
    rows = tuple(
        (*map(str, vars(setting).values()), *_row([compared.get((setting, name)) for name in names]))
        for setting in sorted({setting for setting, _ in compared})
    )
    remarks = (
        "Robustness and satisfaction: mean over the paired seeds of base and new, and the change.",
        "CPU: seconds of training, new over base; reward: its time per step. A cost in brackets is not judged.",
        "What is tolerated, and how it is tested: docs/howto/share.md.",
    )
    return Table("All settings", columns, rows, remarks)


def _row(comparisons: Sequence[Comparison | None]) -> list[Value]:
    pairs = max((comparison.pairs for comparison in comparisons if comparison), default=0)
    return [pairs, *(None if comparison is None else _change(comparison) for comparison in comparisons)]


def _change(comparison: Comparison) -> str:
    if comparison.metric.is_cost:
        text = comparison.metric.text(comparison.gain)
        return f"({text})" if comparison.verdict == "not judged" else text
    same = comparison.gain == comparison.low == comparison.high == 0
    return (
        f"{comparison.new:.3f} (same)"
        if same
        else f"{comparison.base:.3f} to {comparison.new:.3f} ({comparison.metric.text(comparison.gain)})"
    )
