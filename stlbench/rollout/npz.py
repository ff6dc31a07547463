"""Files of arrays (.npz), without any pickle: those of a cell, written whole or not at all."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.result import CellId

__all__ = ["DAMAGED", "cell_file", "write"]

DAMAGED = (
    *(OSError, ValueError, TypeError, KeyError, EOFError, MemoryError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error),
)
"""What reading an .npz raises where it is damaged, encrypted, a pickle, or no .npz at all."""


def cell_file(folder: Path, cell: CellId, key: str) -> Path:
    """Where, in such a folder, a cell's arrays are: named after the cell and the beginning of its key."""
    return folder / f"{cell.name.replace('/', '_')}_{key[:12]}.npz"


def write(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays, compressed, in place of the file of before; its folder is made. Whoever reads finds no half a file.

    Raises `TypeError` for an array of objects.
    """
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise TypeError(f"array '{name}' has objects; numbers and texts can be kept")
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    with part.open("wb") as file:  # a path would be given the ending .npz
        np.savez_compressed(file, allow_pickle=False, **arrays)
    part.replace(path)
