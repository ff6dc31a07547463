"""CPU seconds until 95 % of fresh starts are satisfied: `stlbench solve`, from nothing, and users of SB3 and rtamt.

Each contestant is a process of its own, one at a time. results/solve/race.csv gets a line as each ends. What is there
is not measured again, so an interrupted race goes on; delete the file for a new one.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.conftest import Race
from benchmarks.solve_race import ENTRIES

pytestmark = pytest.mark.benchmark(group="solve")

CELLS, FOLDERS = Path("results/solve/race.csv"), Path("build/solve-race")
MINUTES = (3, 9)
"""Given to `solve`; the second goes on in the same folder, and only where the first does not suffice."""
COLUMNS = ("task", "contestant", "seed", "cpu", "reached", "share", "best", "decisions", "low", "cell")
LIMIT, LEAST, TIMES = 300.0, 60.0, 10
"""CPU seconds of a peer: so many times ours, at least and at most so many."""
PATH = os.pathsep.join(["tests", "tests/benchmarks/cpu_clock"])
"""The minutes of `solve` are CPU minutes, as other programs may run beside."""
SEED = 0
_PEERS = [(task, peer) for task, entry in ENTRIES.items() for peer in entry.peers]
Cell = dict[str, Any]


@pytest.mark.parametrize(
    ("task", "contestant"),
    [
        *((task, f"solve-{MINUTES[0]}") for task in ENTRIES),
        *_PEERS,
        *((task, f"solve-{MINUTES[1]}") for task in ENTRIES),
    ],
)
def test_solve(race: Race, task: str, contestant: str) -> None:
    """One cell; the last of a task's notes the figures of all."""
    cells = _cells(task)
    last = contestant == f"solve-{MINUTES[1]}"
    if contestant not in cells and not (last and cells[f"solve-{MINUTES[0]}"]["reached"]):
        cells[contestant] = _measured(task, contestant)
    race.run(lambda: None, {}, turns=1)
    if last:
        race.note(**_figures(f"solve_race_{task.replace('-', '_')}", cells))


def _cells(task: str) -> dict[str, Cell]:
    if not CELLS.is_file():
        return {}
    with CELLS.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["task"] == task]
    return {row["contestant"]: row | {"cpu": float(row["cpu"]), "reached": row["reached"] == "True"} for row in rows}


def _measured(task: str, contestant: str) -> Cell:
    """Run a contestant, and write its line."""
    name, _, minutes = contestant.partition("-")
    if name == "solve":
        folder, entry = FOLDERS / task, ENTRIES[task]
        given = ["--minutes", minutes, "--jobs", "1", "--into", str(folder)]
        log = FOLDERS / f"{task}-{contestant}.log"
        cpu, code = _run([sys.executable, "-m", "stlbench", "solve", *entry.words, *given], log)
        facts = {"reached": False, "share": 0.0, "exit": code}
        if code == 0:
            facts |= _answer([task, "solve", str(folder)], FOLDERS / f"{task}-{contestant}.json")
        facts["cpu"] = round(cpu, 1)
    else:
        facts = _answer([task, name, str(SEED), str(_limit(task))], FOLDERS / f"{task}-{contestant}.json")
    cell = {"task": task, "contestant": contestant, "seed": SEED, **facts}
    new = not CELLS.is_file()
    CELLS.parent.mkdir(parents=True, exist_ok=True)
    with CELLS.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(cell)
    return cell


def _limit(task: str) -> float:
    """CPU seconds of a peer on a task. `solve` comes first."""
    return min(LIMIT, max(LEAST, TIMES * _cells(task)[f"solve-{MINUTES[0]}"]["cpu"]))


def _answer(words: list[str], path: Path) -> Cell:
    _, code = _run([sys.executable, "-m", "benchmarks.solve_race", *words], path, path.with_suffix(".err"))
    assert code == 0, path.with_suffix(".err").read_text(encoding="utf-8")
    answer: Cell = json.loads(path.read_text(encoding="utf-8").splitlines()[-1])
    return answer


def _run(command: list[str], out: Path, err: Path | None = None) -> tuple[float, int]:
    """CPU seconds of the process and its children, and its exit code."""
    out.parent.mkdir(parents=True, exist_ok=True)
    before = os.times()
    with out.open("w") as printed, (err or out).open("a") as complaints:
        code = subprocess.run(
            command, stdout=printed, stderr=complaints, check=False, env=os.environ | {"PYTHONPATH": PATH}
        ).returncode
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system, code


def _figures(name: str, cells: dict[str, Cell]) -> dict[str, float | str]:
    """Seconds of `solve` and of each peer, and how many times ours the fastest peer took; a text where not reached."""
    tries = [cell for contestant, cell in cells.items() if contestant.startswith("solve")]
    ours, learned = sum(cell["cpu"] for cell in tries), tries[-1]["reached"]
    peers = {contestant: cell for contestant, cell in cells.items() if not contestant.startswith("solve")}
    figures: dict[str, float | str] = {f"{name}_solve": ours if learned else f"> {ours:.0f}"}
    for peer, cell in peers.items():
        figures[f"{name}_{peer}"] = cell["cpu"] if cell["reached"] else f"> {cell['cpu']:.0f}"
    reached = [cell["cpu"] for cell in peers.values() if cell["reached"]]
    if learned:
        tried = min(cell["cpu"] for cell in peers.values())
        figures[f"{name}_times"] = min(reached) / ours if reached else f"> {tried / ours:.1f}"
    elif reached:
        figures[f"{name}_times"] = f"< {min(reached) / ours:.2f}"
    return figures
