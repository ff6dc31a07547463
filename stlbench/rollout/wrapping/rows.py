"""One copy's part of what a vector environment returns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def has(infos: dict[str, Any], name: str, copy: int) -> bool:
    """Whether the info of a copy has an entry: Gymnasium has a mask `_name` beside each."""
    mask = infos.get(f"_{name}")
    return name in infos and (mask is None or bool(mask[copy]))


def masked(name: str, values: NDArray[Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """An entry that some of N copies have, from values (N, ...), and its mask; nothing where none has it."""
    if not mask.any():
        return {}
    entry = np.zeros_like(values)
    entry[mask] = values[mask]
    return {name: entry, f"_{name}": mask.copy()}


def row_of(infos: dict[str, Any], copy: int) -> dict[str, Any]:
    """The info of one copy, as it would be without the others."""
    return {
        name: _part(value, copy)
        for name, value in infos.items()
        if not (name.startswith("_") and name[1:] in infos) and has(infos, name, copy)
    }


def _part(value: Any, copy: int) -> Any:
    if isinstance(value, dict):
        return row_of(value, copy)
    return value[copy] if isinstance(value, np.ndarray) and value.ndim else value
