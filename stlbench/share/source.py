"""What a user names as a policy: a stored cell, a function, a model of SB3, ONNX or PyTorch, or recorded traces."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from stlbench.errors import UsageError, cause, did_you_mean
from stlbench.registry.fingerprint import fingerprint

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
        """Of the file, 64 hex digits; of a function, of its module's source. Raises `UsageError`."""
        if self.kind == "function":
            from_here()
            return fingerprint(self.text.partition(":")[0])
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
