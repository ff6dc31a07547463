"""Results of searches as tables, and as the files of a counterexample."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from stlbench.records import array_files, result_files
from stlbench.report.figures.files import file_name, save
from stlbench.report.tables.table import Column, Table, Value
from stlbench.search.certify import Certificate, plain
from stlbench.search.falsify import Falsification
from stlbench.statistics.intervals import Interval


def falsifications(results: Sequence[Falsification]) -> Table:
    """One row for each search: effort, least robustness, counterexample."""
    columns: dict[Column, Callable[[Falsification], Value]] = {
        Column("searched", right=False): lambda one: one.actor.name,
        Column("optimiser", right=False, shared=True): lambda one: one.how.optimiser,
        Column("evaluations"): lambda one: one.evaluations,
        Column("least robustness", "least"): lambda one: one.worst.robustness,
        Column("counterexample", right=False): lambda one: one.start_text(6) if one.found else None,
        Column("first counterexample", "first", drop=1): lambda one: one.first if one.found else None,
        Column("failed", right=False, drop=2): lambda one: one.failed if one.found or one.open else None,
        Column("CPU", unit="s", digits=1): lambda one: one.cpu_seconds,
    }
    count, open_ = sum(one.found for one in results), sum(one.open for one in results)
    notes = [f"{count} of {len(results)} have a counterexample."]
    if open_:
        notes.append(f"{open_} have an open verdict: an episode ended early, and some continuations satisfy.")
    return Table.of("Falsification", results, columns, tuple(notes))


def certificates(results: Sequence[Certificate]) -> Table:
    """One row for each certificate: the share of satisfied starts with its interval."""
    columns: dict[Column, Callable[[Certificate], Value]] = {
        Column("certified", right=False): lambda one: one.actor.name,
        Column("confidence", right=False, shared=True): lambda one: plain(one.claim.confidence),
        Column("starts"): lambda one: one.starts,
        Column("satisfied"): lambda one: one.satisfied,
        Column("open"): lambda one: one.open,
        Column("held"): lambda one: one.held,
        Column("probability", digits=4): lambda one: one.satisfied / one.starts,
        Column("interval", digits=4, kind=Interval): lambda one: one.interval,
        Column("claim", right=False, shared=True): lambda one: one.claim.text,
        Column("verdict", right=False): lambda one: one.verdict,
        Column("CPU", unit="s", digits=1): lambda one: one.cpu_seconds,
    }
    notes = {
        "open": "The probability is of satisfaction by every continuation: open verdicts do not count.",
        "held": "`held` satisfy only because the last sample stays after the environment ended the episode.",
    }
    used = {title for title in notes if any(getattr(one, title) for one in results)}
    shown = {column: value for column, value in columns.items() if column.title in used or column.title not in notes}
    return Table.of("Certificates", results, shown, tuple(notes[title] for title in notes if title in used))


def write(result: Falsification, folder: Path) -> list[Path]:
    """Write the least robust trace as .npz and .csv, and its picture as PNG, SVG and PDF; the paths.

    The .npz has `traces` (1, T + 1, k), `signals` (k,), the names of the initial state's `coordinates` (n,) and its
    values `start` (n,). The .csv has a column for the time in seconds, and one for each signal.
    """
    from stlbench.report.figures.margins import counterexample  # imports Matplotlib, which no search needs

    kind = "counterexample" if result.found else "open" if result.open else "least"
    name = file_name(kind, *result.actor.label)
    task, trace = result.actor.task, result.worst.trace
    arrays = {"signals": np.array(task.signals), "coordinates": np.array(list(result.start))}
    array_files.write_arrays(folder / f"{name}.npz", {**arrays, "traces": trace[None], "start": result.worst.point})
    times = [[round(step * task.file.sampling_time, 9)] for step in range(len(trace))]
    titles, times = (["time"], times) if "time" not in task.signals else ([], [[]] * len(trace))
    rows = ([*time, *sample] for time, sample in zip(times, trace.tolist(), strict=True))
    result_files.write(folder / f"{name}.csv", result_files.csv_text([[*titles, *task.signals], *rows]))
    word = "verdict open" if result.open else result.worst.verdict
    title = f"{result.actor.name}: {word}, robustness {result.worst.robustness:.4g}, from {result.start_text(4)}"
    figure = counterexample(task, trace[: result.steps + 1], result.witness, title)
    return [folder / f"{name}.npz", folder / f"{name}.csv", *save(figure, folder, name)]
