"""The file of a cell's traces, which the referee recorded.

It is an .npz with `traces` (N, T + 1, k) and `signals` (k,), their names. For films, `extremes` (2,) are the numbers of
the best and the worst start, and `states` (2, decisions + 1, n) the states on the way from them.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stlbench.contract import Array, Integers
from stlbench.errors import UsageError, one_line
from stlbench.records import npz
from stlbench.records.outputs import cell_files, inside
from stlbench.records.result import MAIN, Result, Score
from stlbench.stl.predicates.samples import as_floats


class Assessment(NamedTuple):
    """The referee's scores of one policy, with the traces."""

    scores: dict[str, Score]  # protocol -> score
    traces: Array  # (N, T + 1, k): the traces behind the main score
    states: Array  # (N, decisions + 1, n): the states behind them, at each decision and at the end


class Film(NamedTuple):
    """The states on the way from the best and the worst start of a cell, or from its only start."""

    starts: Integers  # (2,) or (1,): which starts they are
    states: Array  # (2 or 1, decisions + 1, n): at each decision and at the end


class SavedTraces(NamedTuple):
    """Samples (N, T + 1, k) of k named signals from N starts."""

    names: tuple[str, ...]
    samples: Array
    film: Film | None = None  # None if the file has no states


def save(path: Path, assessment: Assessment, signals: tuple[str, ...]) -> None:
    robustness = assessment.scores[MAIN].robustness
    extremes = np.array([np.argmax(robustness), np.argmin(robustness)])
    named = {"traces": assessment.traces, "signals": np.array(signals)}
    npz.write(path, {**named, "extremes": extremes, "states": assessment.states[extremes]})


def save_samples(path: Path, samples: Array, signals: tuple[str, ...]) -> None:
    """Write traces (N, T + 1, k) of which no more is known."""
    npz.write(path, {"traces": samples, "signals": np.array(signals)})


def read_cell(results: Path, result: Result) -> SavedTraces:
    """The traces of a cell in a folder of results. Raises `UsageError` if there is no file, and as `read_saved`."""
    path = cell_files(results, result.id, result.key).traces
    if not inside(path, results, "read").is_file():
        raise UsageError(f"{result.id.name} has no traces at {path}; `stlbench run` records them when it trains a cell")
    saved = read_saved(path, results)
    if result.measurement and len(saved.samples) != (starts := result.measurement.selected[MAIN].starts):
        raise UsageError(f"{path}: it has traces from {len(saved.samples)} starts, and its row says {starts}")
    return saved


def read_saved(path: Path, folder: Path | None = None, read: Collection[str] | None = None) -> SavedTraces:
    """The traces of a file that `stlbench run` wrote; of the signals `read`, or of all, no value is rounded.

    Raises `UsageError` if it is none, and as `npz.read`.
    """
    try:
        arrays = npz.read(path, folder=folder)
        names = tuple(map(str, arrays["signals"].tolist()))
        samples = as_floats(arrays["traces"], names, read)
        film = Film(arrays["extremes"], arrays["states"]) if "states" in arrays else None
    except KeyError as error:
        raise UsageError(f"cannot read {path} as traces of stlbench: it has no {error}") from error
    except (ValueError, TypeError) as error:
        raise UsageError(f"cannot read {path} as traces of stlbench: {one_line(error)}") from error
    if samples.ndim != 3 or 0 in samples.shape or samples.shape[2] != len(names):
        raise UsageError(f"{path}: traces have shape (starts, steps, {len(names)} signals), got {samples.shape}")
    if film is not None and not _fits(film, len(samples)):
        raise UsageError(f"{path}: states have shape (extremes, decisions + 1, n), and extremes are numbers of starts")
    return SavedTraces(names, samples, film)


def _fits(film: Film, starts: int) -> bool:
    if film.states.ndim != 3 or film.states.shape[1] < 2 or film.starts.shape != film.states.shape[:1]:
        return False
    return film.starts.dtype.kind in "iu" and bool(np.all((film.starts >= 0) & (film.starts < starts)))
