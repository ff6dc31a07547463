"""Every command of the documentation runs, and what pages show is what is printed, but for numbers."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import pytest
from helpers import given
from helpers.reader import ROOT, Reader, in_small

PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md"), *ROOT.glob("plugins/example/*.md")])
BLOCK = re.compile(r"^```(console|text)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)

NOT_RUN = {
    "dask scheduler": "serves a cluster until it is stopped",
    "sbatch": "needs Slurm",
    "tensorboard": "is another program, which serves until it is stopped",
    "docker": "needs Docker; tests/test_container.py checks the files",
    "git": "changes a repository; the commands of stlbench beside it run",
    "python -m pytest plugins/example": "tests/test_example_plugin.py runs these tests",
}
"""How lines begin that no test types, and why."""

INSTEAD = {
    "dask[address=tcp://login1:8786]": ("local", "a cluster's address; tests/executors run dask"),
    "study/shard-*": ("results", "names that a shell finds; tests/cli/test_results_cli.py merges shards"),
    ",wandb[project=funnels,mode=offline]": ("", "another library, which is not among those of the tests"),
    "--format mp4": ("--format webp", "needs the program ffmpeg"),
    "lunar-lander model.zip": ("lunar-lander lander.zip", "another model than that for hold-disc"),
    "--resolution 0.6": ("--resolution 0.2", "takes 10 seconds"),
    "plan overlap": ("plan hold-disc --resolution 0.2", "takes minutes"),
    "without=cuts gamma=1": ("gamma=0.9", "hold-disc has no cuts"),
    "--trials 20": ("--trials 2", "takes as long as 60 cells a method"),
    "--least": ("--least --evaluations 100", "takes 10 seconds a controller"),
    "20_000": ("1", "takes 15 seconds"),
}
"""What tests type in place of some words, and why."""

GIVEN: dict[str, Sequence[Callable[[Path], None]]] = {
    "docs/howto/choose.md": [partial(given.committed, "survey", "reach-stay")],
    "docs/howto/cluster.md": [given.reference],
    "docs/howto/environment.md": [partial(given.titled, "howto/environment.md")],
    "docs/howto/failure.md": [given.policies, given.machines],
    "docs/howto/monitor.md": [partial(given.titled, "howto/monitor.md")],
    "docs/howto/policies.md": [given.policies, partial(given.titled, "howto/environment.md")],
    "docs/howto/python.md": [given.file_of_study],
    "docs/howto/share.md": [given.reference, partial(given.bundles, theirs="other")],
    "docs/howto/task.md": [given.own_task],
    "docs/reference/command-line.md": [
        *(given.example, given.policies, given.machines, given.bundles, given.reference),
        partial(given.committed, "reference", '"task": "hold-disc"'),
        partial(given.committed, "ablation", '"task": "overlap[without=cuts]"'),
    ],
    "docs/reference/results.md": [given.machines],
}
"""What pages take for granted, beside a folder `results` with a first run."""

FROM_NOTHING = {"docs/tutorial.md", "docs/howto/method.md"}
"""Pages that take nothing for granted."""

OTHER_CODES = {
    '"reach-stay/*" --status raised': ({2}, "no cell raised here, which is said"),
    "--against origin/main": ({2}, "the pages' folder is no repository; tests/cli/test_gate_against.py has one"),
}
"""Lines that may end with other exit codes than 0, and why."""

APART = {"docs/reference/command-line.md"}
"""Pages of which each block begins with what the page takes for granted, and not with what another block left."""

NOT_PRINTED = {
    "cells have results of other code": "of a change of code; tests/study/test_code_changes.py has the line",
    "compiling dqn, once per machine": "only where it was not compiled yet",
    "...": "stands for more lines",
}
"""What lines have that pages show, and that tests do not see printed, and why."""


def typed(text: str) -> Iterator[list[str]]:
    """What a page types, block by block."""
    for kind, block in BLOCK.findall(text):
        lines = block.replace("\\\n", " ").splitlines() if kind == "console" else []
        if found := [line.removeprefix("$ ").strip() for line in lines if line.startswith("$ ")]:
            yield found


def shown(text: str) -> Iterator[str]:
    """What a page shows of what is printed."""
    for kind, block in BLOCK.findall(text):
        yield "\n".join(line for line in block.splitlines() if kind == "text" or not line.startswith(("$ ", "  ")))


TYPED = {str(page.relative_to(ROOT)): found for page in PAGES if (found := list(typed(page.read_text("utf-8"))))}


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a first run, for all pages of a process."""
    folder = tmp_path_factory.mktemp("first")
    with pytest.MonkeyPatch.context() as monkeypatch:
        in_small(monkeypatch)
        given.results(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", TYPED)
def test_what_a_page_types_runs(
    page: str, first: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, site: Callable[..., Path]
) -> None:
    in_small(monkeypatch)
    (tmp_path / "work/plugins").mkdir(parents=True)
    if page not in FROM_NOTHING:
        shutil.copytree(first / "results", tmp_path / "work/results")
    (tmp_path / "work/plugins/example").symlink_to(ROOT / "plugins/example")
    reader = Reader(tmp_path / "work", monkeypatch, site)
    for give in GIVEN.get(page, ()):
        give(tmp_path / "work")
    printed, wrong = "", list[str]()
    for number, block in enumerate(TYPED[page]):
        if page in APART:
            shutil.copytree(tmp_path / "work", tmp_path / f"work-{number}", symlinks=True)
        reader.begins(tmp_path / (f"work-{number}" if page in APART else "work"))
        for line in block:
            done = reader.types(replaced(line))
            if done.exit_code not in expected(line) or "Traceback" in done.output:
                wrong.append(f"{line}: exit code {done.exit_code}: {done.output[-500:]}")
            printed += done.output
    assert not wrong, "\n".join(wrong)
    for block in shown((ROOT / page).read_text("utf-8")):
        check_shape(block, printed)


def replaced(line: str) -> str:
    if line.startswith(tuple(NOT_RUN)):
        return ""
    for words, (instead, _) in INSTEAD.items():
        line = line.replace(words, instead)
    return line


def expected(line: str) -> set[int]:
    """Exit codes."""
    return next((codes for words, (codes, _) in OTHER_CODES.items() if words in line), {0})


def check_shape(block: str, printed: str) -> None:
    """A table has its title and columns, other lines are as they are but for numbers."""
    said = Counter(map(masked, printed.splitlines()))
    if "\n---" in block:
        title, _, rest = block.partition("\n")
        assert title in printed
        table = printed.partition(title)[2]
        there = Counter([*columns(table), *left_out(table)])
        assert not Counter(columns("\n" + rest)) - there, title
    else:
        for line in block.splitlines():
            assert masked(line) in said or any(words in line for words in NOT_PRINTED), line


def columns(table: str) -> list[str]:
    """The words above the first rule."""
    return re.split(r"\n[-─]{9,}\n", table, maxsplit=1)[0].split()


def left_out(table: str) -> list[str]:
    """The words of the columns for which the screen had no room."""
    named = re.match(r".*?Left out on this narrow screen:(.*?)\.\n", table, re.DOTALL)
    return re.split(r"[\s,]+", named[1]) if named else []


def masked(line: str) -> str:
    """A line without what differs from run to run: numbers, and how wide they are."""
    return re.sub(r"\s+", " ", re.sub(r"-?\d[\d.,]*", "#", line)).strip()


@pytest.mark.parametrize("words", [*NOT_RUN, *INSTEAD, *OTHER_CODES])
def test_no_exception_is_for_nothing(words: str) -> None:
    assert any(words in line for page in TYPED.values() for block in page for line in block)
