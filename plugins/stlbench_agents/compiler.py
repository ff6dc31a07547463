"""Numba's decorators, as all compiled functions of this package have them.

`compiled` is kept on disk and loaded by later processes. `inlined` becomes a part of the functions that call it, which
spares the time to compile it on its own. Neither checks for divisions by 0, which would keep loops scalar, and neither
lets the compiler reorder sums (`fastmath`): a function is compiled anew wherever it is used, and which of the copies
runs, in a process that compiled and in one that loaded, would decide the last bits of a training.
"""

from __future__ import annotations

from functools import partial

import numba
from numba.core import config

from stlbench_agents.compiled_code import folder

__all__ = ["compiled", "inlined"]

config.CACHE_DIR = str(folder())  # type: ignore[attr-defined]
compiled = partial(numba.njit, cache=True, error_model="numpy")
inlined = partial(numba.njit, inline="always", error_model="numpy")
