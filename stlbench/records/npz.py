"""Files of arrays (.npz) without pickled objects. A file is written completely or not at all."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.errors import cause
from stlbench.records.outputs import opened

LARGEST = 2**31  # bytes that the arrays of a file may take: an archive of some MB can say that it holds a TB of zeros


def write(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays, compressed, in place of the file of before; its folder is made. Whoever reads finds no half a file.

    Raises `TypeError` for an array of objects, and `UsageError` as `outputs.opened`.
    """
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise TypeError(f"array '{name}' has objects; only numbers and texts can be stored")
    with opened(path) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read(path: Path, prefix: str = "") -> dict[str, NDArray[Any]]:
    """The arrays of a file whose names begin so. Raises `ValueError`, in a line, if it is damaged or has objects."""
    if zipfile.is_zipfile(path) and (size := unpacked_size(path)) > LARGEST:
        raise ValueError(f"its arrays would take {size >> 20} MiB, at most {LARGEST >> 20} are read")
    try:
        with np.load(path) as saved:
            arrays = {name: saved[name] for name in saved.files if name.startswith(prefix)}
    except Exception as error:  # damage lets zipfile and NumPy raise nearly anything, even a tokenize.TokenError
        pickled = "pickle" in str(error)  # NumPy takes what it does not know for one
        message = "it is no file of arrays (.npz), or has objects in it" if pickled else cause(error)[:200]
        raise ValueError(message) from error
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):  # bytes, where NumPy does not know the beginning
            raise ValueError(f"'{name}' is no array")
    return arrays


def unpacked_size(path: Path) -> int:
    """Bytes of a file's arrays by its own list, which no reader exceeds. Raises `ValueError`."""
    try:
        with zipfile.ZipFile(path) as archive:
            return sum(info.file_size for info in archive.infolist())
    except Exception as error:
        raise ValueError(cause(error)[:200]) from error
