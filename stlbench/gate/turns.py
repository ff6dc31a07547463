"""Train the same cells by turns with the code of two trees: base, change, change, base, and so on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Collection
from contextlib import suppress
from tempfile import TemporaryFile
from types import TracebackType
from typing import Any, Self

from stlbench.errors import UsageError, one_line
from stlbench.gate.cost import Turn, unclear
from stlbench.gate.revision import Tree
from stlbench.gate.snapshot import Sample
from stlbench.records.identity import CellId


def take_turns(cells: Collection[CellId], base: Tree, new: Tree, say: Callable[[str], None]) -> list[Turn]:
    """Train each cell with both trees, and repeat the settings whose costs are not clear yet.

    One training runs at a time. Settings take turns too, so that other load on the machine affects all of them.
    Raises `UsageError` if a tree cannot train, or the base runs code of the change.
    """
    turns: list[Turn] = []
    waiting, number = sorted(cells, key=lambda cell: (cell.seed, cell)), 0
    while waiting:
        number += 1
        count = f"{len(waiting)} {'cell' if len(waiting) == 1 else 'cells'}"
        say(f"round {number}: {count}, each by {base.name} and by {new.name}")
        with Trainer(base, new) as one, Trainer(new, base) as other:  # a process that happens to be slow does not stay
            turns += [_turn(cell, number, one, other) for cell in waiting]
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
    """A process that trains with the code of `tree` (`stlbench.gate.trainer`), and with no code of `other`."""

    def __init__(self, tree: Tree, other: Tree) -> None:
        self.tree, self.other = tree, other
        self.errors = TemporaryFile()  # noqa: SIM115 - closed at the end of this context
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "stlbench.gate.trainer"],
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
            os.killpg(self.process.pid, signal.SIGKILL)  # also the process of a cell that still trains
        self.process.communicate()
        self.errors.close()

    def train(self, cell: CellId) -> Sample | None:
        """The cell's numbers; None if this tree does not know the cell.

        Raises:
            UsageError: the process ended, or loaded a module of the other tree.
        """
        request = {name: value if isinstance(value, int) else str(value) for name, value in vars(cell).items()}
        answer = self._answer(json.dumps(request))
        status, reason = answer.pop("status"), one_line(answer.pop("reason"))
        foreign = [file for file in answer.pop("files", ()) if self.other.holds(file)]
        if foreign:
            raise UsageError(f"{self.tree.name} cannot be measured: its training loads {foreign[0]}")
        return None if status == "unknown" else Sample(cell, status, reason, **answer)

    def _answer(self, request: str) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(request + "\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            self.process.wait()
            self.errors.seek(0)
            lines = self.errors.read().decode(errors="replace").strip().splitlines()
            raise UsageError(f"{self.tree.name} cannot train: {one_line((lines or ['no reason given'])[-1])}")
        answer: dict[str, Any] = json.loads(line)
        return answer
