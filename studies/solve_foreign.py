"""`stlbench solve` on other people's environments, as a new user types it.

python studies/solve_foreign.py [--seeds N] [NAME ...]    run those tries, 0 to N - 1, that have no row yet

Each has a row in results/solve/foreign.csv, and its folder under build/solve-foreign. It takes all cores, and the
minutes are of a clock: run nothing beside. A try with a row is not run again; delete the row for a new run. A person
writes the remark, what went wrong, after a look at the folder.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from itertools import product
from pathlib import Path
from statistics import median

import yaml
from row_by_row import add, rows

ROOT = Path(__file__).parents[1]
ROWS, FOLDERS = ROOT / "results" / "solve" / "foreign.csv", ROOT / "build" / "solve-foreign"
COLUMNS = (
    "environment",
    "formula",
    "minutes",
    "cpu",
    "code",
    "satisfied",
    "low",
    "trained_by",
    "fails_first",
    "said",
    "remark",
)
IDLE = "idle"
"""Per cent of the starts that the action zero, the best constant action and random actions satisfy."""
SEED, WALL = "seed", "wall"
"""The number of the try, and its seconds by a clock."""
MINUTES, WANTED = 3.0, 0.95
CLOCK = ROOT / "tests" / "benchmarks" / "cpu_clock"

PROBLEMS: dict[str, list[str]] = {
    "HalfCheetah-v5": ["F[0,100] G[0,100] vx >= 1"],
    "Ant-v5": ["F[0,100] G[0,50] vx >= 0.5 & G[0,150] z >= 0.3"],
    "Reacher-v5": ["F[0,30] G[0,19] d <= 0.05", "--signal", "d=sqrt(dx*dx + dy*dy)"],
    "gymnasium_robotics:FetchReach-v4": [
        "F[0,30] G[0,19] d <= 0.05",
        "--signal",
        "d=sqrt((obs[achieved_goal][0] - obs[desired_goal][0])*(obs[achieved_goal][0] - obs[desired_goal][0])"
        " + (obs[achieved_goal][1] - obs[desired_goal][1])*(obs[achieved_goal][1] - obs[desired_goal][1])"
        " + (obs[achieved_goal][2] - obs[desired_goal][2])*(obs[achieved_goal][2] - obs[desired_goal][2]))",
    ],
    "shimmy:dm_control/reacher-easy-v0": [
        "F[0,150] G[0,49] d <= 0.05",
        "--signal",
        "d=sqrt(obs[to_target][0]*obs[to_target][0] + obs[to_target][1]*obs[to_target][1])",
    ],
    "minigrid:MiniGrid-Empty-8x8-v0": ["F[0,60] front >= 7.5", "--signal", "front=obs[image][78]"],
    "highway_env:highway-fast-v0": ["G[0,30] crashed <= 0.5 & G[5,30] speed >= 24"],
    "solve_crossing:Crossing-v0": ["F[0,80] (abs(robot0 - 4) <= 0.3 & abs(robot1) <= 0.3) & G[0,80] clearance >= 0.5"],
    "Acrobot-v1": ["F[0,200] height >= 1", "--signal", "height=-cos1 - (cos1*cos2 - sin1*sin2)"],
}


def main() -> None:
    """Run what has no row."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("names", nargs="*", default=[])
    chosen = parser.parse_args()
    done = {(row["environment"], int(row[SEED])) for row in rows(ROWS)}
    for name, seed in product(chosen.names or PROBLEMS, range(chosen.seeds)):
        if (name, seed) not in done:
            arguments = [*PROBLEMS[name], "--seed", str(seed)]
            folder = "-".join([re.sub(r"\W+", "-", name), str(seed)])
            row = measured(name, arguments, FOLDERS / folder, MINUTES, alone=True)
            add(ROWS, (*COLUMNS, IDLE, SEED, WALL), [row | {SEED: str(seed)}])


def page() -> str:
    """The table of the page, in the order of the problems."""
    columns = ("environment", "formula", "zero, held, random action", "minutes", "starts satisfied, each run")
    known = rows(ROWS)
    lines = [f"| {' | '.join(columns)} | certified at 95 % | what went wrong |", "|---|---|--:|--:|--:|--:|---|"]
    for name in PROBLEMS:
        if runs := [row for row in known if row["environment"] == name]:
            formula, idle = runs[0]["formula"].replace("|", "\\|"), runs[0][IDLE]
            shares = [_share(row) for row in runs]
            certified = sum(float(row["low"] or 0) >= WANTED for row in runs)
            cells = [f"`{name}`", f"`{formula}`", f"{idle} %" if idle else "unknown"]
            cells += [f"{median(float(row[WALL]) for row in runs) / 60:.1f}", ", ".join(shares)]
            lines.append(f"| {' | '.join([*cells, f'{certified} of {len(runs)}', runs[0]['remark']])} |")
    return "\n".join(lines)


def _share(row: dict[str, str]) -> str:
    satisfied, _, starts = row["satisfied"].partition(" of ")
    return f"{100 * int(satisfied) / int(starts):.1f}".removesuffix(".0") + " %" if starts else "refused"


def measured(name: str, arguments: list[str], folder: Path, minutes: float, alone: bool = False) -> dict[str, str]:
    """Run the command, and read what it wrote: alone on all cores, or on one core by the clock of CPU time."""
    command = [sys.executable, "-m", "stlbench", "solve", name, *arguments, "--minutes", f"{minutes:g}"]
    paths = [str(ROOT / "studies"), *filter(None, [os.environ.get("PYTHONPATH")])]
    if not alone:
        command, paths = [*command, "--jobs", "1"], [str(CLOCK), *paths]
    before, clock = os.times(), time.perf_counter()
    run = subprocess.run(  # noqa: S603
        [*command, "--into", str(folder)],
        check=False,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"},
    )
    after, wall = os.times(), time.perf_counter() - clock
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "log").write_text(run.stderr + run.stdout, encoding="utf-8")
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    row = dict.fromkeys(COLUMNS, "") | {
        "environment": name,
        "formula": arguments[0],
        "minutes": f"{minutes:g}",
        "cpu": f"{cpu:.0f}",
        "code": str(run.returncode),
        WALL: f"{wall:.0f}",
    }
    if run.returncode:
        return row | {"said": run.stderr.strip().splitlines()[-1]}
    stated = yaml.safe_load((folder / "task" / "task.yaml").read_text(encoding="utf-8"))["baselines"]
    facts = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
    text = (folder / "solution.md").read_text(encoding="utf-8")
    failing = re.search(r"What fails first, from \d+ of \d+ starts: `(.*)`", text)
    notes = [
        line[2:] for line in text.splitlines() if re.match("- (trivial|impossible|no witness|a witness|left)", line)
    ]
    return row | {
        "satisfied": f"{facts['satisfied']} of {facts['starts']}",
        "low": f"{facts['low']:.4f}",
        "trained_by": facts["cell"].removeprefix("task/").removesuffix("/auto"),
        "fails_first": failing[1] if failing else "",
        "said": "; ".join(notes),
        IDLE: ", ".join(f"{100 * stated[each]['satisfied']:.0f}" for each in ("zero", "constant", "random")),
    }


if __name__ == "__main__":
    main()
