"""`stlbench compare`: is one recording worse than another? And how `compare` and `gate` say so."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import Json, print_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stlbench.gate.comparison import Recording
    from stlbench.gate.judge import Comparison, Judgement
    from stlbench.report import Table

Named = tuple[str, "Recording"]
"""Where a recording lies, and what it holds."""


def compare(
    base: Annotated[Path, typer.Argument(metavar="BASE", help="Folder of results, ledger, or reference.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="The same of what is to be judged.")],
    as_json: Json = False,
) -> None:
    """Say whether NEW is worse than BASE.

    Cells are paired by task, method, agent, seed and budget; cells of NEW alone are left out. Exit codes: 0 no worse,
    1 worse, 3 these seeds cannot tell, 4 nothing measured or cells of BASE are missing, 2 bad input.

    \b
    Examples:
      stlbench compare results-before results-after
      stlbench compare results/gate-reference results/gate/ledger.sqlite --json
    """
    from stlbench.gate import comparison
    from stlbench.gate.judge import EXIT, judge

    both = (str(base), comparison.load(base)), (str(new), comparison.load(new))
    judgement = judge(comparison.pair(both[0][1], both[1][1]))
    if as_json:
        print_json(facts(judgement, *both))
    else:
        typer.echo(markdown("stlbench compare", judgement, *both), nl=False)
    raise typer.Exit(EXIT[judgement.verdict])


# ------------------------------------------------------------------------------------------------------------- JSON


def facts(judgement: Judgement, base: Named, new: Named) -> dict[str, Any]:
    """All that was found, as values that JSON has. Changes: robustness relative, satisfaction absolute, times x/y."""
    from stlbench.gate.judge import EXIT

    return {
        "verdict": judgement.verdict,
        "exit_code": EXIT[judgement.verdict],
        "base": _source(*base),
        "new": _source(*new),
        "notes": notes(base[1], new[1]),
        "comparisons": [_record(entry) for entry in judgement.comparisons],
        "findings": [vars(entry) for entry in judgement.findings],
    }


def _source(path: str, recording: Recording) -> dict[str, Any]:
    return {"path": path, "cells": len(recording.samples), "provenance": dict(recording.provenance)}


def _record(entry: Comparison) -> dict[str, Any]:
    metric, limits = entry.metric, sorted((entry.metric.change(entry.low), entry.metric.change(entry.high)))
    numbers = {
        "base": entry.base,
        "new": entry.new,
        "change": metric.change(entry.gain),
        "low": limits[0],
        "high": limits[1],
        "tolerated": metric.change(-metric.tolerated),
        "p_value": entry.chance,
    }
    group = dict(zip(("task", "method", "agent", "budget"), entry.group, strict=True))
    finite = {name: value if math.isfinite(value) else None for name, value in numbers.items()}
    return {**group, "metric": metric.name, "seeds": entry.seeds, **finite, "verdict": entry.verdict}


# --------------------------------------------------------------------------------------------------------- Markdown


def markdown(title: str, judgement: Judgement, base: Named, new: Named) -> str:
    """A summary for a terminal, a file, or the page of a CI job: the verdict, what led to it, and all groups."""
    from stlbench.report import to_markdown

    lines = [f"# {title}: {judgement.verdict}", "", _said("base", *base), _said("new", *new)]
    lines += [f"- {note}" for note in notes(base[1], new[1])]
    tables = [table for table in (_trouble(judgement), _groups(judgement)) if table.rows]
    return "\n".join([*lines, "", *(to_markdown(table) for table in tables)])


def _said(role: str, path: str, recording: Recording) -> str:
    provenance = ", ".join(f"{name} {value}" for name, value in recording.provenance.items())
    return f"- {role}: `{path}`, {len(recording.samples)} cells{'; ' if provenance else ''}{provenance}"


def notes(base: Recording, new: Recording) -> list[str]:
    """What a reader should know of the two before believing the verdict."""
    further = len(new.samples.keys() - base.samples.keys())
    uncalibrated = [
        name
        for name, recording in (("base", base), ("new", new))
        if not any(entry.calibration_seconds for entry in recording.samples.values())
    ]
    machines = {recording.provenance.get("machine") for recording in (base, new)}
    found = [
        (further, f"Cells of the new recording alone, which were not compared: {further}."),
        (uncalibrated, f"CPU times were not compared: no calibration in {' and '.join(uncalibrated)}."),
        (len(machines) > 1, "The two were measured on different machines: robustness differs by chance as well."),
        (
            len({recording.provenance.get("jobs") for recording in (base, new)}) > 1,
            "The two ran with different numbers of jobs, or one does not say; CPU times suffer from neighbours.",
        ),
    ]
    return [note for applies, note in found if applies]


def _trouble(judgement: Judgement) -> Table:
    """One row for whatever is not fine, the worst first."""
    from stlbench.gate.judge import EXIT
    from stlbench.report import Column, Table

    titles = ("verdict", "where", "metric", "base", "new", "change", "95 % limits", "tolerated", "seeds", "p", "reason")
    rows = [(EXIT[entry.verdict], _finding(entry.cell, entry.verdict, entry.reason)) for entry in judgement.findings]
    rows += [(EXIT[entry.verdict], _comparison(entry)) for entry in judgement.comparisons if EXIT[entry.verdict]]
    columns = tuple(Column(title, right=title not in ("verdict", "where", "metric", "reason")) for title in titles)
    return Table("What is not fine", columns, tuple(row for _, row in sorted(rows, key=lambda row: row[0])))


def _finding(cell: str, verdict: str, reason: str) -> tuple[str, ...]:
    return (verdict, cell, *["-"] * 8, reason or "-")


def _comparison(entry: Comparison) -> tuple[str, ...]:
    metric = entry.metric
    limits = sorted((entry.low, entry.high), key=metric.change)
    return (
        *(entry.verdict, "/".join(entry.group[:3]), metric.name, f"{entry.base:.4g}", f"{entry.new:.4g}"),
        *(metric.text(entry.gain), f"[{metric.text(limits[0])}, {metric.text(limits[1])}]"),
        *(metric.text(-metric.tolerated), str(entry.seeds), f"{entry.chance:.2g}", "-"),
    )


def _groups(judgement: Judgement) -> Table:
    """One row a group, one column a metric."""
    from stlbench.gate.judge import METRICS
    from stlbench.report import Column, Table

    found = {(entry.group, entry.metric.name): entry for entry in judgement.comparisons}
    groups = sorted({group for group, _ in found})
    names = [metric.name for metric in METRICS]
    titles = ("task", "method", "agent", "budget", "seeds", *names)
    columns = tuple(Column(title, right=place > 3) for place, title in enumerate(titles))
    rows = tuple((*group, *_row([found.get((group, name)) for name in names])) for group in groups)
    remarks = (
        "Robustness and satisfaction: mean over the paired seeds of base and new, and the change.",
        "CPU: seconds of training, new over base; reward: its cost a step; both over the calibration beside them.",
        "What is tolerated, and how it is tested: docs/ci.md.",
    )
    return Table("All groups", columns, rows, remarks)


def _row(entries: Sequence[Comparison | None]) -> list[str]:
    seeds = max((entry.seeds for entry in entries if entry), default=0)
    return [str(seeds), *("-" if entry is None else _cell(entry) for entry in entries)]


def _cell(entry: Comparison) -> str:
    if entry.metric.timing:
        return entry.metric.text(entry.gain)
    same = entry.gain == entry.low == entry.high == 0
    return (
        f"{entry.new:.3f} (same)" if same else f"{entry.base:.3f} to {entry.new:.3f} ({entry.metric.text(entry.gain)})"
    )
