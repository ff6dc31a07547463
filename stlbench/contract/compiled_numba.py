"""Numba's cache in a folder that we choose. It builds on interfaces that Numba may change in any version."""

import sys
from contextlib import suppress
from pathlib import Path
from types import FunctionType
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator


class FolderCache(FunctionCache):
    """The code of one function. Damaged code is compiled again, and a full disk stops nothing."""

    def __init__(self, function: FunctionType, folder: Path) -> None:
        self._impl_class = lambda function: _Code(function, folder)  # type: ignore[assignment]
        FunctionCache.__init__(self, function)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for a signature, or None."""
        try:
            return FunctionCache.load_overload(self, sig, target_context)
        except Exception:
            with suppress(Exception):
                FunctionCache.flush(self)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for a signature."""
        with suppress(Exception):
            FunctionCache.save_overload(self, sig, data)


class _Code(CompileResultCacheImpl):
    """The writing and reading of code. Unlike Numba's own, it heeds no setting that names a folder."""

    def __init__(self, function: FunctionType, folder: Path) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Folder(function, folder)
        name = f"{function.__module__}.{function.__qualname__}"
        self._filename_base = CompileResultCacheImpl.get_filename_base(self, name, getattr(sys, "abiflags", ""))


class _Folder(_CacheLocator):
    def __init__(self, function: FunctionType, folder: Path) -> None:
        self._py_file = function.__code__.co_filename  # which Numba's warnings name
        self._function, self._folder = function, folder

    def ensure_cache_path(self) -> None:
        self._folder.mkdir(mode=0o700, exist_ok=True)  # and none above it: its user has deleted them

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return str(self._folder)  # which is named after the sources

    def get_disambiguator(self) -> str:
        return str(self._function.__code__.co_firstlineno)
