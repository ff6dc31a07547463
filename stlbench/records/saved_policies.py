"""The file of a cell's policies: the selected and the final one.

It is an .npz with `selected/NAME` and `final/NAME` for each array from which the agent restores a policy. Two equal
policies are saved once, as `selected`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np

from stlbench.contract import Arrays, Policy, StatePolicy
from stlbench.errors import UsageError
from stlbench.records import npz
from stlbench.records.identity import OUTSIDE
from stlbench.records.outputs import cell_files, inside
from stlbench.records.result import TASK_FOLDER, Result

Which = Literal["selected", "final"]
"""A cell's policy: the checkpoint that did best on the starts for selection, or the one at the end of training."""


def save(path: Path, selected: Policy | StatePolicy, final: Policy | StatePolicy) -> tuple[str, str] | None:
    """Write both policies of a cell; their digests. None, and no file, if one of them cannot be stored."""
    arrays_of = {"selected": _arrays(selected), "final": _arrays(final)}
    stored = {which: arrays for which, arrays in arrays_of.items() if arrays is not None}
    if len(stored) < len(arrays_of):
        return None
    digests = digest(stored["selected"]), digest(stored["final"])
    if len(set(digests)) == 1:
        del stored["final"]
    npz.write(path, {f"{which}/{name}": array for which, arrays in stored.items() for name, array in arrays.items()})
    return digests


def _arrays(policy: Policy | StatePolicy) -> Arrays | None:
    arrays = policy.arrays() if isinstance(policy, Policy) else None
    if not (arrays is None or (isinstance(arrays, Mapping) and all(isinstance(name, str) for name in arrays))):
        raise TypeError(f"arrays of a policy gives {type(arrays).__name__}, the contract says arrays by name, or None")
    return None if arrays is None else {name: np.asarray(array) for name, array in arrays.items()}


def digest(arrays: Arrays) -> str:
    """A hash (64 hex digits) of the arrays' names, types, shapes and bytes, independent of their order."""
    hashed = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        hashed.update(f"{name} {array.dtype.str} {arrays[name].shape}\n".encode() + array.tobytes())
    return hashed.hexdigest()


def _why_none(result: Result) -> str:
    if result.id.track == OUTSIDE:
        task, source = result.provenance.get(TASK_FOLDER, result.id.task), result.provenance.get("source", "FILE")
        how = f"falsify and certify take it as --task {task} {source}"
        return f"it is from outside, and only its score is stored; {how}"
    return "its agent stores none"


def read(results: Path, result: Result, which: Which) -> Arrays:
    """The arrays of a cell's policy. Raises `UsageError` if they are missing, or not those that were recorded."""
    name, measured = result.id.name, result.measurement
    if measured is None:
        raise UsageError(f"{name} has no policy: {': '.join(filter(None, (result.status, result.reason)))}")
    if measured.policies is None:
        raise UsageError(f"{name} has no stored policy: {_why_none(result)}")
    path, policies = cell_files(results, result.id, result.key).policies, measured.policies
    there = "selected" if policies.selected == policies.final else which
    if not inside(path, results, "read").is_file():
        raise UsageError(f"{name} has no policy at {path}; `stlbench run` stores it when it trains a cell")
    prefix = f"{there}/"
    try:
        arrays = {entry.removeprefix(prefix): array for entry, array in npz.read(path, prefix, results).items()}
    except ValueError as error:
        raise UsageError(f"cannot read {path} as policies of stlbench: {error}") from error
    if digest(arrays) != getattr(policies, which):
        raise UsageError(f"{path} does not have the {which} policy of {name}: its hash is not the recorded one")
    return arrays
