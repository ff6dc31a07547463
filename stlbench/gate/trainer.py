"""Trains the cells that it reads, one after the other: a script that `turns` starts once for each of two revisions.

It runs with the stlbench of its revision, and so imports only names that every revision has. Each line of input is a
JSON object that names a cell; each gets a line of output. A fork of its own trains each cell: no cell sees what another
did, and a plugin that ends its process ends nothing else.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from stlbench.gate.snapshot import sample
from stlbench.registry.choices import parse_choice
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells
from stlbench.study.trial import run_cell
from stlbench.study.warm import warm

NUMBERS = ("robustness_mean", "satisfaction", "training_cpu_seconds", "reward_nanoseconds")

Answer = dict[str, Any]


def main() -> None:
    """Answer each line until the input ends. What plugins print goes to the standard error."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), file=answers, flush=True)


def answer(asked: Mapping[str, Any]) -> Answer:
    """Status, reason and numbers of one cell, and the files that its modules come from.

    A cell that cannot be planned, since its method is newer than this revision for example, has the status "unknown".
    """
    try:
        task, method, agent = ([parse_choice(asked[name])] for name in ("task", "method", "agent"))
        (cell,) = plan_cells(task, method, agent, [asked["seed"]], asked["budget"], asked["track"])
        warm([cell])
    except Exception as error:
        return {"status": "unknown", "reason": f"{type(error).__name__}: {error}"}
    context = get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_train, args=(cell, sender))
    child.start()
    sender.close()
    try:
        if not receiver.poll(cell.deadline):
            return {"status": "timeout", "reason": f"no result after {cell.deadline:g} s"}
        found: Answer = receiver.recv()
        return found
    except EOFError:
        return {"status": "killed", "reason": "its process ended without a result"}
    finally:
        child.kill()
        child.join()


def _train(cell: Cell, sender: Connection) -> None:
    try:
        found = sample(run_cell(cell))
        said: Answer = {"status": found.status, "reason": found.reason}
        said |= {name: getattr(found, name) for name in NUMBERS}
    except Exception as error:
        said = {"status": "raised", "reason": f"{type(error).__name__}: {error}"}
    files = {getattr(module, "__file__", None) for module in list(sys.modules.values())} - {None, __file__}
    sender.send(said | {"files": sorted(map(str, files))})


if __name__ == "__main__":
    main()
