"""Results of searches as tables, and as the files of a counterexample."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stlbench.records import npz, outputs
from stlbench.report.figures.counterexample import counterexample
from stlbench.report.figures.files import file_name, save
from stlbench.report.statistics.intervals import Interval
from stlbench.report.tables.table import Column, Table
from stlbench.search.certify import Certificate, plain
from stlbench.search.falsify import Falsification


def falsifications(results: Sequence[Falsification]) -> Table:
    """One row for each search: effort, least robustness, counterexample."""
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
            *(one.actor.name, one.how.optimiser, one.evaluations, one.worst.robustness),
            one.start_text(6) if one.found else None,
            one.first if one.found else None,
            one.failed if one.found or one.open else None,
            one.cpu_seconds,
        )
        for one in results
    )
    count, open_ = sum(one.found for one in results), sum(one.open for one in results)
    notes = [f"{count} of {len(results)} have a counterexample."]
    if open_:
        notes.append(f"Of {open_} the verdict is open: an episode ended early, and some continuations satisfy.")
    return Table("Falsification", columns, rows, tuple(notes))


def certificates(results: Sequence[Certificate]) -> Table:
    """One row for each certificate: the share of satisfied starts with its interval."""
    some_open = any(one.open for one in results)
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
            *(one.actor.name, plain(one.claim.confidence), one.starts, one.satisfied),
            *([one.open] if some_open else []),
            *(one.satisfied / one.starts, one.interval, _claim(one), one.verdict, one.cpu_seconds),
        )
        for one in results
    )
    notes = ("The probability is of satisfaction by every continuation: open verdicts do not count.",)
    return Table("Certificates", columns, rows, notes if some_open else ())


def _claim(result: Certificate) -> str | None:
    claim = result.claim
    if claim.at_least is not None:
        return f"at least {plain(claim.at_least)}"
    return None if claim.width is None else f"known to {plain(claim.width)}"


def write(result: Falsification, folder: Path) -> list[Path]:
    """Write the least robust trace as .npz and .csv, and its picture as PNG, SVG and PDF; the paths.

    The .npz has `traces` (1, T + 1, k), `signals` (k,), the names of the initial state's `coordinates` (n,) and its
    values `start` (n,). The .csv has a column for the time in seconds, and one for each signal.
    """
    kind = "counterexample" if result.found else "open" if result.open else "least"
    name = file_name(kind, *result.actor.label)
    paths = [_npz(result, folder / f"{name}.npz"), _csv(result, folder / f"{name}.csv")]
    recorded = result.worst.trace[: result.steps + 1]
    figure = counterexample(result.actor.task, recorded, result.witness, _title(result))
    return [*paths, *save(figure, folder, name)]


def _title(result: Falsification) -> str:
    word = "verdict open" if result.open else result.worst.verdict
    return f"{result.actor.name}: {word}, robustness {result.worst.robustness:.4g}, from {result.start_text(4)}"


def _npz(result: Falsification, path: Path) -> Path:
    names = {"signals": np.array(result.actor.task.signals), "coordinates": np.array(list(result.start))}
    npz.write(path, {**names, "traces": result.worst.trace[None], "start": result.worst.point})
    return path


def _csv(result: Falsification, path: Path) -> Path:
    task, text = result.actor.task, io.StringIO()
    own_time = "time" in task.signals
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*([] if own_time else ["time"]), *task.signals])
    for step, sample in enumerate(result.worst.trace.tolist()):
        writer.writerow([*([] if own_time else [round(step * task.file.sampling_time, 9)]), *sample])
    return outputs.write(path, text.getvalue())
