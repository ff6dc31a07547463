"""Tasks that are folders: what a path names, what is refused, and that the place of a folder changes nothing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from stlbench.errors import UsageError
from stlbench.registry import named_tasks, plugins
from stlbench.registry.choices import Choice
from stlbench.registry.fingerprint import code_of

SYSTEM = """
from stlbench.contract import System
from .dynamics import moved
class Line(System):
    state = ("x",)
    def step(self, state, action): return moved(state, self.dt * action)
    def signals(self, state): return state
    def features(self, state, t): return state
"""
FILES = {"task.yaml": "title: a line\n", "system.py": SYSTEM, "dynamics.py": "def moved(x, by): return x + by\n"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """A function that writes a task's folder; what is made known is forgotten after the test."""
    monkeypatch.setitem(plugins._ADDED, "tasks", {})

    def write(name: str = "zz-line", **changes: str | None) -> Path:
        place = tmp_path / name
        place.mkdir(parents=True)
        for file, text in (FILES | {key.replace("_", "."): value for key, value in changes.items()}).items():
            if text is not None:
                (place / file).write_text(text, encoding="utf-8")
        return place

    return write


def digest(task: named_tasks.FolderTask) -> str:
    return code_of(task.entry_point.module).digest


def test_a_path_is_a_task_by_the_folders_name(folder: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    place = folder()
    monkeypatch.chdir(place.parent)
    listed = named_tasks.parse_tasks("./zz-line[hold=2],hold-disc,./zz-line/")
    assert listed == (Choice("zz-line", (("hold", "2"),)), Choice("hold-disc"), Choice("zz-line"))
    assert named_tasks.place_of("zz-line") == place
    assert named_tasks.place_of("hold-disc") is None
    assert plugins.find("tasks", "zz-line").load().__name__ == "Line"
    monkeypatch.chdir(place)
    assert named_tasks.parse_task(".") == Choice("zz-line")


def test_its_place_changes_nothing_and_its_files_do(folder: Callable[..., Path]) -> None:
    first = named_tasks.know(folder("one/zz-line"))
    before = digest(first)
    copy = first.folder.parents[1] / "two" / "zz-line"
    shutil.copytree(first.folder, copy)
    with pytest.raises(UsageError, match=r"two/zz-line: task 'zz-line' in .*one/zz-line has the same name; rename"):
        named_tasks.know(copy)
    shutil.rmtree(first.folder)
    moved = named_tasks.know(copy)
    assert (moved.folder, digest(moved)) == (copy, before)
    with (copy / "dynamics.py").open("a") as file:
        file.write("edited = 1\n")
    assert digest(moved) != before


def test_the_class_that_no_other_class_is_built_on_is_the_system(folder: Callable[..., Path]) -> None:
    text = SYSTEM.replace("class Line(System):", "class Base(System):") + "class Last(Base): pass\n"
    assert named_tasks.know(folder(system_py=text)).load().__name__ == "Last"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1\n", "it has none"),
        (SYSTEM + SYSTEM.replace("class Line(", "class Other("), "it has Line, Other"),
        ("from stlbench.contract import System\n", "it has none"),
        ("import zz_missing\n", "No module named 'zz_missing'"),
    ],
)
def test_a_file_without_the_one_system_says_what_it_has(folder: Callable[..., Path], text: str, said: str) -> None:
    with pytest.raises(plugins.PluginError, match=f"^task 'zz-line' in .*zz-line.*{said}$"):
        named_tasks.know(folder(system_py=text)).load()


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("zz-line", {"task_yaml": None}, "there is no task.yaml; a task is a folder with task.yaml, and often"),
        ("Line_2", {}, "the folder's name is the task's, and consists of a-z, 0-9 and -"),
        ("hold-disc", {}, r"the name 'hold-disc' is taken by task 'hold-disc' of stlbench-rl .*; rename the folder"),
    ],
)
def test_a_folder_that_is_no_task_is_refused_in_a_line(
    folder: Callable[..., Path], name: str, changes: dict[str, None], said: str
) -> None:
    with pytest.raises(UsageError, match=f"^.*{name}: {said}") as caught:
        named_tasks.parse_task(f"{folder(name, **changes)}")
    assert "\n" not in str(caught.value)
    with pytest.raises(UsageError, match=r"^zz-nowhere: there is no such folder; a task is a folder with task.yaml"):
        named_tasks.parse_task("./zz-nowhere")
