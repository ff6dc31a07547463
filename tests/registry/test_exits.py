"""Plugins that end the process as they are imported, hang or interrupt it: each is named."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from stlbench.registry import exits, plugins
from stlbench.registry.exits import importing, interrupts_raise

WHAT = "method 'zz' of acme 1.2 (zz:One)"
IMPORTS = """
import ctypes, os, signal, time
from stlbench.registry import exits
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background has it ignored
exits._LONG = 0.05
with exits.importing("method 'zz' of acme 1.2 (zz:One)"):
    {code}
"""


def begun(code: str) -> subprocess.Popen[str]:
    """A process that imports a plugin with this code."""
    command = [sys.executable, "-c", IMPORTS.format(code=code)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("code", "number"),
    [
        ("os.abort()", signal.SIGABRT),
        ("ctypes.string_at(0)", signal.SIGSEGV),
        ("os.kill(os.getpid(), 9)", signal.SIGKILL),
    ],
)
def test_a_crash_is_one_line_that_names_the_plugin(code: str, number: int) -> None:
    with begun(code) as process:
        _, said = process.communicate(timeout=60)
    assert process.returncode == -number
    assert said == f"error: {WHAT} ended the process as it was imported\n"


def test_an_endless_import_is_told_and_so_is_who_was_interrupted() -> None:
    with begun("while True: pass") as process:
        assert process.stderr is not None
        assert process.stderr.readline() == f"warning: {WHAT} is still being imported, after 0.05 s\n"
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert said.startswith(f"interrupted while {WHAT} was imported\n")
    assert "ended the process" not in said


def test_an_import_that_goes_well_says_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with importing(WHAT):
        pass
    assert capfd.readouterr() == ("", "")
    assert signal.getsignal(signal.SIGINT) is before


def test_a_plugin_that_goes_elsewhere_leaves_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    with importing(WHAT):
        os.chdir("elsewhere")
    assert Path.cwd() == tmp_path


@pytest.mark.parametrize(
    "text", ["raise KeyboardInterrupt", "class E(BaseException): pass\nraise E", "raise GeneratorExit"]
)
def test_what_is_no_exception_is_one_too(site, text: str) -> None:
    site("acme", "[stlbench.methods]\nzz = zz_odd:One\n", {"zz_odd.py": text})
    loaded, problems = plugins.loadable("methods")
    assert "raw" in loaded
    (problem,) = (line for line in problems if "zz" in line)
    assert problem.startswith("method 'zz' of acme 1.2 (zz_odd:One): ")


@pytest.fixture
def _interrupts() -> Iterator[None]:
    """SIGINT interrupts, as in a shell in the foreground. A shell in the background has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_interrupts")
def test_an_interrupt_by_the_user_stays_one() -> None:
    with pytest.raises(KeyboardInterrupt), interrupts_raise():
        signal.raise_signal(signal.SIGINT)
    with pytest.raises(SystemExit, match="it raised KeyboardInterrupt"), interrupts_raise():
        raise KeyboardInterrupt


def test_where_there_is_no_shell_nothing_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exits, "_SHELL", "/nowhere/sh")
    with importing(WHAT):
        pass
