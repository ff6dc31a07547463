"""Numba's decorators, as all compiled functions of this package have them.

`compiled` is kept on disk and loaded by later processes. So is `part`, which compiled functions alone can call, as it
lacks the code by which Python would: that takes less time to compile. `inlined` becomes a part of the functions that
call it, which spares the time to compile it on its own. `named` is compiled when it is imported, and others call it by
its name: its machine code is made once, and not again with each function that calls it.

None checks for divisions by 0, which would keep loops scalar, and none lets the compiler reorder sums (`fastmath`): a
function is compiled anew wherever it is used, and which of the copies runs, in a process that compiled and in one that
loaded, would decide the last bits of a training. None counts references (`_nrt`), which takes time to compile: so none
can make an array, or return one that it was not given.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import llvmlite.binding
import numba
from numba.core import config
from numba.core.registry import CPUDispatcher

from stlbench_agents.compiled_code import folder

config.CACHE_DIR = str(folder())  # type: ignore[attr-defined]
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
compiled = partial(numba.njit, cache=True, **_OPTIONS)
inlined = partial(numba.njit, inline="always", error_model="numpy")


class _Part(CPUDispatcher):
    def __call__(self, *arguments: Any) -> None:
        raise TypeError(f"{self.py_func.__name__} is called by compiled functions alone")


def part(function: Any) -> Any:
    """Compile a function without the code by which Python calls it."""
    options = {"nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **_OPTIONS}
    made = _Part(function, targetoptions=options)
    made.enable_caching()
    return made


def named(name: str, signature: Any) -> Callable[[Callable[..., None]], Any]:
    """Compile a function for the types of a signature, and let compiled code call it as `name`."""

    def decorate(function: Callable[..., None]) -> Any:
        made = numba.cfunc(signature, cache=True, **_OPTIONS)(function)
        llvmlite.binding.add_symbol(name, made.address)
        return made

    return decorate


class OneKind:
    """A compiled function whose arguments always have the types that they have in its first call.

    They are not looked at again, which spares 10 microseconds a call with many arrays. Arrays must keep their number
    type and their order in memory, too.
    """

    def __init__(self, function: Any) -> None:
        self._function = function
        self._machine_code: Callable[..., None] | None = None

    def __call__(self, *arguments: Any) -> None:
        """Call it. There is no result."""
        if self._machine_code is None:
            types = tuple(numba.typeof(argument) for argument in arguments)
            self._function.compile(types)
            self._machine_code = self._function.get_overload(types)
        self._machine_code(*arguments)
