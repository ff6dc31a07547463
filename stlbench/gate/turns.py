"""Train the same cells by turns with the code of two trees: base, change, change, base, and so on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Collection
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryFile
from types import TracebackType
from typing import Any, Self

from stlbench.errors import UsageError, one_line
from stlbench.gate.cost import Turn, unclear
from stlbench.gate.revision import Tree
from stlbench.gate.snapshot import Sample
from stlbench.records.identity import CellId

SCRIPT = Path(__file__).with_name("trainer.py")


def take_turns(cells: Collection[CellId], base: Tree, new: Tree, say: Callable[[str], None]) -> list[Turn]:
    """Train each cell with both trees, and those settings again whose costs cannot be told yet.

    One training runs at a time. Settings take turns as well, so that what else the machine does meets all of them.

    Args:
        cells: which.
        base: the tree before the change.
        new: the tree after it.
        say: is told of each round, in a line.

    Raises:
        UsageError: a tree cannot train at all, or the base runs code of the change.
    """
    turns: list[Turn] = []
    waiting, number = sorted(cells, key=lambda cell: (cell.seed, cell)), 0
    while waiting:
        number += 1
        cells_said = f"{len(waiting)} {'cell' if len(waiting) == 1 else 'cells'}"
        say(f"round {number}: {cells_said}, each by {base.name} and by {new.name}")
        with ExitStack() as stack:  # new processes in each round: one that happens to be slow does not stay
            trainers = [stack.enter_context(Trainer(*trees)) for trees in ((base, new), (new, base))]
            turns += [_turn(cell, number, *trainers) for cell in waiting]
        settings = unclear(turns)
        waiting = [cell for cell in waiting if cell.setting in settings]
    return turns


def _turn(cell: CellId, number: int, base: Trainer, new: Trainer) -> Turn:
    if (cell.seed + number) % 2:
        before, after = base.train(cell), new.train(cell)
    else:
        after, before = new.train(cell), base.train(cell)
    return Turn(cell, number, before, after)


class Trainer:
    """A process that trains with the code of one tree (`stlbench.gate.trainer`).

    Args:
        tree: whose code it runs.
        other: whose code it must not run.
    """

    def __init__(self, tree: Tree, other: Tree) -> None:
        self.tree, self.other = tree, other
        self.errors = TemporaryFile()  # noqa: SIM115 - closed at the end of this context
        self.process = subprocess.Popen(  # noqa: S603 - our own script
            [sys.executable, "-P", str(SCRIPT)],
            cwd=tree.root,
            env=dict(tree.environment),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)  # and with it the process of a cell that still trains
        self.process.communicate()
        self.errors.close()

    def train(self, cell: CellId) -> Sample | None:
        """The cell's numbers; None where this tree does not know the cell.

        Raises:
            UsageError: the process ended, or has loaded a module of the other tree.
        """
        asked = {name: value if isinstance(value, int) else str(value) for name, value in vars(cell).items()}
        answer = self._answer(json.dumps(asked))
        status, reason = answer.pop("status"), one_line(answer.pop("reason"))
        foreign = [file for file in answer.pop("files", ()) if self.other.holds(file)]
        if foreign:
            raise UsageError(f"{self.tree.name} cannot be measured: its training loads {foreign[0]}")
        return None if status == "unknown" else Sample(cell, status, reason, **answer)

    def _answer(self, question: str) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(question + "\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            self.process.wait()
            self.errors.seek(0)
            said = self.errors.read().decode(errors="replace").strip().splitlines()
            raise UsageError(f"{self.tree.name} cannot train: {one_line((said or ['no reason said'])[-1])}")
        found: dict[str, Any] = json.loads(line)
        return found
