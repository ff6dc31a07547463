"""Folders of `solve` from a stranger: no code of theirs runs, and nothing is written through their links."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

import pytest
import yaml
from helpers import strangers
from solver.conftest import FORMULA
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.solver.problem import Problem
from stlbench.solver.run import solve
from stlbench.solver.solution import Solution
from stlbench.solver.workspace import Workspace, workspace_of

FACTS = {"cell": "task/raw/dqn/0", "budget": "final"}


@pytest.fixture(autouse=True)
def importable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working directory is searched for modules, as for a script that the user runs there."""
    monkeypatch.syspath_prepend(str(tmp_path))
    plugins._ADDED["tasks"].pop("task", None)


@pytest.mark.parametrize("kind", strangers.KINDS)
def test_a_solution_with_code_is_refused(tmp_path: Path, kind: str) -> None:
    strangers.plant(tmp_path / "out" / "task", kind, tmp_path)
    (tmp_path / "out" / "certificate.json").write_text(json.dumps(FACTS))
    with pytest.raises(UsageError, match=r"out: its task runs .*; if you trust it, load it with run_code=True$"):
        Solution.load("out")
    assert not (tmp_path / strangers.MARK).exists()
    assert "task" not in plugins.available("tasks")  # else the next command of this process would run it


@pytest.mark.parametrize("text", ["[]", "{}", '{"cell": 1, "budget": "final"}', '{"cell": "x", "budget": []}', "\0"])
def test_a_certificate_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    strangers.plant(tmp_path / "out" / "task", "none", tmp_path)
    (tmp_path / "out" / "certificate.json").write_text(text)
    with pytest.raises(UsageError, match="out has no solution"):
        Solution.load("out")


@pytest.fixture(scope="module")
def posed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of a stranger, who knew what the user would ask for."""
    folder = tmp_path_factory.mktemp("posed")
    workspace_of(Problem("hold-disc", None), folder / "hold-disc")
    workspace_of(Problem("CartPole-v1", FORMULA), folder / "CartPole-v1")
    return folder


def again(posed: Path, environment: str, change: Any = None) -> Workspace:
    """Go on in such a folder, after the stranger has changed it."""
    shutil.copytree(posed / environment, "out")
    if change is not None:
        change(Path("out/task"))
    return workspace_of(Problem(environment, None if environment == "hold-disc" else FORMULA), Path("out"))


def mark(here: Path) -> str:
    return f"import pathlib\npathlib.Path({str(here / strangers.MARK)!r}).touch()\n"


@pytest.mark.parametrize("environment", ["hold-disc", "CartPole-v1"])
def test_what_solve_wrote_itself_goes_on(posed: Path, environment: str) -> None:
    assert again(posed, environment).task.name == "task"


@pytest.mark.parametrize("environment", ["hold-disc", "CartPole-v1"])
@pytest.mark.parametrize(
    "name", ["system.py", "helper.py", "system/__init__.py", f"system{EXTENSION_SUFFIXES[0]}", "by_hand.yaml"]
)
def test_solve_runs_no_code_that_it_did_not_write(posed: Path, tmp_path: Path, environment: str, name: str) -> None:
    def change(home: Path) -> None:
        path = home / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(mark(tmp_path) + (path.read_text() if path.is_file() else ""))

    with pytest.raises(UsageError, match=r"is not as this solve writes it; remove out, or name another$"):
        again(posed, environment, change)
    assert not (tmp_path / strangers.MARK).exists()
    assert "task" not in plugins.available("tasks")


def test_nor_what_python_compiled_there(posed: Path, tmp_path: Path) -> None:
    """A file beside the source, of which Python does not ask whether it is of that source."""

    def change(home: Path) -> None:
        code = compile(mark(tmp_path) + (home / "system.py").read_text(), "system.py", "exec")
        path = Path(importlib.util.cache_from_source(str(home / "system.py")))
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(importlib._bootstrap_external._code_to_hash_pyc(code, bytes(8), False))  # type: ignore[attr-defined]

    assert again(posed, "hold-disc", change).task.name == "task"
    assert not (tmp_path / strangers.MARK).exists()


@pytest.mark.parametrize("change", [lambda home: (home / "system.py").unlink(), shutil.rmtree])
def test_what_is_missing_is_said(posed: Path, change: Any) -> None:
    with pytest.raises(UsageError, match=r"out/task"):
        again(posed, "hold-disc", change)


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_task_file_is_read_through_no_link_and_no_pipe_is_waited_for(posed: Path, tmp_path: Path, kind: str) -> None:
    def change(home: Path) -> None:
        (home / "task.yaml").rename(tmp_path / "secret")
        if kind == "link":
            (home / "task.yaml").symlink_to(tmp_path / "secret")
        else:
            os.mkfifo(home / "task.yaml")

    with pytest.raises(UsageError, match=r"task\.yaml(: it is neither a file|is a link| is a link)"):
        again(posed, "hold-disc", change)


@pytest.mark.parametrize("kind", strangers.ENVIRONMENTS)
@pytest.mark.parametrize("environment", ["hold-disc", "CartPole-v1"])
def test_solve_imports_nothing_that_the_problem_does_not_name(
    posed: Path, tmp_path: Path, environment: str, kind: str
) -> None:
    def change(home: Path) -> None:
        content = yaml.safe_load((home / "task.yaml").read_text())
        other = content.get("environment", {}) | strangers.ENVIRONMENTS[kind]
        (home / "task.yaml").write_text(yaml.safe_dump(content | {"environment": other}))

    strangers.plant(tmp_path / "evil", kind, tmp_path)
    with pytest.raises(UsageError, match=r"task\.yaml: (id|api|kwargs|drawn) should be .*, as the problem has it"):
        again(posed, environment, change)
    assert not (tmp_path / strangers.MARK).exists()


def test_the_parameters_of_a_system_are_the_problems(posed: Path) -> None:
    def change(home: Path) -> None:
        text = (home / "task.yaml").read_text()
        (home / "task.yaml").write_text(f"{text}parameters: {{model: /etc/passwd}}\n")

    with pytest.raises(UsageError, match=r"parameters should be \{\}, as the problem has it"):
        again(posed, "hold-disc", change)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"problem": 1}', '{"problem": {}, "notes": [1], "episode_seconds": 1}', "\x00"]
)
def test_a_state_that_is_none_is_one_line(text: str) -> None:
    Path("out").mkdir()
    Path("out/solve.json").write_text(text)
    done = CliRunner().invoke(app, ["solve", "CartPole-v1", FORMULA, "--into", "out"])
    assert done.exit_code == 2
    assert done.stderr.splitlines()[-1].startswith("error: out/solve.json is not as `stlbench solve` writes it")


OUTPUTS = (
    *("task", "race", "final", "counterexample", "solve.json", "witness.json", "certificate.json"),
    *("solution.md", "policy.npz", "policy.onnx", "page.html", "film.gif"),
)


@pytest.mark.parametrize("name", OUTPUTS)
@pytest.mark.parametrize("new", [True, False])
def test_solve_writes_through_no_link(posed: Path, name: str, new: bool) -> None:
    if new:
        Path("out").mkdir()
    else:
        shutil.copytree(posed / "CartPole-v1", "out")
    target = Path("target")
    if Path("out", name).exists():
        Path("out", name).rename(target)
    elif "." in name:
        target.write_text("mine")
    else:
        target.mkdir()
    before = {path: path.read_bytes() for path in (target, *target.rglob("*")) if path.is_file()}
    Path("out", name).symlink_to(target.absolute())
    with pytest.raises(UsageError, match=rf"^out/{name} is a link, and stlbench writes through none"):
        solve("CartPole-v1", FORMULA, into="out", minutes=1.0, jobs=1)
    assert {path: path.read_bytes() for path in (target, *target.rglob("*")) if path.is_file()} == before


def test_nor_through_one_in_the_folder_of_the_task(posed: Path) -> None:
    def change(home: Path) -> None:
        (home / "task.yaml").rename("target")
        (home / "task.yaml").symlink_to(Path("target").absolute())

    with pytest.raises(UsageError, match=r"task\.yaml is a link, and stlbench writes through none"):
        again(posed, "CartPole-v1", change)


@pytest.mark.parametrize("name", ["certificate.json", "task", "task/task.yaml", "task/by_hand.yaml", "final"])
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_solution_is_read_through_no_link_and_no_pipe_is_waited_for(tmp_path: Path, name: str, kind: str) -> None:
    strangers.plant(tmp_path / "out" / "task", "none", tmp_path)
    path = tmp_path / "out" / name
    (tmp_path / "out" / "certificate.json").write_text(json.dumps(FACTS))
    if path.exists():
        path.rename(tmp_path / "secret")
    if kind == "link":
        path.symlink_to(tmp_path / "secret")
    else:
        os.mkfifo(path)
    with pytest.raises(UsageError, match=rf"{path} is a link|cannot read {path}|out has no solution.*Not a directory"):
        Solution.load(tmp_path / "out")
