"""CPU seconds until 95 % of fresh starts are satisfied: `stlbench solve`, from nothing, and users of SB3 and rtamt.

`cpu` ends with the first policy that satisfies them, and nobody's checks of it are counted. `whole` ends when `solve`
has trained anew, certified and written all files. Each contestant is a process of its own, one at a time.
results/solve/race.csv gets a line as each ends. What is there is not measured again, so an interrupted race goes on;
delete the file for a new one.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest
from helpers.studies import load

from benchmarks.conftest import Race
from benchmarks.solve_race import ENTRIES, WANTED
from stlbench.records import results_folder
from stlbench.solver.solution import FINAL, RACE

pytestmark = pytest.mark.benchmark(group="solve")

CELLS, FOLDERS = Path("results/solve/race.csv"), Path("build/solve-race")
MINUTES = (3, 9)
"""Given to `solve`; the second goes on in the same folder, and only where the first does not suffice."""
COLUMNS = ("task", "contestant", "seed", "cpu", "whole", "reached", "share", "best", "decisions", "low", "cell")
LIMIT, LEAST, TIMES = 300.0, 60.0, 10
"""CPU seconds of a peer: so many times ours, at least and at most so many."""
PATH = os.pathsep.join(["tests", "tests/benchmarks/cpu_clock"])
"""The minutes of `solve` are CPU minutes, as other programs may run beside."""
_LOOK = 0.2  # seconds between looks for a training that has ended
SEEDS = range(5)
Cell = dict[str, Any]


_FIRST, _LAST = (f"solve-{minutes}" for minutes in MINUTES)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("task", ENTRIES)
def test_solve(race: Race, task: str, seed: int) -> None:
    """The cells of a task and a seed; the last seed's notes the figures of all."""
    known = _cells(task, seed)
    for contestant in (_FIRST, *ENTRIES[task].peers, _LAST):
        if contestant not in known and not (contestant == _LAST and known[_FIRST]["reached"]):
            known[contestant] = _measured(task, contestant, seed)
    race.run(lambda: None, {}, turns=1)
    if seed == SEEDS[-1]:
        race.note(**_figures(f"solve_race_{task.replace('-', '_')}", load("race").cells(CELLS)[task]))


def _cells(task: str, seed: int) -> dict[str, Cell]:
    return load("race").cells(CELLS).get(task, {}).get(seed, {})


def _measured(task: str, contestant: str, seed: int) -> Cell:
    """Run a contestant, and write its line."""
    name, _, minutes = contestant.partition("-")
    place = FOLDERS / f"{task}-{seed}"
    log = place.with_name(f"{place.name}-{contestant}.log")
    if name == "solve":
        given = ["--minutes", minutes, "--jobs", "1", "--seed", str(seed), "--into", str(place)]
        words = [sys.executable, "-m", "stlbench", "solve", *ENTRIES[task].words, *given]
        facts = _solved(task, words, place, log)
    else:
        facts = _answer([task, name, str(seed), str(_limit(task, seed))], log.with_suffix(".json"))
    cell = {"task": task, "contestant": contestant, "seed": seed, **facts}
    load("row_by_row").add(CELLS, COLUMNS, [cell])
    return cell


def _solved(task: str, command: list[str], folder: Path, log: Path) -> Cell:
    """Run `solve`, and find the first of its trainings whose policy satisfies."""
    log.parent.mkdir(parents=True, exist_ok=True)
    ended, whole = dict.fromkeys(_trained(folder), 0.0), 0.0
    with log.open("w") as out:
        process = psutil.Popen(command, stdout=out, stderr=out, env=os.environ | {"PYTHONPATH": PATH})
        while process.poll() is None:
            time.sleep(_LOOK)
            whole = max(whole, _cpu(process))
            ended |= {key: whole for key in _trained(folder) if key not in ended}
    if process.returncode != 0:
        return {"cpu": round(whole, 1), "whole": round(whole, 1), "reached": False, "share": 0.0}
    facts = _answer([task, "solve", str(folder)], log.with_suffix(".json"))
    enough = [cpu for key, cpu in ended.items() if facts["trained"][key] >= WANTED]
    facts |= {"cpu": round(min(enough, default=whole), 1), "whole": round(whole, 1), "reached": bool(enough)}
    return facts


def _trained(folder: Path) -> list[str]:
    """The keys of the trainings that have ended well, in a folder of `solve`."""
    cells = [folder / name for name in (RACE, FINAL) if results_folder.locate(folder / name) is not None]
    return [each.key for place in cells for each in results_folder.read(place) if each.measurement is not None]


def _cpu(process: psutil.Process) -> float:
    """CPU seconds of a process and its children, those that have ended too; 0 where it has just ended itself."""
    try:
        times = [each.cpu_times() for each in (process, *process.children(recursive=True))]
    except psutil.NoSuchProcess:
        return 0.0
    return float(sum(each.user + each.system + each.children_user + each.children_system for each in times))


def _limit(task: str, seed: int) -> float:
    """CPU seconds of a peer on a task. `solve` comes first. A peer ends where another one before it was faster."""
    known = _cells(task, seed)
    reached = (known[peer]["cpu"] for peer in ENTRIES[task].peers if peer in known and known[peer]["reached"])
    return min(LIMIT, max(LEAST, TIMES * known[_FIRST]["cpu"]), *reached)


def _answer(words: list[str], path: Path) -> Cell:
    path.parent.mkdir(parents=True, exist_ok=True)
    command, err = [sys.executable, "-m", "benchmarks.solve_race", *words], path.with_suffix(".err")
    with path.open("w") as printed, err.open("a") as complaints:
        environ = os.environ | {"PYTHONPATH": PATH}
        code = subprocess.run(command, stdout=printed, stderr=complaints, check=False, env=environ).returncode
    assert code == 0, err.read_text(encoding="utf-8")
    answer: Cell = json.loads(path.read_text(encoding="utf-8").splitlines()[-1])
    return answer


def _figures(name: str, seeds: dict[int, dict[str, Cell]]) -> dict[str, str]:
    """Median seconds of `solve` and of each peer, and how many times ours the fastest peer took."""
    shown = load("race").medians(seeds)
    peers = {f"{name}_{peer}": seconds for peer, seconds in shown.peers.items()}
    return {f"{name}_solve": shown.seconds, **peers, f"{name}_times": shown.times}
