"""What a study of very many cells costs: to plan it, to find what is missing, to report it.

    python tests/long/scale.py fill --cells 100000 --folder build/scale
    python tests/long/scale.py resume --cells 100000 --folder build/scale
    python tests/long/scale.py report --folder build/scale
    python tests/long/scale.py page --folder build/scale

`fill` writes a ledger with a result of each cell, of the size of real ones. The others print processor seconds, wall
seconds and the most memory that the process took.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from stlbench.cli.report import report
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger, _insert
from stlbench.records.result import MAIN, RANDOM, CurvePoint, Measurement, Result, Score
from stlbench.records.schema import values
from stlbench.registry.choices import parse_choices
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells
from stlbench.study.run import build_executor, run_cells

__all__ = ["main"]

TASKS = "hold-disc,integrator-or,reach-stay,annulus,pendulum"
METHODS = "funnel,flag,tau-mdp,raw"
BLOCK = 1000
"""Rows that are written in one transaction."""
STARTS, CHECKPOINTS = 64, 20


@contextmanager
def measured(what: str) -> Iterator[None]:
    """Print what it took."""
    cpu, wall = time.process_time(), time.perf_counter()
    yield
    spent = time.process_time() - cpu, time.perf_counter() - wall
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{what}: {spent[0]:.2f} s of processor, {spent[1]:.2f} s of wall, {most:.0f} MiB", flush=True)


def planned(count: int) -> tuple[Cell, ...]:
    """The cells of a study of five tasks and four methods."""
    chosen = map(parse_choices, (TASKS, METHODS, "dqn"))
    return plan_cells(*chosen, range(count // 20), "quick")


def result_of(cell: Cell, rng: np.random.Generator) -> Result:
    """A result with as many numbers as a real one has."""
    values = rng.normal(0.2, 0.3, STARTS)
    score = Score(tuple(values.tolist()), tuple((values > 0).tolist()), {"F[0,40] near": int((values <= 0).sum())})
    scores = {MAIN: score, RANDOM: score.summarised()}
    curve = tuple(CurvePoint(500 * (i + 1), 0.4 * i, rng.random(), rng.normal(), 64) for i in range(CHECKPOINTS))
    seconds = rng.uniform(5, 15, 4).tolist()
    numbers = Measurement(scores, scores, 10_000, curve, *seconds, 10_000, rng.uniform(10, 90), 1)
    facts = {"python": "3.11.7", "numpy": "2.3.0", "machine": "Linux x86_64, 2 CPUs", "jobs": "2", "time": "2026"}
    return Result(cell.id, cell.key, "done", measurement=numbers, provenance=facts)


def fill(folder: Path, cells: Sequence[Cell]) -> None:
    """Write a ledger with all of them."""
    rng = np.random.default_rng(0)
    with Ledger(folder / FILE) as ledger:
        ledger.plan({cell.key: cell.id for cell in cells})
        for begin in range(0, len(cells), BLOCK):
            with ledger._writing() as database:  # one transaction for many rows, which no run does
                for cell in cells[begin : begin + BLOCK]:
                    _insert(database, values(result_of(cell, rng), folder, 0))


class _Told:
    """Says when it is known what is missing."""

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        print(f"{len(missing)} cells are missing, {done} are done")
        if missing:
            raise SystemExit("fill the folder first: what is missing would be trained")

    def note(self, text: str) -> None:
        print(text)

    def ended(self, result: Result) -> None: ...


def main() -> None:
    """See the top of this file."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("what", choices=("fill", "resume", "report", "page"))
    options.add_argument("--cells", type=int, default=100_000)
    options.add_argument("--folder", type=Path, default=Path("build/scale"))
    said = options.parse_args()
    if said.what in ("report", "page"):
        with measured(said.what):
            report([said.folder], html=said.what == "page", as_json=False)
        return
    with measured("plan"):
        cells = planned(said.cells)
    with measured(said.what):
        if said.what == "fill":
            fill(said.folder, cells)
        else:
            run_cells(cells, said.folder, build_executor("local", 2), progress=_Told())


if __name__ == "__main__":
    main()
