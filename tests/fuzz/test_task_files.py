"""Any text in the place of a task file or of a study's file."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from cli.conftest import SYSTEM, TASK
from fuzz.answers import answer, fuzz, sizes
from fuzz.inputs import damaged, soup
from hypothesis import strategies as st

from stlbench.errors import UsageError
from stlbench.task.file import TaskFile
from stlbench.task.reading import read_task_file

BOMB = "&a [x, x]\n" + "".join(f"{name}: &{name} [{f'*{last}, ' * 9}]\n" for last, name in pairwise("abcdefghijklmno"))
ODD_LINES = r"""
null · [] · {} · x · '' · true · -1 · 0 · 1e400 · -.inf · .nan · 0x1F · 1:30:00 · 1_000 · 2001-99-99
2001-12-14t21:59:43.10-05:00 · !!int x · !!float x · !!binary 'é' · !!set {a} · !!python/tuple [1] · !!timestamp x
&a [*a] · *a · <<: *a · ? [a] · '\ud800' · "\ud800" · "\x1b[2J" · %YAML 9
[0, 1] · {low: 0, high: 1} · {low: 1, high: 0, count: 999999999999} · {x: [1, 0]}
"""
ODD_VALUES = [
    *(each for line in ODD_LINES.split("\n") if line for each in line.split(" · ")),
    *("9" * 5000, "|\n  text", "[" * 2000, "- " * 500),
]
"""What YAML reads in ways of its own."""

LINES = [line for line in TASK.splitlines() if line]


def _with(values: dict[str, str]) -> bytes:
    """The task file with other values, as text, for some of its keys."""
    lines = [f"{key}: {values[key]}" if (key := line.partition(":")[0]) in values else line for line in LINES]
    kept = [line for index, line in enumerate(lines) if not _is_below_a_replaced(lines, index, values)]
    known = {line.partition(":")[0] for line in LINES}
    added = [f"{key}: {value}" for key, value in values.items() if key not in known]
    return "\n".join(kept + added).encode("utf-8", "surrogatepass")


def _is_below_a_replaced(lines: list[str], index: int, values: dict[str, str]) -> bool:
    above = next((line for line in reversed(lines[: index + 1]) if not line.startswith(" ")), "")
    return lines[index].startswith(" ") and above.partition(":")[0] in values


REPLACED = st.dictionaries(st.sampled_from(sorted(TaskFile.model_fields)), st.sampled_from(ODD_VALUES), max_size=3)
FILES = st.one_of(
    damaged(TASK.encode()),
    REPLACED.map(_with),
    soup([*LINES, *ODD_VALUES, *(f"{name}:" for name in TaskFile.model_fields), "\n", "\n  ", ": ", "- "]).map(
        lambda text: text.encode("utf-8", "surrogatepass")
    ),
)


def check_task_file(data: bytes) -> None:
    """It is a task file, or all that is wrong with it is said."""
    try:
        read_task_file(data.decode("utf-8", "surrogateescape"), "line")
    except UsageError as error:
        refusal = str(error)
    else:
        return
    assert refusal.startswith("task line: task.yaml ")
    assert max(map(len, refusal.splitlines())) < 2000


@sizes(100, 15_000)
def test_a_text_is_a_task_file_or_is_refused(examples):
    fuzz(examples, FILES, check_task_file)


@pytest.mark.slow
@sizes(20, 3_000)
def test_a_folder_is_a_task_or_is_refused(say, examples):
    folder = Path("my-task")
    folder.mkdir()
    (folder / "system.py").write_text(SYSTEM)

    def check(data: bytes) -> None:
        (folder / "task.yaml").write_bytes(data)
        answer(say("show", "task", "./my-task"))

    fuzz(examples, FILES, check)


STUDY = b"tasks: toy-line\nmethods: [toy-raw]\nagents: [toy-agent]\nseeds: 0-3\nbudget: quick\nexecutor: toy-here\n"
KEYS = ["tasks", "methods", "agents", "seeds", "budget", "track", "recipes", "jobs", "memory", "results", "executor"]
ENTRIES = st.sampled_from([*ODD_VALUES, "[toy-raw, toy-raw]", "{a: [toy-line]}", "toy-line"])
STUDIES = st.one_of(
    damaged(STUDY),
    st.dictionaries(st.sampled_from(KEYS), ENTRIES).map(
        lambda values: "\n".join(f"{key}: {value}" for key, value in values.items()).encode("utf-8", "surrogatepass")
    ),
)


@sizes(15, 2_000)
def test_a_study_runs_or_is_refused(brief, examples):
    def check(data: bytes) -> None:
        Path("study.yaml").write_bytes(data)
        answer(brief("run", "study.yaml", "--results", "results", "--executor", "toy-here", "--seeds", 1))

    fuzz(examples, STUDIES, check)


@pytest.mark.parametrize("key", ["seeds", "tasks", "methods", "jobs", "budget", "zz"])
def test_a_bomb_of_aliases_is_refused(brief, key):
    """A text of a kilobyte that means a list of 10^13 entries."""
    Path("study.yaml").write_text(f"zz: {BOMB}{key}: *n\n")
    assert yaml.safe_load(Path("study.yaml").read_text())
    assert not answer(brief("run", "study.yaml"))
