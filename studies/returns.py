"""The return of every recorded policy of a task by one method's reward, beside its robustness: is a plan the best?

A plan is computed on a grid, so another policy can be better by the very reward that was planned for. This rolls
nothing out: it reads the traces of a results folder, and sums the rewards along them, discounted from the start.

    python studies/returns.py results/alignment returns.csv
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stlbench.contract import Array, RewardMethod
from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.array_files import read_cell
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.simulation.environment import ends_of, first_end
from stlbench.task import build_method, load_task
from stlbench.task.task import Task
from stlbench_planning.sums import forever

COLUMNS = ("task", "method", "gamma", "policy", "return", "robustness", "own")


def main(folder: Path, written: Path) -> None:
    """Read the results of a folder and write one row per plan's reward and policy of its task."""
    done = [result for result in results_folder.read(folder) if result.measurement is not None]
    with written.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([COLUMNS, *_rows(done, folder)])


def _rows(done: list[Result], folder: Path) -> Iterator[tuple[object, ...]]:
    for plan in done:
        if plan.id.agent.name != "planner" or "resolution" in dict(plan.id.agent.parameters):
            continue
        task = load_task(plan.id.task)
        gamma = float(dict(plan.id.agent.parameters).get("gamma", task.recipe("planner").get("gamma", 0.95)))
        method = build_method(task, plan.id.method)
        if method.memory_size:
            continue
        for other in (other for other in done if other.id.track == plan.id.track):
            samples = _samples(other, plan.id.task, folder)
            if samples is not None and other.measurement is not None:
                value = float(discounted(task, method, samples, gamma).mean())
                robustness = other.measurement.selected["formula"].mean
                own = int(other.id == plan.id)
                yield plan.id.task, plan.id.method, gamma, other.id.name, f"{value:.9g}", f"{robustness:.9g}", own


def _samples(result: Result, task: Choice, folder: Path) -> Array | None:
    """The traces of a policy of the same task, or of an ablation of it; None where there are none."""
    if result.id.task.name != task.name:
        return None
    try:
        return read_cell(folder, result).samples
    except UsageError:
        return None


def discounted(task: Task, method: RewardMethod, samples: Array, gamma: float) -> Array:
    """The returns (N,) along traces (N, T + 1, k), by the rules of training episodes.

    An end is paid as if for ever, or for the decisions that are left where there is no discount. At the first cut the
    return stops.
    """
    hold, rows, ends = task.file.hold, len(samples), ends_of(task, method)
    returns, weight, alive = np.zeros(rows), 1.0, np.ones(rows, dtype=np.bool_)
    nothing, memory = np.zeros((rows, len(task.actions.names))), np.zeros((rows, 0))
    for t in range(0, task.file.steps, hold):
        rewards, _ = method.along(samples[:, t : t + hold + 1].transpose(1, 0, 2), nothing, np.full(rows, t), memory)
        over, paid = first_end(ends, samples[:, t + 1 : t + hold + 1], np.full(rows, t + hold))
        times = 1.0 if method.can_end else forever(1.0, gamma, (task.file.steps - t) // hold)
        ended = paid * (method.scale * times)
        returns += alive * weight * np.where(over, ended, rewards.mean(axis=0))
        alive &= ~over
        weight *= gamma
        if t + hold in task.file.training.cuts:
            break
    return returns


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
