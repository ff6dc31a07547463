"""What the harness costs: planning, resuming and reporting 10,000 cells; its share beside training; two workers.

Everything here runs in processes of its own, start-up of Python included, and their CPU time is what counts.
"""

from __future__ import annotations

import itertools
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from helpers.synthetic_results import measurement

from benchmarks.conftest import Race, ratios
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import CurvePoint, Result
from stlbench.registry.choices import parse_choices
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells

SEEDS = 2500
METHODS = "funnel,flag,tau-mdp,raw"
CELLS = 4 * SEEDS
MATRIX, MINUTES_LONG = 20, 120.0
"""Cells, and CPU seconds of training of each, of the study for which the harness' share is given."""


def children_seconds() -> float:
    """CPU seconds of all processes that were started from here and have ended, and of theirs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


of_children = pytest.mark.benchmark(timer=children_seconds, group="harness")


@of_children
def test_plan(race: Race) -> None:
    """Plan 10,000 cells."""
    times = race.run(lambda: _python(_PLAN), {}, turns=3)["ours"]
    race.note(plan_10000_seconds=times)


@of_children
def test_resume(race: Race, full: Path) -> None:
    """Plan them, and find in the ledger that each is finished."""
    times = race.run(lambda: _python(_PLAN + _RESUME, str(full / LEDGER)), {}, turns=3)["ours"]
    race.note(resume_10000_seconds=times)


@of_children
def test_report(race: Race, full: Path) -> None:
    """`stlbench report`: every table and figure, of cells with 20 checkpoints. Memory is the peak of the process."""
    times = race.run(lambda: _stlbench("report", str(full)), {}, turns=3)["ours"]
    peak = int(_python(_PEAK, str(full)).split()[-1])
    race.note(report_10000_seconds=times, report_10000_peak_megabytes=peak / 1024)


@of_children
def test_overhead(race: Race, tmp_path: Path) -> None:
    """CPU seconds of `stlbench run` and of all its workers, above those of training.

    Runs of one cell and of three, of some ten seconds each, tell what a run costs and what each cell costs more, most
    of it the referee, who scores 20 checkpoints. Told as a share of a study of twenty cells of two minutes each.
    """
    once, each, share = list[float](), list[float](), list[float]()

    def both() -> None:
        one, three = (_overhead(tmp_path / f"{cells}-{len(once)}", cells) for cells in (1, 3))
        each.append((three - one) / 2)
        once.append(one - each[-1])
        share.append((once[-1] + MATRIX * each[-1]) / (MATRIX * MINUTES_LONG))

    race.run(both, {}, turns=2, warm_up=False)
    race.note(harness_run_seconds=once, harness_cell_seconds=each, harness_overhead_share=share)


def _overhead(folder: Path, cells: int) -> float:
    before = children_seconds()
    _run_cells(folder, cells, jobs=1)
    trained = sum(row.measurement.training_cpu_seconds for row in _results(folder) if row.measurement)
    return children_seconds() - before - trained


@pytest.mark.benchmark(timer=time.perf_counter, group="harness")
def test_two_workers(race: Race, tmp_path: Path) -> None:
    """Wall time with one worker over that with two, the same four cells. Needs two idle cores."""
    turn = itertools.count()
    one, two = (lambda jobs=jobs: _run_cells(tmp_path / str(next(turn)), 4, jobs) for jobs in (1, 2))
    times = race.run(two, {"one": one}, turns=2, clock=time.perf_counter, warm_up=False)
    race.note(two_workers_speedup=ratios(times["one"], times["ours"]))


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a ledger in which 10,000 cells are finished."""
    folder = tmp_path_factory.mktemp("full")
    cells = plan_cells(parse_choices("hold-disc"), parse_choices(METHODS), parse_choices("dqn"), range(SEEDS), "quick")
    with Ledger(folder / LEDGER) as ledger:
        for cell in cells:
            ledger.record(_finished(cell))
    return folder


def _finished(cell: Cell) -> Result:
    """As large as a real one: 64 starts, four protocols, 20 checkpoints."""
    robustness = [0.1 + 0.0003 * (cell.id.seed % 97) + 0.001 * start for start in range(64)]
    curve = tuple(CurvePoint(12_000 * i, 0.1 * i, i / 20, 0.01 * i, 64) for i in range(1, 21))
    measured = measurement(robustness, further=dict.fromkeys(("paper", "tail", "centre"), robustness), curve=curve)
    facts = {"jobs": "1", "machine": "made up", "python": "3.11"}
    return Result(cell.id, cell.key, "done", measurement=measured, provenance=facts)


def _run_cells(folder: Path, seeds: int, jobs: int) -> None:
    options = {"tasks": "robot-nav", "methods": "funnel", "seeds": seeds, "budget": "quick", "jobs": jobs}
    _stlbench("run", "--results", str(folder), *(f"--{name}={value}" for name, value in options.items()))


def _results(folder: Path) -> Sequence[Result]:
    with Ledger(folder / LEDGER, create=False) as ledger:
        return tuple(ledger.results())


def _stlbench(*arguments: str) -> str:
    return _python("import sys; from stlbench.cli import main; sys.exit(main())", *arguments)


def _python(program: str, *arguments: str) -> str:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


_PLAN = f"""
import sys
from stlbench.registry.choices import parse_choices
from stlbench.study.plan import plan_cells
tasks, methods, agents = map(parse_choices, ("hold-disc", "{METHODS}", "dqn"))
cells = plan_cells(tasks, methods, agents, range({SEEDS}), "quick")
assert len(cells) == {CELLS}
"""

_RESUME = f"""
from pathlib import Path
from stlbench.records.ledger import LEDGER, Ledger
with Ledger(Path(sys.argv[1]), create=False) as ledger:
    assert len(ledger.finished(cell.key for cell in cells)) == {CELLS}
"""

_PEAK = """
import resource, sys
from stlbench.cli import main
sys.argv = ["stlbench", "report", sys.argv[1]]
try:
    main()
except SystemExit:
    pass
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
