"""The names that a user gives a policy: a stored cell, a function, a model of SB3, ONNX or PyTorch, or recorded
traces in its place.
"""

import hashlib
import importlib
import importlib.util
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError, cause, did_you_mean
from stlbench.records.array_files import read_saved
from stlbench.registry.fingerprint import code_of
from stlbench.share.trace_table import read_table, times_of
from stlbench.simulation.referee import Episodes
from stlbench.simulation.verdicts import last_steps
from stlbench.simulation.worlds import make_world
from stlbench.task.task import Task

Kind = Literal["cell", "function", "sb3", "onnx", "torch", "traces"]
_ENDINGS: dict[str, Kind] = {
    ".csv": "traces",
    ".gz": "traces",
    ".npz": "traces",
    ".onnx": "onnx",
    ".pt": "torch",
    ".pth": "torch",
    ".zip": "sb3",
}
_FUNCTION = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")
_CELL = re.compile(r"[^/]+/[^/]+/[^/]+/[0-9]+(/[a-z]+)?")


@dataclass(frozen=True)
class Source:
    kind: Kind
    text: str  # as the user named it
    architecture: str | None = None  # of a state_dict: "mlp[4,64,64,21;relu]"
    table: str | None = None  # the path of a table of actions, of which the policy answers numbers

    @property
    def path(self) -> Path:
        return Path(self.text)

    @property
    def shown(self) -> str:
        """For tables: the function, or the file's name without its folder."""
        return self.text if self.kind == "function" else self.path.name

    @property
    def name(self) -> str:
        """The name if the user gives none: my_policy:act is my-policy-act, x/net.onnx is net."""
        text = self.text if self.kind == "function" else self.path.stem
        return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "policy"

    @property
    def digest(self) -> str:
        """The file's, 64 hex digits; of a function, of its module's source. Raises `UsageError`."""
        if self.kind == "function":
            from_here()
            return code_of(self.text.partition(":")[0]).digest
        return _sha256(self.path)

    @property
    def more(self) -> dict[str, str]:
        """Further facts that identify the policy, for the provenance. Raises `UsageError`."""
        facts = {} if self.architecture is None else {"architecture": self.architecture}
        return facts if self.table is None else {**facts, "actions": _sha256(Path(self.table))}


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror or error}") from error


def find_source(text: str, architecture: str | None = None, table: str | None = None) -> Source:
    """The kind of policy that a text names: a file by its ending, `module:function`, or a cell's name.

    Raises `UsageError` if it names none, or the policy has no use for an architecture or a table.
    """
    kind: Kind | None = _ENDINGS.get(Path(text).suffix.lower())
    if kind is not None and not Path(text).is_file():
        raise UsageError(f"there is no file {text}")
    if kind is None:
        kind = "function" if _FUNCTION.fullmatch(text) else "cell" if _CELL.fullmatch(text) else None
    if kind is None:
        files = "a file .zip (SB3), .onnx, .pt or .pth (PyTorch), .csv, .csv.gz or .npz (traces)"
        kinds = f"a cell's name task/method/agent/seed, module:function, or {files}"
        raise UsageError(f"'{text}' names no policy; one is {kinds}")
    if architecture is not None and kind != "torch":
        raise UsageError(f"{text}: --architecture is for a state_dict of PyTorch, .pt or .pth; leave it out")
    if architecture is None and kind == "torch":
        rule = "say --architecture, as 'mlp[4,64,64,21;relu]', or export it as ONNX"
        raise UsageError(f"{text}: a file of PyTorch has weights and no network; {rule}")
    if table is not None and kind in ("cell", "traces"):
        raise UsageError(f"{text}: --actions is for a policy from outside that acts; leave it out")
    return Source(kind, text, architecture, table)


def load_function(text: str) -> Callable[..., Any]:
    """The function of a text `module:function`. The module may lie in the working directory. Raises `UsageError`."""
    module, _, name = text.partition(":")
    from_here()
    try:
        loaded = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{module}.".startswith(f"{error.name}."):
            raise UsageError(f"{text}: there is no module '{error.name}' here or installed") from error
        raise UsageError(f"{text}: the module cannot be imported: {error}") from error
    except Exception as error:
        raise UsageError(f"{text}: the module cannot be imported: {cause(error)}") from error
    found = getattr(loaded, name, None)
    if found is None:
        known = [each for each, value in vars(loaded).items() if callable(value) and not each.startswith("_")]
        raise UsageError(f"{text}: the module has no '{name}'{did_you_mean(name, known)}")
    if not callable(found):
        raise UsageError(f"{text}: '{name}' is {type(found).__name__}, which cannot be called")
    function: Callable[..., Any] = found
    return function


def from_here() -> None:
    """A console script does not look for modules in the working directory, as `python -m` does."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)


def found_with(identifier: str | None) -> str:
    """What a command needs before `stlbench` to find the module of an environment: nothing, unless it lies here."""
    module = sys.modules.get((identifier or "").rpartition(":")[0].partition(".")[0])
    places = getattr(module, "__path__", None) or [getattr(module, "__file__", None) or ""]
    return "PYTHONPATH=. " if any(Path(place).absolute().parent == Path.cwd() for place in places if place) else ""


def load_traces(path: Path, task: Task) -> Episodes:
    """The episodes of a task's signals in a file: an .npz with several, or a table of text with one.

    If the environment may end an episode, a trace may be shorter, or have NaN at its end. It then is as the referee
    records it: its last sample stays, or there is NaN, as the task's `terminated` says. Raises `UsageError`.
    """
    if path.suffix.lower() == ".npz":
        saved = read_saved(path, read=task.signals)
        traces = saved.samples[..., _columns(path, saved.names, task)]
    else:
        traces = _table(path, task)
    rows, early = task.file.steps + 1, task.specification.can_end
    if traces.shape[1] > rows or (traces.shape[1] < rows and not early):
        rule = f"an episode of {task.name} has {rows}, one at the start and one after each step"
        raise UsageError(f"{path} has {traces.shape[1]} rows; {rule}")
    missing = np.full((len(traces), rows - traces.shape[1], traces.shape[2]), np.nan)
    return _ended(path, np.concatenate([traces, missing], axis=1), task)


def _ended(path: Path, traces: Array, task: Task) -> Episodes:
    """As the referee has them, from traces (N, T + 1, k) that have NaN after an early end."""
    early, steps = task.specification.can_end, np.arange(traces.shape[1])
    last = last_steps(traces) if early else np.full(len(traces), steps[-1])
    wrong = ~np.isfinite(traces) & (steps <= last[:, None])[..., None]
    if wrong.any():
        place = np.argwhere(wrong)[0]
        where = f"trace {place[0]}, row {place[1]}, {task.signals[place[2]]}"
        rule = "a finite number is expected" + (", or NaN in all signals from a row to the end" if early else "")
        raise UsageError(f"{path}: {where} is {traces[tuple(place)]}; {rule}")
    if task.file.terminated == "hold":
        traces = traces[np.arange(len(traces))[:, None], np.minimum(steps, last[:, None])]
    return Episodes(traces, last)


def _table(path: Path, task: Task) -> Array:
    table = read_table(path)
    columns = _columns(path, table.names, task)
    if task.specification.can_end:
        table = table.without_end(task.signals)
    if times := times_of(table, task.signals):
        times.check(task.file.sampling_time)
    traces: Array = table.samples(task.signals)[None][..., columns]
    return traces


def _columns(path: Path, names: tuple[str, ...], task: Task) -> list[int]:
    for signal in task.signals:
        if signal not in names:
            raise UsageError(f"{path} has no signal '{signal}'{did_you_mean(signal, names)}")
    return [names.index(signal) for signal in task.signals]


def from_the_reports_starts(traces: Array, task: Task) -> bool:
    """Whether traces begin where the report's do, so that their score can stand beside others."""
    starts = task.starts.report_and_selection()[0]
    if len(starts) != len(traces):
        return False
    world = make_world(task, len(starts))
    world.restart(np.arange(len(starts)), starts)
    return np.allclose(world.signals, traces[:, 0], rtol=0, atol=1e-6)
