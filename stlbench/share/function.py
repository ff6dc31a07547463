"""A policy that is a function of a Python module, named `module:function`."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stlbench.errors import UsageError, cause, did_you_mean
from stlbench.registry.fingerprint import fingerprint


def load_function(text: str) -> Callable[..., Any]:
    """Import a module, also from the working directory, and take what it calls `function`.

    Raises:
        UsageError: there is no such module, importing it fails, or it has nothing of that name that can be called.
    """
    module, _, name = text.partition(":")
    _from_here()
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


def digest(text: str) -> str:
    """Of the source of the module and of what it imports from its own package."""
    _from_here()
    return fingerprint(text.partition(":")[0])


def _from_here() -> None:
    """A console script does not look for modules in the working directory, as `python -m` does."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
