"""How often `stlbench gate --against` errs, by real runs: equal code, code that costs 1.3 times, code that loses 10 %.

    python studies/gate_pairs.py --machine idle --equal 40 --slower 60 --worse 60
    python studies/gate_pairs.py --machine loaded --busy 4 --equal 40 --slower 60 --worse 60

Each run is a whole gate of one cheap setting, in a clone of this repository's last commit. In the clones `slower` and
`worse` the working tree differs from the commit by a patch. The runs are in results/gate-pairs: a row per run in
runs.csv, a row per turn in turns.csv. The same command runs those that are missing there, and prints a table that
docs/howto/share.md sums up. A run takes half a minute on an idle machine.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from row_by_row import add, rows

ROOT = Path(__file__).parents[1]
CLONES, TABLES = ROOT / "build" / "gate-pairs", ROOT / "results" / "gate-pairs"
SETTING = {"--tasks": "hold-disc", "--methods": "raw"}
RUN = (
    "machine",
    "code",
    "run",
    "load",
    "seconds",
    "exit",
    "robustness",
    "CPU",
    "reward",
    "turns",
    "ratio",
    "reward_ratio",
)
TURN = ("machine", "code", "run", "turn", "CPU", "reward")

SLOWER = """

def _slower(self, training, train=DQN.train):
    import time

    begin = time.process_time()
    policy = train(self, training)
    end = time.process_time()
    while time.process_time() < end + 0.3 * (end - begin):
        pass
    return policy


DQN.train = _slower
"""
"""Burns three tenths of what each training took."""

WORSE = """

def _worse(self, mean=Score.mean.fget):
    return 0.9 * mean(self)


Score.mean = property(_worse)
"""
"""Takes a tenth off each robustness, which is positive in this setting."""

NEIGHBOUR = "import numpy as np\na = np.ones((300, 300))\nwhile True: a @ a"

PATCHES: Mapping[str, tuple[str, str]] = {
    "equal": ("README.md", ""),
    "slower": ("plugins/stlbench_agents/dqn.py", SLOWER),
    "worse": ("stlbench/records/result.py", WORSE),
}


def clone(code: str) -> Path:
    """A clone of the last commit, whose working tree has the patch."""
    place = CLONES / code
    if not place.exists():
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(place)], check=True)  # noqa: S603, S607
        file, patch = PATCHES[code]
        with (place / file).open("a", encoding="utf-8") as opened:
            opened.write(patch)
    return place


def gate(place: Path, results: Path) -> tuple[int, dict[str, Any]]:
    """Run the gate of the clone on itself; its exit code, and what it wrote."""
    paths = os.pathsep.join(str(place / part) for part in ("", "plugins", "tasks"))
    words = [word for pair in SETTING.items() for word in pair]
    program = "import sys; from stlbench.cli import main; sys.exit(main())"
    command = [sys.executable, "-P", "-c", program, "gate", "--against", "HEAD", "--results", str(results), *words]
    ended = subprocess.run(  # noqa: S603
        command, cwd=place, env={**os.environ, "PYTHONPATH": paths}, check=False, capture_output=True, text=True
    )
    if ended.returncode not in (0, 1, 3):
        sys.exit(f"{' '.join(command)}: {ended.stderr}")
    return ended.returncode, json.loads((results / "gate.json").read_text(encoding="utf-8"))


def run(machine: str, code: str, number: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """One run as a row, and its turns as rows."""
    begin, load = time.monotonic(), os.getloadavg()[0]
    exit_code, found = gate(clone(code), CLONES / f"{machine}-{code}-{number}")
    metrics = {comparison["metric"]: comparison for comparison in found["comparisons"]}
    named = {"machine": machine, "code": code, "run": number}
    row = named | {
        "load": f"{(load + os.getloadavg()[0]) / 2:.1f}",
        "seconds": round(time.monotonic() - begin),
        "exit": exit_code,
        "turns": metrics["CPU"]["pairs"],
        "ratio": f"{metrics['CPU']['change']:.3f}",
        "reward_ratio": f"{metrics['reward']['change']:.3f}",
        **{name: metrics[name]["verdict"] for name in ("robustness", "CPU", "reward")},
    }
    pairs = zip(metrics["CPU"]["turns"], metrics["reward"]["turns"], strict=True)
    turns = [
        named | {"turn": turn, "CPU": f"{cpu:.4f}", "reward": f"{reward:.4f}"}
        for turn, (cpu, reward) in enumerate(pairs, start=1)
    ]
    return row, turns


def main() -> None:
    """Run what is missing, and print the table that docs/howto/share.md sums up."""
    parser = argparse.ArgumentParser(description="Errors of `stlbench gate --against` in real runs.")
    parser.add_argument("--machine", required=True, help="what else it does: idle, loaded")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="processes that compute beside the runs")
    for code in PATCHES:
        parser.add_argument(f"--{code}", type=int, default=0, metavar="N", help="runs")
    wanted = vars(parser.parse_args())
    machine, busy = wanted.pop("machine"), wanted.pop("busy")
    TABLES.mkdir(parents=True, exist_ok=True)
    neighbours = [subprocess.Popen([sys.executable, "-c", NEIGHBOUR]) for _ in range(busy)]  # noqa: S603
    try:
        run_missing(machine, wanted)
    finally:
        for neighbour in neighbours:
            neighbour.kill()
    print("\n".join(table()))


def run_missing(machine: str, wanted: Mapping[str, int]) -> None:
    """So many runs of each code, the first of each first, but for those that are recorded."""
    for number in range(1, max(wanted.values()) + 1):
        for code in (code for code, count in wanted.items() if number <= count):
            done = {(row["machine"], row["code"], row["run"]) for row in rows(TABLES / "runs.csv")}
            if (machine, code, str(number)) not in done:
                row, turns = run(machine, code, number)
                add(TABLES / "turns.csv", TURN, turns)
                add(TABLES / "runs.csv", RUN, [row])


def table() -> Iterator[str]:
    """How the runs of each kind ended, as Markdown."""
    recorded = rows(TABLES / "runs.csv")
    yield "| machine | code | runs | exit codes | CPU | robustness |"
    yield "|---|---|---|---|---|---|"
    for machine, code in sorted({(row["machine"], row["code"]) for row in recorded}):
        own = [row for row in recorded if (row["machine"], row["code"]) == (machine, code)]
        counts = [Counter(row[name] for row in own) for name in ("exit", "CPU", "robustness")]
        said = [", ".join(f"{name}: {count}" for name, count in sorted(each.items())) for each in counts]
        yield f"| {machine} | {code} | {len(own)} | {' | '.join(said)} |"


if __name__ == "__main__":
    main()
