"""What a user names as a policy: a stored cell, a function, a model of SB3 or ONNX, or recorded traces."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from stlbench.errors import UsageError
from stlbench.outside import function

__all__ = ["Kind", "Source", "find_source"]

Kind = Literal["cell", "function", "sb3", "onnx", "traces"]

_ENDINGS: dict[str, Kind] = {".zip": "sb3", ".onnx": "onnx", ".csv": "traces", ".npz": "traces"}
_FUNCTION = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")
_CELL = re.compile(r"[^/]+/[^/]+/[^/]+/[0-9]+(/[a-z]+)?")


@dataclass(frozen=True)
class Source:
    """Where a policy comes from."""

    kind: Kind
    text: str
    """As the user named it."""

    @property
    def path(self) -> Path:
        """Of a file."""
        return Path(self.text)

    @property
    def shown(self) -> str:
        """For tables: the function, or the file's name; its folder is nobody else's."""
        return self.text if self.kind == "function" else self.path.name

    @property
    def name(self) -> str:
        """What it is called where the user says no name: my_policy:act is my-policy-act, x/net.onnx is net."""
        text = self.text if self.kind == "function" else self.path.stem
        return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "policy"

    @property
    def digest(self) -> str:
        """Of the file, 64 hex digits; of a function, of its module's source. Raises `UsageError`."""
        if self.kind == "function":
            return function.digest(self.text)
        try:
            return hashlib.sha256(self.path.read_bytes()).hexdigest()
        except OSError as error:
            raise UsageError(f"cannot read {self.text}: {error.strerror or error}") from error


def find_source(text: str) -> Source:
    """What kind of policy a text names: a file by its ending, `module:function`, or a cell's name.

    Raises:
        UsageError: none of these, or there is no such file.
    """
    kind = _ENDINGS.get(Path(text).suffix.lower())
    if kind is not None:
        if not Path(text).is_file():
            raise UsageError(f"there is no file {text}")
        return Source(kind, text)
    if _FUNCTION.fullmatch(text):
        return Source("function", text)
    if _CELL.fullmatch(text):
        return Source("cell", text)
    kinds = "a cell's name task/method/agent/seed, module:function, or a file .zip (SB3), .onnx, .csv or .npz (traces)"
    raise UsageError(f"'{text}' names no policy; one is {kinds}")
