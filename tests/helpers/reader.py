"""A reader who types what a page shows, line by line, in one folder: commands run in this process, cells too."""

from __future__ import annotations

import shlex
import shutil
import sqlite3
import subprocess
import tomllib
from collections.abc import Callable, Generator, Sequence
from configparser import ConfigParser
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

import pytest
from matplotlib.figure import Figure
from PIL import Image
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.contract import Outcome, cause
from stlbench.registry import plugins
from stlbench.study import film, study
from stlbench.task import task
from stlbench.task.file import Budget, TaskFile
from stlbench_executors.local import LocalExecutor

ROOT = Path(__file__).parents[2]


class Typed(NamedTuple):
    """What came of a line."""

    exit_code: int
    output: str


class Reader:
    """Types lines in a folder.

    Args:
        folder: where the reader begins.
        monkeypatch: goes into the folder, and out of it at the end of the test.
        install: `site` of conftest.py: `pip install FOLDER` makes a distribution of the folder.
    """

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, install: Callable[..., Path]) -> None:
        self._monkeypatch, self._install = monkeypatch, install
        self._monkeypatch.chdir(folder)
        self._monkeypatch.syspath_prepend(str(folder))

    def begins(self, folder: Path) -> None:
        """A block of a page, in this folder, whatever the last one was in."""
        self._monkeypatch.chdir(folder)

    def types(self, line: str) -> Typed:
        """One line, of which the parts between && go one after another."""
        said = ""
        for part in line.split(" && "):
            words = shlex.split(part, comments=True)
            done = self._run(words)
            said += done.output
            if done.exit_code:
                return Typed(done.exit_code, said)
        return Typed(0, said)

    def _run(self, words: Sequence[str]) -> Typed:
        match words:
            case []:
                return Typed(0, "")
            case ["stlbench", *rest]:
                return stlbench(rest)
            case ["cd", where]:
                self._monkeypatch.chdir(where)
                return Typed(0, "")
            case ["cp", one, other]:
                Path(other).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(one, other)
                return Typed(0, "")
            case ["pip", "install", *rest]:
                return self._pip(rest[-1])
            case ["python", "-c", code]:
                exec(code, {"__name__": "__main__"})
                return Typed(0, "")
            case ["python", "-m", "zipfile", "-e", file, where]:
                ZipFile(file).extractall(where)
                return Typed(0, "")
            case ["sqlite3", file, query]:
                return Typed(0, str(sqlite3.connect(file).execute(query).fetchall()))
            case ["make", *rest]:
                return shell(["make", "-n", "-C", str(ROOT), *rest])
        raise AssertionError(f"no reader of the tests types '{shlex.join(words)}'")

    def _pip(self, what: str) -> Typed:
        """A folder becomes a distribution; of what is in an index, the extras have to be there."""
        name, _, extras = what.rstrip("]").partition("[")
        if name == "stlbench-rl":
            known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
            return Typed(int(not set(filter(None, extras.split(","))) <= known.keys()), f"extras: {', '.join(known)}")
        project = tomllib.loads((Path(name) / "pyproject.toml").read_text())["project"]
        assert not extras or extras in project["optional-dependencies"]
        entries = ConfigParser(delimiters=("=",))
        entries.read_dict(project["entry-points"])
        entries.write(text := StringIO())
        self._install(project["name"], text.getvalue())
        self._monkeypatch.syspath_prepend(str(Path(name).absolute() / "src"))
        return Typed(0, "")


def stlbench(words: Sequence[str]) -> Typed:
    """The command, in this process; what it raises is raised, and folders that are tasks are known to it alone."""
    plugins._ADDED["tasks"].clear()
    done = CliRunner().invoke(app, list(words), input="y\n")
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return Typed(done.exit_code, done.output)


def shell(words: Sequence[str]) -> Typed:
    """Another program."""
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    return Typed(done.returncode, done.stdout + done.stderr)


def in_small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every budget is of a few steps, a number of seeds is two at most, `local` runs cells in this process,
    figures are made and not drawn, and films have a frame a second."""
    parse, varied = study.parse_seeds, task._varied
    monkeypatch.setattr(task, "_varied", lambda *given: _short(varied(*given)))
    monkeypatch.setattr(study, "parse_seeds", lambda text: parse(text)[:2] if text.isdecimal() else parse(text))
    monkeypatch.setattr(LocalExecutor, "run", _here)
    monkeypatch.setattr(Figure, "savefig", _blank)
    monkeypatch.setattr(film, "FRAMES_A_SECOND", 1.0)
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    monkeypatch.setenv("COLUMNS", "220")


def _short(file: TaskFile) -> TaskFile:
    return file.model_copy(update={"budgets": {name: _small(budget) for name, budget in file.budgets.items()}})


def _small(budget: Budget) -> Budget:
    # All 64 copies of the rules' agent take two steps that are held for ten.
    small = {"steps": 1280, "seeds": 2, "checkpoints": 2, "random_starts": 4}
    return budget.model_copy(update={key: min(value, getattr(budget, key)) for key, value in small.items()})


def _here(
    self: object, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
) -> Generator[Outcome]:
    for index, item in enumerate(items):
        try:
            yield Outcome(index, "done", function(item))
        except Exception as error:
            yield Outcome(index, "raised", reason=cause(error))


def _blank(self: Figure, file: Any, *, format: str, **words: Any) -> None:
    if format == "png":
        Image.new("RGB", (4, 4)).save(file, format="png")
