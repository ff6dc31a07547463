"""Compiled code is kept on disk, is never that of another source, and touches nothing of the user's."""

from __future__ import annotations

import ast
import importlib
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from shutil import copytree, rmtree
from typing import Any

import numba
import pytest
from numba.core import caching

import stlbench
import stlbench_agents
import stlbench_methods
import stlbench_planning
from stlbench.contract import cached, compiled

SUMS = """
from numba import njit
from stlbench.contract import cached
from made.numbers import FACTOR

@cached
@njit()
def scaled(value):
    return FACTOR * value
"""


@pytest.fixture
def caches(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Where a package `made` keeps its code: its functions read a constant of another file."""
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "sums.py").write_text(SUMS)
    (tmp_path / "made" / "numbers.py").write_text("FACTOR = 2\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "caches"))
    return tmp_path / "caches"


@pytest.fixture
def begin(monkeypatch: pytest.MonkeyPatch, caches: Path) -> Callable[[], Any]:
    """Import the function as a new process does: then its code, and no note of the folder, is there."""

    def begin() -> Any:
        for name in [name for name in sys.modules if name.partition(".")[0] == "made"]:
            monkeypatch.delitem(sys.modules, name)
        importlib.invalidate_caches()
        compiled.folder.cache_clear()
        monkeypatch.setattr(compiled, "_BEGAN", time.time() + 1)
        monkeypatch.setattr(sys, "dont_write_bytecode", True)  # whose stamp is in whole seconds
        return importlib.import_module("made.sums").scaled

    return begin


def hits(function: Any) -> int:
    return sum(function.stats.cache_hits.values())


def test_code_is_loaded_until_another_file_of_the_package_changes(begin: Callable[[], Any], caches: Path) -> None:
    first, again = begin(), begin()
    assert (first(3), hits(first)) == (6, 0)
    assert (again(3), hits(again)) == (6, 1)
    (caches.parent / "made" / "numbers.py").write_text("FACTOR = 7\n")
    changed = begin()
    assert (changed(3), hits(changed)) == (21, 0)
    (caches.parent / "made" / "numbers.py").write_text("FACTOR = 2\n")
    back = begin()
    assert (back(3), hits(back)) == (6, 1)
    assert len(list(caches.iterdir())) == 2
    assert not list((caches.parent / "made").rglob("*.nb?"))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        (f"{compiled.__name__}.version", lambda of: "0.1"),
        ("sys.version", "3.99"),
        ("llvmlite.binding.get_host_cpu_name", lambda: "another"),
    ],
)
def test_other_software_and_processors_have_folders_of_their_own(
    begin: Callable[[], Any], monkeypatch: pytest.MonkeyPatch, name: str, value: Any
) -> None:
    begin()
    here = compiled.folder("made")
    compiled.folder.cache_clear()
    monkeypatch.setattr(name, value)
    assert here != compiled.folder("made") is not None


def test_code_of_a_source_that_was_edited_meanwhile_is_not_kept(
    begin: Callable[[], Any], monkeypatch: pytest.MonkeyPatch, caches: Path
) -> None:
    """The process may have imported what was there before: its code must not count for the new source."""
    begin()
    compiled.folder.cache_clear()
    monkeypatch.setattr(compiled, "_BEGAN", time.time() - 60)
    function = cached(numba.njit()(sys.modules["made.sums"].scaled.py_func))
    assert function(3) == 6
    assert not list(caches.rglob("*.nb?"))


def test_where_nothing_can_be_written_each_process_compiles(
    begin: Callable[[], Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "in"))
    function = begin()
    assert compiled.folder("made") is None
    assert (function(3), hits(function)) == (6, 0)


def test_a_full_disk_stops_nothing(begin: Callable[[], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def save(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "save", save)
    assert begin()(3) == 6


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_damaged_code_is_compiled_again(begin: Callable[[], Any], caches: Path, kind: str) -> None:
    assert begin()(3) == 6
    for path in caches.rglob(f"*.{kind}"):
        path.write_bytes(path.read_bytes()[:40])
    damaged = begin()
    assert (damaged(3), hits(damaged)) == (6, 0)
    repaired = begin()
    assert (repaired(3), hits(repaired)) == (6, 1)


def test_a_change_of_numbas_interfaces_stops_nothing(
    begin: Callable[[], Any], monkeypatch: pytest.MonkeyPatch, caches: Path
) -> None:
    monkeypatch.setitem(sys.modules, "stlbench.contract.compiled_numba", None)
    with pytest.warns(RuntimeWarning, match=r"code is not kept with Numba .*: each process compiles again"):
        function = begin()
    assert function(3) == 6
    assert not list(caches.rglob("*.nb?"))


def test_a_setting_of_numbas_does_not_lead_elsewhere(
    begin: Callable[[], Any], monkeypatch: pytest.MonkeyPatch, caches: Path
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", "InTreeCacheLocator", raising=False)
    assert begin()(3) == 6
    assert list(caches.rglob("*.nbi"))


def test_a_function_that_is_not_compiled_stays_as_it_is() -> None:
    assert cached(len) is len


def test_ways_of_compiling_lie_apart(begin: Callable[[], Any], caches: Path) -> None:
    function = begin()
    way = cached(numba.njit(fastmath=True)(function.py_func), "fast")
    assert way.stats.cache_path == str(Path(function.stats.cache_path) / "fast")


class TestStrangers:
    """Numba's files are pickles, which can run code when they are loaded."""

    @pytest.fixture(autouse=True)
    def made(self, begin: Callable[[], Any], caches: Path) -> None:
        assert begin()(3) == 6
        compiled.folder.cache_clear()

    def refused(self) -> bool:
        with pytest.warns(RuntimeWarning, match="others can change it, as in .* NUMBA_CACHE_DIR"):
            return compiled.folder("made") is None

    @pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o1777])
    def test_a_folder_to_which_others_can_write(self, caches: Path, mode: int) -> None:
        next(caches.iterdir()).chmod(mode)
        assert self.refused()

    def test_a_folder_of_another_user(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
        assert self.refused()

    def test_in_the_folder_of_another_user_none_is_made(self, monkeypatch: pytest.MonkeyPatch, caches: Path) -> None:
        """As with sudo, whose folder would be refused to that user for ever."""
        next(caches.iterdir()).rename(caches.parent / "elsewhere")
        if os.geteuid() == 0:  # whose folders are trusted
            os.chown(caches, 12345, -1)
        else:
            monkeypatch.setattr(os, "geteuid", lambda: 12345)
        assert self.refused()
        assert not list(caches.iterdir())

    def test_a_link(self, caches: Path, tmp_path: Path) -> None:
        folder = next(caches.iterdir())
        folder.rename(tmp_path / "elsewhere")
        folder.symlink_to(tmp_path / "elsewhere")
        assert self.refused()

    def test_a_folder_that_others_can_replace(self, caches: Path) -> None:
        caches.chmod(0o777)
        assert self.refused()

    def test_as_in_tmp_others_cannot_replace_what_is_not_theirs(self, caches: Path) -> None:
        caches.chmod(0o1777)
        assert compiled.folder("made") == next(caches.iterdir())

    def test_a_new_folder_is_for_its_user_alone(self, caches: Path) -> None:
        assert next(caches.iterdir()).stat().st_mode & 0o777 == 0o700


def test_a_folder_that_was_deleted_meanwhile_is_not_made_again_for_others(
    begin: Callable[[], Any], caches: Path
) -> None:
    function = begin()
    rmtree(caches)
    assert function(3) == 6
    assert not caches.exists()
    caches.mkdir()
    before, now = os.umask(0), begin()
    try:
        rmtree(next(caches.iterdir()))
        assert now(3) == 6
    finally:
        os.umask(before)
    assert next(caches.iterdir()).stat().st_mode & 0o777 == 0o700


def test_the_folders_used_last_stay(begin: Callable[[], Any], caches: Path) -> None:
    others = [caches / "made", caches / "made-up-0123456789abcdef", caches / "other-0123456789abcdef"]
    old = [caches / f"made-{i:016x}" for i in range(12)]
    for i, path in enumerate([*old, *others]):
        path.mkdir(parents=True)
        (path / "code.nbc").touch()
        os.utime(path, (1000 + i, 1000 + i))
    begin()
    now = compiled.folder("made")
    assert now is not None
    assert {*caches.iterdir()} == {now, *old[-7:], *others}


def test_without_a_home_the_folder_is_a_temporary_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def home() -> Path:
        raise RuntimeError("no home directory")

    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(compiled.Path, "home", home)
    monkeypatch.setattr(compiled, "gettempdir", lambda: str(tmp_path))
    compiled.folder.cache_clear()
    found = compiled.folder("stlbench_methods")
    compiled.folder.cache_clear()
    assert found is not None
    assert found.parent == tmp_path / f"stlbench-{os.geteuid()}"


def run(code: str, folder: Path, **environment: str) -> str:
    kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    command, environment = [sys.executable, "-c", code], kept | environment
    return subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=True).stdout


FLAGS = """
import numpy as np
from stlbench import stl
from stlbench.contract import Specification
from stlbench_methods.flag import Flag
from stlbench_methods.formula_parts import F, G, FG
flag = Flag(Specification(stl.parse("G[1,2] x >= 0"), ("x",), (-9.0,), (9.0,), steps=2, dt=1.0))
x, t = np.array([1.0, 1, -1]).reshape(3, 1, 1), np.zeros(1, dtype=np.int64)
rewards, _ = flag.along(x, np.zeros((1, 1)), t, flag.initial_memory(x[0], t))
print(F, G, FG, *rewards[:, 0].round(3))
"""


def test_the_flags_of_renumbered_terms(tmp_path: Path) -> None:
    """G[1,2] pays about 0 while its predicate holds, and -1 where it fails."""
    source = Path(stlbench_methods.__file__).parent
    copytree(source, tmp_path / source.name, ignore=lambda *_: ["__pycache__"])
    windows = tmp_path / source.name / "formula_parts.py"
    places = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "caches")}
    assert run(FLAGS, tmp_path, **places) == "0 1 2 -0.0 -1.0\n"
    windows.write_text(windows.read_text().replace("F, G, FG = 0, 1, 2", "F, G, FG = 1, 2, 0"))
    assert run(FLAGS, tmp_path, **places) == "1 2 0 -0.0 -1.0\n"


USER = """
import sys
import numba
before = {name: value for name, value in vars(numba.config).items() if name.isupper()}
from stlbench.registry import plugins
for kind in ("agents", "methods"):
    for plugin in plugins.available(kind).values():
        plugin.load()
import stlbench_agents.engine, stlbench_methods.updates, stlbench_planning.loops
after = {name: value for name, value in vars(numba.config).items() if name.isupper()}
sys.path.insert(0, "")
from users import doubled
print(before == after, doubled(4))
"""


def test_a_users_own_functions_stay_beside_their_files(tmp_path: Path) -> None:
    """All agents and methods are imported: no setting of Numba's is another."""
    text = "import numba\n\n@numba.njit(cache=True)\ndef doubled(value):\n    return 2 * value\n"
    (tmp_path / "users.py").write_text(text)
    assert run(USER, tmp_path) == "True 8\n"
    assert {path.suffix for path in (tmp_path / "__pycache__").glob("users.doubled-*")} == {".nbi", ".nbc"}


PACKAGES = [
    Path(package.__file__ or "").parent for package in (stlbench, stlbench_methods, stlbench_agents, stlbench_planning)
]
DECORATORS = {"cached", "compiled", "inlined", "jitted", "kept", "njit", "part", "intrinsic"}


def test_there_is_no_other_way_to_keep_code() -> None:
    other = re.compile(r"cache ?= ?True|enable_caching|config\.CACHE|numba\.config|from numba import .*config")
    sources = [path for package in PACKAGES for path in package.rglob("*.py")]
    assert [path for path in sources if other.search(path.read_text()) and path.name != "compiled.py"] == []


def test_compiled_functions_read_nothing_of_another_package() -> None:
    """A change there would not be seen. Annotations are not read."""
    count = 0
    for path in [path for package in PACKAGES[1:] for path in package.rglob("*.py")]:
        tree = ast.parse(path.read_text())
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        of_stlbench = [node for node in imports if (node.module or "").partition(".")[0] == "stlbench"]
        foreign = {name.asname or name.name for node in of_stlbench for name in node.names}
        for function in [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]:
            decorators = {ast.unparse(each).partition("(")[0].split(".")[-1] for each in function.decorator_list}
            if decorators & DECORATORS or path.name in ("llvm_kernels.py", "llvm_vectors.py", "plain_kernels.py"):
                read = {each.id for node in function.body for each in ast.walk(node) if isinstance(each, ast.Name)}
                count += 1
                assert read & foreign <= {"cached"}, (path, function.name)
    assert count > 50
