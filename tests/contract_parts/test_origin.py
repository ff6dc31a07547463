"""Another project's `stlbench` in place of this one: the package index has one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import stlbench
from stlbench.errors import foreign

OTHER = '"""STL files for resin printers."""\n__version__ = "1.3.4"\n'


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """A folder with the modules of stlbench, over which another distribution has laid its `__init__`."""
    package = tmp_path / "stlbench"
    package.mkdir()
    for path in Path(stlbench.__path__[0]).iterdir():
        if path.name not in ("__init__.py", "__pycache__"):
            (package / path.name).symlink_to(path)
    (package / "__init__.py").write_text(OTHER, encoding="utf-8")
    return tmp_path


def test_this_package_is_ours() -> None:
    assert foreign() is None
    assert stlbench.DISTRIBUTION == "stlbench-rl"


@pytest.mark.parametrize("file", ["/somewhere/stlbench/__init__.py", None])
def test_the_message_says_where_the_other_lies_and_how_to_mend_it(file: str | None) -> None:
    """Without a file the other was uninstalled: its `__init__` and ours are gone, and a namespace is left."""
    other = ModuleType("stlbench")
    other.__file__, other.__path__ = file, ["/somewhere/stlbench"]
    assert foreign(other) == (
        "the package stlbench in /somewhere/stlbench is not that of stlbench-rl: the distribution 'stlbench' is "
        "another project; pip uninstall stlbench, then pip install --force-reinstall --no-deps stlbench-rl"
    )


def test_the_command_says_so_in_one_line(mixed: Path) -> None:
    ran = _python(mixed, "from stlbench.cli import main; main()")
    assert (ran.returncode, ran.stdout) == (2, "")
    (line,) = ran.stderr.splitlines()
    assert line.startswith(f"error: the package stlbench in {mixed / 'stlbench'} is not that of stlbench-rl")


def test_a_plugin_that_imports_the_contract_is_told(mixed: Path) -> None:
    ran = _python(mixed, "import stlbench.contract")
    assert ran.returncode == 1
    last = ran.stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: the package stlbench in {mixed / 'stlbench'} is not that of stlbench-rl")


def _python(folder: Path, program: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", program]
    return subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)
