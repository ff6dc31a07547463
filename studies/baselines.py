"""Measure the baselines of the built-in tasks and write them into their task files, under `baselines`.

    python studies/baselines.py [TASK ...]

Without names all tasks of stlbench are measured, some minutes of CPU time: the action zero, the best constant action
and actions at random, from the report's starts. A report reads these numbers and simulates nothing.
"""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

from stlbench.records.result import Score
from stlbench.registry import plugins
from stlbench.simulation import baselines
from stlbench.task import load_task

FOLDER = Path(__file__).resolve().parent.parent / "tasks" / "stlbench_tasks"
_BLOCK, _BEFORE = re.compile(r"^baselines:\n(?:  .*\n)+", re.MULTILINE), re.compile(r"^budgets:", re.MULTILINE)


def block(name: str) -> str:
    """The lines of a task file, measured now."""
    stated = load_task(name)
    task = replace(stated, file=stated.file.model_copy(update={"baselines": None}))
    found = baselines.constants(task)
    action = ", ".join(f"{value:.6g}" for value in found.action)
    lines = [
        f"  zero: {{{_numbers(found.zero)}}}",
        f"  constant: {{{_numbers(found.best)}, action: [{action}]}}",
        f"  random: {{{_numbers(baselines.at_random(task))}}}",
    ]
    return "\n".join(["baselines:", *lines, ""])


def _numbers(score: Score) -> str:
    return f"robustness: {score.mean:.6g}, satisfied: {score.satisfaction:.6g}"


def write(name: str) -> None:
    """Put the block into the task file: in the place of the one that is there, else before the budgets."""
    path = FOLDER / name.replace("-", "_") / "task.yaml"
    lines = block(name)
    text = path.read_text(encoding="utf-8")
    print(f"{name}\n{lines}", flush=True)
    if _BLOCK.search(text):
        path.write_text(_BLOCK.sub(lambda _: lines, text), encoding="utf-8")
    else:
        path.write_text(_BEFORE.sub(lambda _: f"{lines}budgets:", text, count=1), encoding="utf-8")


if __name__ == "__main__":
    for task_name in sys.argv[1:] or plugins.available("tasks"):
        write(task_name)
