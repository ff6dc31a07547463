"""Code that Numba compiles, kept on disk so that it is never the code of another source. Imports no Numba, to be quick.

Numba keeps compiled code beside a function's file, and compares that file alone. If another file changes whose
constants or functions it reads, Numba goes on with the old ones. So here is a folder for each state of the sources. No
setting of Numba is changed: functions of others are cached as before.
"""

import hashlib
import os
import re
import shutil
import stat
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import gettempdir
from typing import Any, TypeVar

_BEGAN = time.time()
"""If a source was edited later, this process may have imported the earlier one."""
_FOLDERS = 8
"""So many of a package stay: those that were used last."""
_NOT_KEPT = "compiled code is not kept"

Function = TypeVar("Function")


def cached(function: Function, apart: str = "") -> Function:
    """Let a compiled function load its code from the disk, or keep it there, in place of Numba's `cache=True`.

        @cached
        @numba.njit()
        def total(values): ...

    Kept code counts until a source file of the function's top-level package changes, or Python, Numba, llvmlite or the
    processor. Other packages do not count: the function must not read theirs, nor those of stlbench. If nothing can
    be kept, each process compiles.

    Args:
        function: what `numba.njit` made, without `cache` and without signatures.
        apart: a name for each way, if the same source is compiled in several ways.
    """
    compiled: Any = function
    if not hasattr(compiled, "_cache"):  # NUMBA_DISABLE_JIT leaves it as it is
        return function
    source: Any = compiled.__wrapped__
    kept = folder(source.__module__.partition(".")[0])
    if kept is not None:
        try:
            from stlbench.contract.compiled_numba import FolderCache

            compiled._cache = FolderCache(source, kept / apart)
        except Exception as error:
            reason = f"with Numba {version('numba')} ({type(error).__name__}: {error})"
            warnings.warn(f"{_NOT_KEPT} {reason}: each process compiles again", RuntimeWarning, stacklevel=2)
    return function


@cache
def folder(package: str) -> Path | None:
    """The folder for the code of a top-level package, in its present state; None if it cannot be kept.

    It lies in NUMBA_CACHE_DIR, else in `stlbench` in the user's folder of caches.
    """
    try:
        sources = list(_sources(package))
        if any(source.stat().st_ctime > _BEGAN for source in sources):
            return None
        found = _caches().absolute() / f"{package}-{_state(sources)}"
        is_new = not found.exists()
        found.parent.mkdir(parents=True, exist_ok=True)
        if not _is_made_safe(found):
            reason = f"where others can change it, as in {found}; NUMBA_CACHE_DIR may name a folder of your own"
            warnings.warn(f"{_NOT_KEPT} {reason}: each process compiles again", RuntimeWarning, stacklevel=3)
            return None
        os.utime(found)
        if is_new:
            _remove_oldest(found.parent, package)
    except OSError:
        return None
    return found


def is_ready(package: str, part: str) -> bool:
    """Whether this machine has compiled a part of a package's code, in its present state."""
    kept = folder(package)
    return kept is not None and (kept / part).exists()


def note_ready(package: str, part: str) -> None:
    """Note that it has; if nothing can be written, each process compiles again."""
    if kept := folder(package):
        with suppress(OSError):
            (kept / part).touch()


def _sources(package: str) -> Iterator[Path]:
    module: Any = sys.modules.get(package)
    for place in getattr(module, "__path__", [getattr(module, "__file__", None) or "no file"]):
        path = Path(place)
        yield from sorted(path.rglob("*.py")) if path.is_dir() else [path]


def _state(sources: list[Path]) -> str:
    import llvmlite.binding as llvm

    processor = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    state = hashlib.sha256(repr((sys.version, version("numba"), version("llvmlite"), processor)).encode())
    for source in sources:
        state.update(hashlib.sha256(source.read_bytes()).digest() + source.name.encode())
    return state.hexdigest()[:16]


def _caches() -> Path:
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(named)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stlbench"
    except RuntimeError:  # a user without a home, as in some containers
        return Path(gettempdir()) / f"stlbench-{os.geteuid()}"


def _is_made_safe(found: Path) -> bool:
    """Make it. Whether nobody else can put files there, as loading a file of Numba's cache can run what is in it."""
    above, user = found.parent.stat(), os.geteuid()
    is_open = bool(above.st_mode & stat.S_IWOTH) and not above.st_mode & stat.S_ISVTX
    if is_open or above.st_uid not in (user, 0):
        return False
    found.mkdir(mode=0o700, exist_ok=True)
    own = found.lstat()
    return stat.S_ISDIR(own.st_mode) and own.st_uid == user and not own.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _remove_oldest(caches: Path, package: str) -> None:
    ours = [each for each in caches.iterdir() if re.fullmatch(f"{re.escape(package)}-[0-9a-f]{{16}}", each.name)]
    for each in sorted(ours, key=lambda each: each.lstat().st_mtime)[:-_FOLDERS]:
        shutil.rmtree(each, ignore_errors=True)
