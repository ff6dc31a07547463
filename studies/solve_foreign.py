"""`stlbench solve` as a new user types it, on environments that were not used while it was written.

python studies/solve_foreign.py [NAME ...]    run those that have no row yet, one after another

Each has a row in results/solve/foreign.csv, and its folder under build/solve-foreign. The minutes are of CPU time, as
other programs may run beside. A task with a row is not run again; delete the row for a new run. A person writes the
remark, what went wrong, after a look at the folder.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

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
MINUTES = 3.0
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


def main(names: list[str]) -> None:
    """Run what has no row."""
    done = {row["environment"] for row in rows(ROWS)}
    for name in names or list(PROBLEMS):
        if name not in done:
            add(ROWS, (*COLUMNS, IDLE), [measured(name, PROBLEMS[name], FOLDERS / re.sub(r"\W+", "-", name), MINUTES)])


def page() -> str:
    """The table of the page, in the order of the problems."""
    columns = ("environment", "formula", "zero, held, random action", "minutes", "satisfied", "certificate, 95 %")
    head = f"| {' | '.join(columns)} | what went wrong |"
    lines = [head, "|---|---|--:|--:|--:|--:|---|"]
    known = {row["environment"]: row for row in rows(ROWS)}
    for name in PROBLEMS:
        if name in known:
            row = known[name]
            certificate = f"{100 * float(row['low']):.1f} %" if row["low"] else "none"
            formula = row["formula"].replace("|", "\\|")
            idle = f"{row[IDLE]} %" if row[IDLE] else "unknown"
            cells = [f"`{name}`", f"`{formula}`", idle, f"{float(row['cpu']) / 60:.1f}", row["satisfied"], certificate]
            lines.append(f"| {' | '.join([*cells, row['remark']])} |")
    return "\n".join(lines)


def measured(name: str, arguments: list[str], folder: Path, minutes: float) -> dict[str, str]:
    """Run the command, and read what it wrote."""
    command = [sys.executable, "-m", "stlbench", "solve", name, *arguments, "--minutes", f"{minutes:g}"]
    paths = [str(CLOCK), str(ROOT / "studies"), *filter(None, [os.environ.get("PYTHONPATH")])]
    before = os.times()
    run = subprocess.run(  # noqa: S603
        [*command, "--jobs", "1", "--into", str(folder)],
        check=False,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"},
    )
    after = os.times()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "log").write_text(run.stderr + run.stdout, encoding="utf-8")
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    row = dict.fromkeys(COLUMNS, "") | {
        "environment": name,
        "formula": arguments[0],
        "minutes": f"{minutes:g}",
        "cpu": f"{cpu:.0f}",
        "code": str(run.returncode),
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
    main(sys.argv[1:])
