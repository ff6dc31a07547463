"""Files of arrays (.npz) without pickled objects: the policies of a cell, and its traces, which the referee
recorded.

A file of policies has `selected/NAME` and `final/NAME` for each array from which the agent restores a policy. Two equal
policies are saved once, as `selected`.

A file of traces has `traces` (N, T + 1, k) and `signals` (k,), their names. For films, `extremes` (2,) are the numbers
of the best and the worst start, and `states` (2, decisions + 1, n) the states on the way from them.

A file of a training has the arrays of its last policy, and `training/NAME` for each from which another one goes on.
"""

import hashlib
import io
import math
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple, get_args

import numpy as np
from numpy.lib.format import MAGIC_PREFIX, read_array_header_1_0, read_array_header_2_0, read_magic
from numpy.typing import NDArray

from stlbench.contract import Array, Arrays, Integers, Policy, StatePolicy
from stlbench.errors import UsageError, cause, one_line
from stlbench.records.identity import OUTSIDE
from stlbench.records.result import MAIN, TASK_FOLDER, Result, Score
from stlbench.records.result_files import cell_files, inside, opened, to_read
from stlbench.stl.predicates import as_floats

LARGEST = 2**31  # bytes that the arrays of a file may take: an archive of some MB can say that it holds a TB of zeros
_HEAD = 2**16  # bytes that are read of an array to learn its shape: it may say that its header is as long as the file
_NO_ARRAYS = "it is no file of arrays (.npz), or has objects in it"

TRAINING, OF = "training/", "of"
"""How the names of the arrays begin from which a training goes on, and the name of the text that says of what it is."""


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], compressed: bool = True) -> None:
    """Write arrays in place of the file of before; its folder is made. Whoever reads finds no half a file.

    Raises `TypeError` for an array of objects, and `UsageError` as `result_files.opened`.
    """
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise TypeError(f"array '{name}' has objects; only numbers and texts can be stored")
    with opened(path) as file:
        (np.savez_compressed if compressed else np.savez)(file, allow_pickle=False, **arrays)


def read_arrays(path: Path, prefix: str = "", folder: Path | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of a file whose names begin so. Raises `ValueError`, in a line, if it is damaged or has objects.

    Raises `UsageError` as `result_files.to_read` where it is in a `folder` that the user named, and not the file.
    """
    try:
        with path.open("rb") if folder is None else to_read(path, folder) as file:
            if not zipfile.is_zipfile(file):  # NumPy would read it as a whole, whatever it is
                raise UsageError(_NO_ARRAYS)
            if (size := size_as_floats(file)) > LARGEST:
                raise UsageError(f"its arrays would take {size >> 20} MiB, at most {LARGEST >> 20} are read")
            file.seek(0)
            with np.load(file) as saved:
                arrays = {name: saved[name] for name in saved.files if name.startswith(prefix)}
    except UsageError:
        raise
    except Exception as error:  # damage lets zipfile and NumPy raise nearly anything, even a tokenize.TokenError
        pickled = "pickle" in str(error)  # NumPy takes what it does not know for one
        message = _NO_ARRAYS if pickled else cause(error)[:200]
        raise ValueError(message) from error
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):  # bytes, where NumPy does not know the beginning
            raise ValueError(f"'{name}' is no array")
    return arrays


def size_as_floats(file: Path | BinaryIO) -> int:
    """Bytes of a file's arrays by their own words, which no reader exceeds; a number takes 8, as it will be a float.

    Raises `ValueError`.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            return sum(_size(archive, info) for info in archive.infolist())
    except Exception as error:
        raise ValueError(cause(error)[:200]) from error


def _size(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> int:
    with archive.open(info) as file:
        head = io.BytesIO(file.read(_HEAD))
    if not head.getvalue().startswith(MAGIC_PREFIX):
        return info.file_size
    header = read_array_header_1_0 if read_magic(head) == (1, 0) else read_array_header_2_0
    shape, _, dtype = header(head)
    return max(info.file_size, math.prod(shape) * max(8, dtype.itemsize))  # a shape may be negative


Which = Literal["selected", "final"]
"""A cell's policy: the checkpoint that did best on the starts for selection, or the one at the end of training."""


def save_policies(path: Path, selected: Policy | StatePolicy, final: Policy | StatePolicy) -> tuple[str, str] | None:
    """Write both policies of a cell; their digests. None, and no file, if one of them cannot be stored."""
    arrays_of = {"selected": _arrays(selected), "final": _arrays(final)}
    stored = {which: arrays for which, arrays in arrays_of.items() if arrays is not None}
    if len(stored) < len(arrays_of):
        return None
    digests = digest(stored["selected"]), digest(stored["final"])
    if len(set(digests)) == 1:
        del stored["final"]
    write_arrays(path, {f"{which}/{name}": array for which, arrays in stored.items() for name, array in arrays.items()})
    return digests


def save_training(path: Path, final: Policy | StatePolicy, kept: Arrays, of: str) -> None:
    """Write the last policy of a training, with the arrays from which another training of the same goes on."""
    if (arrays := _arrays(final)) is None:
        return
    beside = {f"{TRAINING}{name}": np.asarray(array) for name, array in {**kept, OF: np.array(of)}.items()}
    write_arrays(path, {**arrays, **beside}, compressed=False)


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
    return "its agent stores none, by the record"


def read_policy(results: Path, result: Result, which: Which) -> Arrays:
    """The arrays of a cell's policy. Raises `UsageError` if they are missing, or not those that were recorded."""
    name, measured = result.id.name, result.measurement
    if which not in get_args(Which):
        raise UsageError(f"which: a cell has the policies {' and '.join(get_args(Which))}, got {which!r}")
    if measured is None:
        raise UsageError(f"{name} has no policy: {result.how}")
    if measured.policies is None:
        raise UsageError(f"{name} has no stored policy: {_why_none(result)}")
    path, policies = cell_files(results, result.id, result.key).policies, measured.policies
    there = "selected" if policies.selected == policies.final else which
    if not inside(path, results, "read").is_file():
        raise UsageError(f"{name} has no policy at {path}; `stlbench run` stores it when it trains a cell")
    prefix = f"{there}/"
    try:
        arrays = {entry.removeprefix(prefix): array for entry, array in read_arrays(path, prefix, results).items()}
    except ValueError as error:
        raise UsageError(f"cannot read {path} as policies of stlbench: {error}") from error
    if digest(arrays) != getattr(policies, which):
        raise UsageError(f"{path} does not have the {which} policy of {name}: its hash is not the recorded one")
    return arrays


def check_policies(results: Path, result: Result) -> None:
    """Raises `ValueError` unless a cell's file has the policies that were recorded; the final one may be left out."""
    read_policy(results, result, "selected")
    if read_arrays(cell_files(results, result.id, result.key).policies, "final/", results):
        read_policy(results, result, "final")


class Assessment(NamedTuple):
    """The referee's scores of one policy, with the traces."""

    scores: dict[str, Score]  # protocol -> score
    traces: Array  # (N, T + 1, k): the traces behind the main score
    states: Array | None  # (N, decisions + 1, n): those behind them, at each decision and at the end; None if unknown


class Film(NamedTuple):
    """The states on the way from the best and the worst start of a cell, or from its only start."""

    starts: Integers  # (2,) or (1,): which starts they are
    states: Array  # (2 or 1, decisions + 1, n): at each decision and at the end


class SavedTraces(NamedTuple):
    """Samples (N, T + 1, k) of k named signals from N starts."""

    names: tuple[str, ...]
    samples: Array
    film: Film | None = None  # None if the file has no states


def save_traces(path: Path, assessment: Assessment, signals: tuple[str, ...]) -> None:
    named: dict[str, NDArray[Any]] = {"traces": assessment.traces, "signals": np.array(signals)}
    if assessment.states is not None:
        robustness = assessment.scores[MAIN].robustness
        named["extremes"] = extremes = np.array([np.argmax(robustness), np.argmin(robustness)])
        named["states"] = assessment.states[extremes]
    write_arrays(path, named)


def read_cell(results: Path, result: Result) -> SavedTraces:
    """The traces of a cell in a folder of results. Raises `UsageError` if there is no file, and as `read_saved`."""
    path = cell_files(results, result.id, result.key).traces
    if not inside(path, results, "read").is_file():
        raise UsageError(f"{result.id.name} has no traces at {path}; `stlbench run` records them when it trains a cell")
    saved = read_saved(path, results)
    if result.measurement and len(saved.samples) != (starts := result.measurement.selected[MAIN].starts):
        raise UsageError(f"{path}: it has traces from {len(saved.samples)} starts, and its row says {starts}")
    return saved


def read_saved(path: Path, folder: Path | None = None, read: Collection[str] | None = None) -> SavedTraces:
    """The traces of a file that `stlbench run` wrote; of the signals `read`, or of all, no value is rounded.

    Raises `UsageError` if it is none, and as `read_arrays`.
    """
    try:
        arrays = read_arrays(path, folder=folder)
        names = tuple(map(str, arrays["signals"].tolist()))
        samples = as_floats(arrays["traces"], names, read)
        film = Film(arrays["extremes"], arrays["states"]) if "states" in arrays else None
    except KeyError as error:
        raise UsageError(f"cannot read {path} as traces of stlbench: it has no {error}") from error
    except (ValueError, TypeError) as error:
        raise UsageError(f"cannot read {path} as traces of stlbench: {one_line(error)}") from error
    if samples.ndim != 3 or 0 in samples.shape or samples.shape[2] != len(names):
        raise UsageError(f"{path}: traces have shape (starts, steps, {len(names)} signals), got {samples.shape}")
    if film is not None and not _fits(film, len(samples)):
        raise UsageError(f"{path}: states have shape (extremes, decisions + 1, n), and extremes are numbers of starts")
    return SavedTraces(names, samples, film)


def _fits(film: Film, starts: int) -> bool:
    if film.states.ndim != 3 or film.states.shape[1] < 2 or film.starts.shape != film.states.shape[:1]:
        return False
    return film.starts.dtype.kind in "iu" and bool(np.all((film.starts >= 0) & (film.starts < starts)))
