"""CPU seconds until 95 % of fresh starts are satisfied: `stlbench solve`, from nothing, and users of SB3 and rtamt.

Each contestant is a process of its own, one at a time. results/solve-race.jsonl gets a line as each ends. What is there
is not measured again, so an interrupted race goes on; delete the file for a new one.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks.conftest import Race
from benchmarks.solve_race import ENTRIES

pytestmark = pytest.mark.benchmark(group="solve")

CELLS, FOLDERS = Path("results/solve-race.jsonl"), Path("build/solve-race")
MINUTES = (3, 9)
"""Given to `solve`; the second goes on in the same folder, and only where the first does not suffice."""
LIMIT = 300.0
"""CPU seconds of a peer."""
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
    lines = CELLS.read_text(encoding="utf-8").splitlines() if CELLS.is_file() else []
    return {cell["contestant"]: cell for cell in map(json.loads, lines) if cell["task"] == task}


def _measured(task: str, contestant: str) -> Cell:
    """Run a contestant, and write its line."""
    name, _, minutes = contestant.partition("-")
    began = time.monotonic()
    if name == "solve":
        folder, entry = FOLDERS / task, ENTRIES[task]
        given = ["--minutes", minutes, "--jobs", "1", "--into", str(folder)]
        log = FOLDERS / f"{task}-{contestant}.log"
        cpu, code = _run([sys.executable, "-m", "stlbench", "solve", *entry.words, *given], log)
        wall = time.monotonic() - began
        facts = {"reached": False, "share": 0.0, "exit": code}
        if code == 0:
            facts |= _answer([task, "solve", str(folder)], FOLDERS / f"{task}-{contestant}.json")
        facts["cpu"] = round(cpu, 1)
    else:
        facts = _answer([task, name, str(SEED), str(LIMIT)], FOLDERS / f"{task}-{contestant}.json")
        wall = time.monotonic() - began
    cell = {"task": task, "contestant": contestant, "seed": SEED, "wall": round(wall, 1), **facts}
    CELLS.parent.mkdir(exist_ok=True)
    with CELLS.open("a", encoding="utf-8") as file:
        file.write(json.dumps(cell) + "\n")
    return cell


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
            command, stdout=printed, stderr=complaints, check=False, env=os.environ | {"PYTHONPATH": "tests"}
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
        figures[f"{name}_times"] = min(reached) / ours if reached else f"> {LIMIT / ours:.1f}"
    elif reached:
        figures[f"{name}_times"] = f"< {min(reached) / ours:.2f}"
    return figures
