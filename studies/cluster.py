"""The size of a cluster at which recording results becomes its bottleneck: costs per cell, measured; then simulated.

    python studies/cluster.py measure results/reference build/costs.json
    python studies/cluster.py draw build/costs.json results/reference docs/figures/cluster.svg

Measured, on one machine, with a scheduler and a worker by their own commands: processor seconds per cell of the parent
and of the scheduler. The cells do nothing and return as much as a real one. The cost to record a result durably is
measured too. Simulated: workers that are served by one scheduler and one parent, which do one thing at a time.
"""

from __future__ import annotations

import heapq
import json
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import psutil
from matplotlib.figure import Figure

from stlbench.records import results_folder
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import Result, from_json, to_json
from stlbench.report.figures.files import save_svg
from stlbench.report.figures.style import COLOURS, styled

CELLS = 300
WORKERS = (1, 3, 10, 30, 100, 300, 1000, 3000, 10_000)
LENGTHS = {"1 s": 1.0, "10 s": 10.0, "1 minute": 60.0, "10 minutes": 600.0}
ROUND_TRIP = 0.001
"""Seconds over a network, from a worker over the scheduler to the parent."""


# --------------------------------------------------------------------------------------------------------- measuring


def text_of(item: tuple[int, str]) -> str:
    """The result of a cell that does nothing."""
    return item[1]


@contextmanager
def cluster(folder: Path) -> Iterator[tuple[str, psutil.Process]]:
    """A scheduler and a worker: the address and the process of the first."""
    file, command = folder / "scheduler.json", [sys.executable, "-m", "dask"]
    scheduler = subprocess.Popen([*command, "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", file])  # noqa: S603
    worker = [*command, "worker", "--scheduler-file", file, "--nthreads", "2", "--no-nanny", "--memory-limit", "0"]
    started = subprocess.Popen([*worker, "--no-dashboard"], cwd=folder)  # noqa: S603
    try:
        while not (file.exists() and file.read_text().endswith("}")):
            time.sleep(0.1)
        yield json.loads(file.read_text())["address"], psutil.Process(scheduler.pid)
    finally:
        for process in (started, scheduler):
            process.terminate()
            process.wait()


def seconds_of(process: psutil.Process) -> float:
    """Processor seconds that a process has taken so far."""
    used = process.cpu_times()
    return float(used.user + used.system)


def engine_costs(folder: Path, text: str) -> dict[str, float]:
    """Processor seconds per cell of the parent and of the scheduler, without the ledger."""
    from stlbench_executors.dask import DaskExecutor

    with cluster(folder) as (address, scheduler):
        run = DaskExecutor(address=address).run(text_of, [(i, text) for i in range(CELLS)], [600.0] * CELLS)
        next(run)  # the first cell waits until all is imported and connected, and so does not count
        begun = time.process_time(), seconds_of(scheduler)
        count = sum(1 for _ in run)
        ended = time.process_time(), seconds_of(scheduler)
    parent, other = ((b - a) / count for a, b in zip(begun, ended, strict=True))
    return {"parent": parent, "scheduler": other}


def ledger_cost(folder: Path, result: Result) -> float:
    """Wall seconds to check a result and to record it durably: the median of many, on the disk of the folder."""
    took = list[float]()
    with Ledger(folder / LEDGER) as ledger:
        for number in range(CELLS):
            begin = time.perf_counter()
            ledger.record(from_json(to_json(replace(result, key=f"{number:032x}"))))
            took.append(time.perf_counter() - begin)
    return sorted(took)[len(took) // 2]


def measure(results: Path, file: Path) -> None:
    """Write the costs."""
    done = next(result for result in results_folder.read(results) if result.status == "done")
    with tempfile.TemporaryDirectory(dir=file.parent) as name:
        costs = engine_costs(Path(name), to_json(done)) | {"ledger": ledger_cost(Path(name), done)}
    file.write_text(json.dumps(costs, indent=2) + "\n")


# --------------------------------------------------------------------------------------------------------- simulating


def busy_share(workers: int, lengths: Sequence[float], costs: dict[str, float], cells: int) -> float:
    """The share of the workers' time in which they run cells, whose seconds are drawn from the lengths.

    It is taken when the last cell is sent: that workers have nothing to do at the end of a study is not the parent's.
    """
    drawn, running = random.Random(0), list[tuple[float, float]]()
    scheduler = parent = now = ran = 0.0
    for number in range(cells):
        if number >= workers:  # the next cell is sent when one has come back and is recorded
            now, length = heapq.heappop(running)
            ran += length
            scheduler = max(now, scheduler) + costs["scheduler"]
            parent = max(scheduler, parent) + costs["ledger"]
        parent += costs["parent"]
        length = drawn.choice(lengths)
        heapq.heappush(running, (max(now, parent) + ROUND_TRIP + length, length))
    ran += sum(max(0.0, now - (end - length)) for end, length in running)
    return ran / (workers * now)


@styled
def draw(costs: dict[str, float], results: Path, file: Path) -> None:
    """A line for each mean length; the spread of lengths is that of recorded cells."""
    measured = [
        result.measurement.training_wall_seconds for result in results_folder.read(results) if result.measurement
    ]
    mean = sum(measured) / len(measured)
    figure = Figure(figsize=(5.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for (name, length), colour in zip(LENGTHS.items(), COLOURS, strict=False):
        lengths = [seconds * length / mean for seconds in measured]
        shares = [busy_share(count, lengths, costs, 20 * count) for count in WORKERS]
        axes.plot(
            WORKERS,
            [100 * share for share in shares],
            marker="o",
            markersize=3.5,
            color=colour,
            label=f"cells of {name}",
        )
        print(name, *(f"{count}: {share:.2f}" for count, share in zip(WORKERS, shares, strict=True)))
    axes.set(xscale="log", xlabel="workers", ylabel="of their time in cells [%]", ylim=(0, 104))
    axes.axvline(1000, color="0.7", zorder=0)
    axes.legend()
    save_svg(figure, file)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["measure", results, file]:
            measure(Path(results), Path(file))
        case ["draw", file, results, figure]:
            draw(json.loads(Path(file).read_text()), Path(results), Path(figure))
        case _:
            sys.exit(__doc__)
