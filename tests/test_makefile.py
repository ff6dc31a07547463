"""What `make` says where Python is missing or too old; nothing is installed here."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_a_python_that_is_not_there_is_not_called_old(tmp_path: Path) -> None:
    said = _make(tmp_path, "python3.99")
    assert "no python3.99 here; stlbench needs Python 3.11 or later" in said
    assert "older" not in said


def test_a_python_that_is_too_old(tmp_path: Path) -> None:
    old = tmp_path / "python3.9"
    old.write_text("#!/bin/sh\nexit 1\n", encoding="utf-8")
    old.chmod(0o755)
    assert f"{old} is older than Python 3.11, which stlbench needs" in _make(tmp_path, str(old))


@pytest.mark.parametrize("target", ["run", "test", "quick", "coverage", "gate", "soak", "reproduce", "docs"])
def test_every_target_names_files_that_are_there(target: str) -> None:
    dry = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=False)
    assert dry.returncode == 0, dry.stderr


def _make(folder: Path, python: str) -> str:
    command = ["make", f"PYTHON={python}", f"VENV={folder / 'venv'}", str(folder / "venv" / "bin")]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 2
    assert not (folder / "venv").exists()
    return ran.stdout + ran.stderr


def test_a_dry_run_trains_nothing() -> None:
    """A line of a recipe that names `$(MAKE)` runs under `make -n` too, and would refuse this table."""
    command = ["make", "-n", "reproduce", "TABLE=nothing"]
    dry = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (dry.returncode, dry.stderr) == (0, "")
    assert "studies/reproduce.py nothing" in dry.stdout
