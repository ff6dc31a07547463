"""The examples of docs/stl.md and of the package's docstring work as printed; the package stands alone."""

from __future__ import annotations

import doctest
import subprocess
import sys
from pathlib import Path

import stlbench.stl
from stlbench.stl import END, Expression, Formula, ShortTraces

PAGE = Path(__file__).parents[2] / "docs" / "stl.md"


def test_the_pages_examples() -> None:
    result = doctest.testfile(str(PAGE), module_relative=False)
    assert result.attempted >= 20
    assert result.failed == 0


def test_the_packages_example() -> None:
    assert doctest.testmod(stlbench.stl) == (0, 2)


def test_everything_exported_exists_and_is_documented() -> None:
    for name in stlbench.stl.__all__:
        exported = getattr(stlbench.stl, name)
        assert exported.__doc__ or exported in (END, Expression, Formula, ShortTraces), name


def test_imports_numpy_and_the_standard_library_alone() -> None:
    code = "import sys; before = {*sys.modules}; import stlbench.stl; print(*({*sys.modules} - before))"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    packages = {name.partition(".")[0] for name in loaded}
    assert packages - sys.stdlib_module_names <= {"numpy", "stlbench"}
