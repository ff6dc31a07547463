"""Files of arrays (.npz) without pickled objects. A file is written completely or not at all."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib.format import MAGIC_PREFIX, read_array_header_1_0, read_array_header_2_0, read_magic
from numpy.typing import NDArray

from stlbench.errors import UsageError, cause
from stlbench.records.inputs import to_read
from stlbench.records.outputs import opened

LARGEST = 2**31  # bytes that the arrays of a file may take: an archive of some MB can say that it holds a TB of zeros
_NO_ARRAYS = "it is no file of arrays (.npz), or has objects in it"


def write(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays, compressed, in place of the file of before; its folder is made. Whoever reads finds no half a file.

    Raises `TypeError` for an array of objects, and `UsageError` as `outputs.opened`.
    """
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise TypeError(f"array '{name}' has objects; only numbers and texts can be stored")
    with opened(path) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read(path: Path, prefix: str = "", folder: Path | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of a file whose names begin so. Raises `ValueError`, in a line, if it is damaged or has objects.

    Raises `UsageError` as `inputs.to_read` where it is in a `folder` that the user named, and not the file.
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
        if file.read(len(MAGIC_PREFIX)) != MAGIC_PREFIX:
            return info.file_size
        file.seek(0)
        header = read_array_header_1_0 if read_magic(file) == (1, 0) else read_array_header_2_0
        shape, _, dtype = header(file)
    return math.prod(shape) * max(8, dtype.itemsize)
