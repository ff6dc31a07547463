"""Train the cells that are named on the standard input: a program that `turns` starts in each of two revisions.

Each revision runs its own copy, so this module keeps its name, and the lines of input and output their form: JSON
objects, one for each cell. A fork trains each cell: no cell sees what another did, and a plugin that ends its process
ends nothing else.
"""

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
from stlbench.study.plan import plan_cells, preload
from stlbench.study.trial import run_cell

Answer = dict[str, Any]


def main() -> None:
    """Answer each line until the input ends. Output of plugins goes to the standard error."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), file=answers, flush=True)


def answer(request: Mapping[str, Any]) -> Answer:
    """Status, reason and numbers of one cell, and the files of its modules.

    The status is "unknown" if the cell cannot be planned, for example since its method is newer than this revision.
    """
    try:
        task, method, agent = ([parse_choice(request[name])] for name in ("task", "method", "agent"))
        (cell,) = plan_cells(task, method, agent, [request["seed"]], request["budget"], request["track"])
        preload([cell])
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
        answer: Answer = receiver.recv()
        return answer
    except EOFError:
        return {"status": "killed", "reason": "its process ended without a result"}
    finally:
        child.kill()
        child.join()


def _train(cell: Cell, sender: Connection) -> None:
    try:
        measured = sample(run_cell(cell))
        answer: Answer = {"status": measured.status, "reason": measured.reason, **measured.numbers}
    except Exception as error:
        answer = {"status": "raised", "reason": f"{type(error).__name__}: {error}"}
    files = {getattr(module, "__file__", None) for module in list(sys.modules.values())} - {None}
    sender.send(answer | {"files": sorted(map(str, files))})


if __name__ == "__main__":
    main()
