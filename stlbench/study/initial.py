"""A stored policy from which agents start: its file, and the hash by which cells are known that start from it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from stlbench.contract import Agent, Arrays, Unsuitable
from stlbench.errors import UsageError, one_line
from stlbench.records import array_files
from stlbench.records.array_files import OF, TRAINING, digest
from stlbench.registry.choices import Choice
from stlbench.study.cell import Cell
from stlbench.task.build import INIT
from stlbench.task.task import Task

_DIGITS = 16  # of the hash that a cell's name has
_SELECTED = "selected/"


class Initial(NamedTuple):
    """A policy to start from."""

    path: Path
    digest: str  # of its arrays, as results record it

    @classmethod
    def of(cls, path: Path) -> Initial:
        """The policy in a file. Raises `UsageError` as `read`."""
        return cls(path.absolute(), digest(read(path)))

    def given_to(self, agent: Choice) -> Choice:
        """The agent as one that starts from it, `dqn[init=...]`: another agent for keys, tables and comparisons."""
        return Choice(agent.name, (*agent.without(INIT).parameters, (INIT, self.digest[:_DIGITS])))


class Stored(NamedTuple):
    """The arrays in a file: of a policy, and of the training that ended with it, if it was kept."""

    policy: Arrays
    training: Arrays

    @classmethod
    def among(cls, arrays: Arrays) -> Stored:
        """The parts of what `read` gives."""
        own = {name.removeprefix(TRAINING): each for name, each in arrays.items() if name.startswith(TRAINING)}
        return cls({name: each for name, each in arrays.items() if not name.startswith(TRAINING)}, own)


def read(path: Path) -> Arrays:
    """The arrays of a policy as `run` and `solve` store it; of a cell's two policies the selected one.

    Raises `UsageError`: no such file, a link, or no policy.
    """
    if not path.is_file():
        raise UsageError(f"there is no policy at {path}")
    try:
        arrays = array_files.read_arrays(path, folder=path.parent)
    except ValueError as error:
        raise UsageError(f"cannot read {path} as a policy: {error}") from error
    selected = {name.removeprefix(_SELECTED): each for name, each in arrays.items() if name.startswith(_SELECTED)}
    return selected or arrays


def arrays_of(cell: Cell) -> Stored | None:
    """Those from which a cell's agent starts, None for fresh networks.

    Raises `UsageError` where the file is not given, or has another policy than when the cell was planned, or a training
    of another task or method.
    """
    wanted = dict(cell.id.agent.parameters).get(INIT)
    if wanted is None:
        return None
    if cell.init is None:
        raise UsageError(f"agent {cell.id.agent} starts from a policy; name its file with --init")
    arrays = read(cell.init)
    if not digest(arrays).startswith(wanted):
        raise UsageError(f"{cell.init} is no longer the policy that agent {cell.id.agent} starts from")
    stored = Stored.among(arrays)
    if stored.training and (of := one_line(stored.training.get(OF))) != subject(cell):
        raise UsageError(f"{cell.init} should be a training of {subject(cell)}, got {of}; a policy starts any other")
    return stored


def subject(cell: Cell) -> str:
    """The task and the method of a cell, whose training only one of the same can go on with."""
    return f"{cell.id.task}/{cell.id.method}"


def refuse_other(arrays: Arrays, agent: Agent, name: str, task: Task) -> None:
    """Raises `Unsuitable` where an agent of that name cannot start from these arrays, as far as a look shows."""
    if not agent.resumes:
        raise Unsuitable(f"agent {name} cannot start from a policy")
    try:
        agent.restore(arrays, task.actions)
    except Unsuitable:
        raise
    except Exception as error:
        raise Unsuitable(f"it is no policy of agent {name}") from error
