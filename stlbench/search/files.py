"""The files of a counterexample: its trace, as other traces are kept, and its picture."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from stlbench.records import npz, outputs
from stlbench.report.figures.counterexample import counterexample
from stlbench.report.figures.files import file_name, save
from stlbench.search.falsify import Falsification


def write(found: Falsification, folder: Path) -> list[Path]:
    """Write the least robust trace as .npz and .csv, and its picture as PNG, SVG and PDF; the paths.

    The .npz has `traces` (1, T + 1, k), `signals` (k,), the names of the initial state's `coordinates` (n,) and its
    values `start` (n,). The .csv has a column for the time in seconds, and one for each signal. `stlbench monitor`
    reads both.

    Raises:
        UsageError: the folder cannot be written.
    """
    kind = "counterexample" if found.found else "open" if found.open else "least"
    name = file_name(kind, *found.subject.label)
    paths = [_npz(found, folder / f"{name}.npz"), _csv(found, folder / f"{name}.csv")]
    recorded = found.worst.trace[: found.steps + 1]
    figure = counterexample(found.subject.task, recorded, found.witness, _title(found))
    return [*paths, *save(figure, folder, name)]


def _title(found: Falsification) -> str:
    word = "verdict open" if found.open else found.worst.verdict
    return f"{found.subject.name}: {word}, robustness {found.worst.robustness:.4g}, from {found.start_text(4)}"


def _npz(found: Falsification, path: Path) -> Path:
    names = {"signals": np.array(found.subject.task.signals), "coordinates": np.array(list(found.start))}
    npz.write(path, {**names, "traces": found.worst.trace[None], "start": found.worst.point})
    return path


def _csv(found: Falsification, path: Path) -> Path:
    task, text = found.subject.task, io.StringIO()
    own_time = "time" in task.signals
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*([] if own_time else ["time"]), *task.signals])
    for step, sample in enumerate(found.worst.trace.tolist()):
        writer.writerow([*([] if own_time else [round(step * task.file.sampling_time, 9)]), *sample])
    return outputs.write(path, text.getvalue())
