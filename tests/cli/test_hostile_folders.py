"""Folders of results from strangers: no command imports what they name, writes through a link, or hangs."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from cli.conftest import TOY
from helpers import line_task, strangers
from helpers.kept_policies import trained
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.lines import write_lines
from stlbench.records.result import Result
from stlbench.records.result_files import cell_files
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.study.results import Results

CELL = "zz-evil/raw/zz-kept/0"
COMMANDS = f"""\
report DIR; report DIR --json; report DIR --html; plot DIR; show cell {CELL} DIR; verify DIR; verify DIR --repair
falsify {CELL} --results DIR --evaluations 8; falsify --all --results DIR --evaluations 8
certify {CELL} --results DIR --starts 8; score zz-line {CELL} --results DIR
render DIR {CELL}; render DIR {CELL} --start-index 0 --format png; export-policy {CELL} out.onnx --results DIR
export DIR; export DIR --format jsonl; compare DIR DIR; bundle DIR out.zip --title T --author A
verify out.zip; verify out.zip --rescore; policies list --results DIR; policies get {CELL} got --results DIR
policies run {CELL} --results DIR; run --tasks zz-evil --methods raw --results DIR; gate DIR
results merge merged DIR; results remove DIR {CELL} --yes
"""
READ = [command for line in COMMANDS.splitlines() for command in line.split("; ")]
WRITE = (
    *("report DIR", "report DIR --html", "plot DIR", "export DIR"),
    *("export DIR --format jsonl", "verify DIR --repair"),
)


def told(command: str, folder: Path) -> tuple[int, str]:
    done = CliRunner().invoke(app, command.replace("DIR", str(folder)).split())
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


@pytest.fixture
def evil(site: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Path]]:
    """A function that writes results of a task that is a folder, and what the results call that folder."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "results"
    folder.mkdir()

    def made(named: str) -> Path:
        task = folder / "zz-evil"
        task.mkdir()
        (task / "task.yaml").write_text(line_task.text(agents={"zz-kept": {}}))
        mark = f"import pathlib\npathlib.Path({str(tmp_path / 'marker')!r}).touch()\n"
        (task / "system.py").write_text(mark + line_task.SYSTEM)
        record(folder, renamed(trained(site, folder), folder, named))
        return folder

    yield made
    for name in [name for name in plugins._ADDED["tasks"] if name.startswith("zz-evil")]:
        del plugins._ADDED["tasks"][name]


def record(folder: Path, result: Result) -> None:
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(result)


def renamed(result: Result, folder: Path, named: str) -> Result:
    """The same cell, of the other task."""
    other = replace(result, id=replace(result.id, task=Choice("zz-evil")), provenance={"task_folder": named})
    before, after = cell_files(folder, result.id, result.key), cell_files(folder, other.id, other.key)
    before.traces.rename(after.traces)
    before.policies.rename(after.policies)
    return other


def test_no_command_imports_what_results_name(
    evil: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside the task of the cell that commands name, there is one for each way to have a module imported."""
    folder = evil(str(tmp_path / "results" / "zz-evil"))
    monkeypatch.syspath_prepend(str(tmp_path))
    (one,) = Results.load(folder)
    for number, kind in enumerate(strangers.KINDS, 1):
        task = folder / f"zz-evil-{number}"
        strangers.plant(task, kind, tmp_path)
        identity = replace(one.id, task=Choice(task.name))
        record(folder, replace(one, id=identity, key=f"{number:032}", provenance={"task_folder": str(task)}))
    for command in READ:
        told(command, folder)
        assert not (tmp_path / "marker").exists(), command


@pytest.mark.slow
@pytest.mark.parametrize("named", ["results/zz-evil", "results/../results/zz-evil", "./results/zz-evil"])
def test_nor_where_the_path_is_relative(evil: Callable[[str], Path], tmp_path: Path, named: str) -> None:
    told(f"render DIR {CELL} --start-index 0", evil(named))
    assert not (tmp_path / "marker").exists()


def test_nor_does_python(evil: Callable[[str], Path], tmp_path: Path) -> None:
    results = Results.load(evil(str(tmp_path / "results" / "zz-evil")))
    assert len(results.cells()) == 1
    with pytest.raises(ValueError, match="no task 'zz-evil'"):
        results.policy(CELL)
    assert not (tmp_path / "marker").exists()


def test_nor_is_it_imported_from_lines(evil: Callable[[str], Path], tmp_path: Path) -> None:
    folder = evil("results/zz-evil")
    with Ledger(folder / LEDGER, create=False) as ledger:
        (result,) = ledger.results()
    write_lines([result], folder / "cells.jsonl")
    lines = folder / "cells.jsonl"
    named = lines.read_text().replace('"provenance": {', '"provenance": {"task_folder": "results/zz-evil"')
    lines.write_text(named)
    (folder / LEDGER).unlink()
    told("report DIR", folder)
    told(f"render DIR {CELL} --start-index 0", folder)
    assert not (tmp_path / "marker").exists()


def test_what_is_left_out_is_said_and_there_where_the_user_names_the_folder(
    evil: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = evil("results/zz-evil")
    code, text = told("report DIR", folder)
    assert code == 0
    said = "warning: not installed: zz-evil; what needs the task is left out. If you trust its folder, name it:"
    assert text.count(f"{said} --task-folder PATH\n") == 1
    code, text = told("report DIR --task-folder DIR/zz-evil", folder)
    assert code == 0
    assert "not installed" not in text
    assert (tmp_path / "marker").exists()
    assert told(f"render DIR {CELL} --start-index 0 --format png --task-folder DIR/zz-evil", folder)[0] == 0


def test_no_command_writes_through_a_link(evil: Callable[[str], Path], tmp_path: Path) -> None:
    folder, outside, victim = evil("no"), tmp_path / "outside", tmp_path / "victim"
    for command in WRITE:
        told(command, folder)
    written = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    assert len(written) > 20
    victim.mkdir()
    for name in written - {Path(LEDGER)}:  # each file is a link to one of the user's, or to one that is not there
        (victim / name.name).write_text("mine")
        (folder / name).unlink()
        (folder / name).symlink_to(victim / name.name if len(name.name) % 2 else outside)
    for command in WRITE:
        told(command, folder)
        assert {path.read_text() for path in victim.iterdir()} == {"mine"}, command
        assert not outside.exists(), command


def test_nor_into_a_folder_that_is_a_link(evil: Callable[[str], Path], tmp_path: Path) -> None:
    folder, outside = evil("no"), tmp_path / "outside"
    outside.mkdir()
    for name in ("figures", "export", "films", "falsified", "logs", "traces", "policies"):
        if (folder / name).is_dir():
            shutil.copytree(folder / name, outside, dirs_exist_ok=True)
            shutil.rmtree(folder / name)
        (folder / name).symlink_to(outside)
    (outside / "mine").write_text("mine")
    before = sorted(path.name for path in outside.iterdir())
    for command in (*WRITE, f"render DIR {CELL} --format png", f"results remove DIR {CELL} --yes"):
        told(command, folder)
        assert sorted(path.name for path in outside.iterdir()) == before, command


@pytest.mark.parametrize("name", ["traces", "policies", "logs", ".lock", LEDGER])
def test_a_run_neither_writes_nor_deletes_behind_a_link(toy: Path, say: Callable, tmp_path: Path, name: str) -> None:
    outside, results = tmp_path / "outside", tmp_path / "hostile"
    results.mkdir()
    (results / name).symlink_to(outside)
    if name in (".lock", LEDGER):
        outside.write_text("")
    else:
        outside.mkdir()
        (outside / "mine").write_text("mine")
    place = "local" if name == "logs" else "toy-here"  # a cell in this process has no log
    done = say(*TOY[:-1], place, "--methods", "toy-raw", "--seeds", 1, "--results", results)
    if outside.is_file():
        assert outside.read_text() == ""
    else:
        assert [path.name for path in outside.iterdir()] == ["mine"]
    if name != "logs":
        assert done.exit_code != 0
        assert re.search(f"{name} is a link, and stlbench (reads|writes) through none", done.stderr)


@pytest.mark.parametrize("name", ["tensorboard", "tensorboard/toy-line"])
def test_nor_does_a_log(toy: Path, say: Callable, tmp_path: Path, name: str) -> None:
    outside, link = tmp_path / "outside", tmp_path / "hostile" / name
    outside.mkdir()
    link.parent.mkdir(parents=True)
    link.symlink_to(outside)
    done = say(*TOY, "--methods", "toy-raw", "--seeds", 1, "--results", tmp_path / "hostile", "--log", "tensorboard")
    assert (done.exit_code, list(outside.iterdir())) == (2, [])
    assert f"{name} is a link, and stlbench writes through none" in done.stderr


def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(evil: Callable[[str], Path]) -> None:
    folder = evil("no")
    for name in (".lock", "report.md", "cells.jsonl"):
        (folder / name).unlink(missing_ok=True)
        os.mkfifo(folder / name)
    for command in ("verify DIR", "report DIR", "export DIR --format jsonl", "verify DIR --repair"):
        told(command, folder)
