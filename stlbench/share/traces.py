"""Recorded traces in the place of a policy: of whatever acted, wherever it did."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError, did_you_mean
from stlbench.records.saved_traces import read_saved
from stlbench.rollout.early_ends import last_steps
from stlbench.rollout.referee import Episodes
from stlbench.rollout.trace_table import read_table
from stlbench.rollout.trace_times import times_of
from stlbench.rollout.worlds import make_world
from stlbench.task import Task


def load_traces(path: Path, task: Task) -> Episodes:
    """The episodes of a task's signals in a file: an .npz with several, or a table of text with one.

    If the environment may end an episode, a trace may be shorter, or have NaN at its end. It then is as the referee
    records it: its last sample stays, or there is NaN, as the task's `terminated` says. Raises `UsageError`.
    """
    if path.suffix.lower() == ".npz":
        saved = read_saved(path, read=task.signals)
        traces = saved.samples[..., _columns(path, saved.names, task)]
    else:
        traces = _table(path, task)
    rows, early = task.file.steps + 1, task.specification.can_end
    if traces.shape[1] > rows or (traces.shape[1] < rows and not early):
        rule = f"an episode of {task.name} has {rows}, one at the start and one after each step"
        raise UsageError(f"{path} has {traces.shape[1]} rows; {rule}")
    missing = np.full((len(traces), rows - traces.shape[1], traces.shape[2]), np.nan)
    return _ended(path, np.concatenate([traces, missing], axis=1), task)


def _ended(path: Path, traces: Array, task: Task) -> Episodes:
    """As the referee has them, from traces (N, T + 1, k) that have NaN after an early end."""
    early, steps = task.specification.can_end, np.arange(traces.shape[1])
    last = last_steps(traces) if early else np.full(len(traces), steps[-1])
    wrong = ~np.isfinite(traces) & (steps <= last[:, None])[..., None]
    if wrong.any():
        place = np.argwhere(wrong)[0]
        where = f"trace {place[0]}, row {place[1]}, {task.signals[place[2]]}"
        rule = "a finite number is expected" + (", or NaN in all signals from a row to the end" if early else "")
        raise UsageError(f"{path}: {where} is {traces[tuple(place)]}; {rule}")
    if task.file.terminated == "hold":
        traces = traces[np.arange(len(traces))[:, None], np.minimum(steps, last[:, None])]
    return Episodes(traces, last)


def _table(path: Path, task: Task) -> Array:
    table = read_table(path)
    columns = _columns(path, table.names, task)
    if task.specification.can_end:
        table = table.without_end(task.signals)
    if times := times_of(table, task.signals):
        times.check(task.file.sampling_time)
    traces: Array = table.samples(task.signals)[None][..., columns]
    return traces


def _columns(path: Path, names: tuple[str, ...], task: Task) -> list[int]:
    for signal in task.signals:
        if signal not in names:
            raise UsageError(f"{path} has no signal '{signal}'{did_you_mean(signal, names)}")
    return [names.index(signal) for signal in task.signals]


def from_the_reports_starts(traces: Array, task: Task) -> bool:
    """Whether traces begin where the report's do, so that their score can stand beside others."""
    starts = task.starts.report_and_selection()[0]
    if len(starts) != len(traces):
        return False
    world = make_world(task, len(starts))
    world.restart(np.arange(len(starts)), starts)
    return np.allclose(world.signals, traces[:, 0], rtol=0, atol=1e-6)
