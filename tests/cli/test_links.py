"""What a stranger puts in the place of a file of results: a link to a file of the user, or a pipe.

No command shows or packs what a link leads to, and none waits for a pipe.
"""

from __future__ import annotations

import os
import shutil
import threading
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.records.ledger import LEDGER
from stlbench.records.result_files import LINES, PACKED, cell_files
from stlbench.study.results import Results

SECRET = "the-key-of-the-user"
CELL = "toy-line/toy-raw/toy-agent/0"
LOG, TRACES, POLICIES = "LOG", "TRACES", "POLICIES"  # of the cell
ALWAYS = (f"show cell {CELL}", "report results", "export results --format jsonl", "compare results results")
READ_BY = {
    "notes.md": ("bundle results a.zip",),
    "report.html": ("bundle results a.zip",),
    "cells.csv": ("bundle results a.zip", "compare results results"),
    LOG: (f"show cell {CELL}", f"show cell {CELL} --json", "report results --html", "results merge new results"),
    TRACES: (
        *("bundle results a.zip --traces", "results merge new results", "verify results", "plot results"),
        *("report results --html", f"render results {CELL}"),
    ),
    POLICIES: (
        *("bundle results a.zip", "results merge new results", "verify results"),
        f"score toy-line {CELL}",
        f"render results {CELL} --start-index 0 --format png",
        f"falsify {CELL} --evaluations 8",
        f"certify {CELL} --starts 8",
        f"policies get {CELL} taken --results results",
        "policies list --results results",
        f"export-policy {CELL} out.onnx",
    ),
    ".lock": ("report results",),
    LEDGER: (*ALWAYS, "verify results", "results merge new results", "bundle results a.zip"),
    f"{LEDGER}-journal": ("report results", "verify results"),
    f"{LEDGER}-wal": ("report results",),
    **dict.fromkeys((LINES, PACKED), (*ALWAYS, "verify results", "results merge new results", "bundle results a.zip")),
    "provenance.json": ("compare results results",),
}


@pytest.fixture
def results(ran: None) -> Path:
    """A folder of results with a file of each kind, and a secret of the user beside it."""
    folder = Path("results")
    names = places(folder)
    names[LOG].parent.mkdir(exist_ok=True)
    for path in (names[LOG], folder / "notes.md"):
        path.write_text("hello\n")
    Path("secret").write_text(f"{SECRET}\n" * 30)
    return folder


def places(folder: Path) -> dict[str, Path]:
    result = Results.load(folder).cell(CELL)
    traces, policies, log, _ = cell_files(folder, result.id, result.key)
    return {LOG: log, TRACES: traces, POLICIES: policies}


def prepared(folder: Path, name: str) -> Path:
    """The path of a file, in a folder without what would be read before it."""
    path = places(folder).get(name, folder / name)
    if name == PACKED:
        told("export results --format jsonl")
    before = {LINES: (LEDGER,), **dict.fromkeys((PACKED, "cells.csv", "provenance.json"), (LEDGER, LINES))}
    for other in before.get(name, ()):
        (folder / other).unlink()
    return path


@contextmanager
def planted(kind: str, path: Path) -> Iterator[list[Path]]:
    """Put something in the place of a file; those pipes that somebody has opened."""
    path.parent.mkdir(exist_ok=True)
    path.unlink(missing_ok=True)
    opened = list[Path]()
    if kind == "link":
        path.symlink_to(Path("secret").absolute())
        yield opened
    else:
        os.mkfifo(path)
        with answered(path, opened):
            yield opened


@contextmanager
def answered(pipe: Path, opened: list[Path]) -> Iterator[None]:
    """Whoever opens the pipe is noted and gets the secret, and so does not wait."""
    place, over = pipe.absolute(), threading.Event()

    def answer() -> None:
        while not over.is_set():
            with suppress(BrokenPipeError), place.open("wb") as file:
                if not over.is_set():
                    opened.append(pipe)
                    file.write(f"{SECRET}\n".encode())

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        end = os.open(place, os.O_RDONLY | os.O_NONBLOCK)
        thread.join()
        os.close(end)


def told(command: str) -> str:
    """What a command prints; no traceback."""
    done = CliRunner().invoke(app, command.split())
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    assert "--help')" not in done.output  # the words are those of a command
    return done.output


def written() -> Iterator[tuple[str, bytes]]:
    """The regular files below the working directory but the secret itself, and what archives have in them."""
    for path in Path().rglob("*"):
        if path.is_symlink() or not path.is_file() or path.name == "secret":
            continue
        yield str(path), path.read_bytes()
        if path.suffix == ".zip":
            with zipfile.ZipFile(path) as archive:
                yield from ((f"{path}: {name}", archive.read(name)) for name in archive.namelist())


@pytest.mark.parametrize("name", READ_BY)
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_no_command_reads_what_is_no_file_of_the_folder(results: Path, name: str, kind: str) -> None:
    path = prepared(results, name)
    with planted(kind, path) as opened:
        before = path.lstat().st_mode
        for command in READ_BY[name]:
            assert SECRET not in told(command), command
            assert path.lstat().st_mode == before, command
            assert [place for place, content in written() if SECRET.encode() in content] == [], command
            assert opened == [], command
            shutil.rmtree("new", ignore_errors=True)


@pytest.mark.parametrize(
    ("name", "command"),
    [
        (LEDGER, "report results"),
        (LINES, "report results"),
        ("cells.csv", "compare results results"),
        ("provenance.json", "compare results results"),
        (TRACES, f"render results {CELL}"),
        (POLICIES, f"score toy-line {CELL}"),
    ],
)
def test_a_link_to_the_very_file_is_refused_too(results: Path, name: str, command: str) -> None:
    """Its content may be right, and of another folder of the user."""
    path = prepared(results, name)
    if name == "provenance.json":
        path.write_text("{}")
    path.rename("moved")
    path.symlink_to(Path("moved").absolute())
    assert f"{path} is a link, and stlbench reads through none" in told(command)
    if path.suffix == ".npz":
        assert f"{path} is a link, or no file" in told("verify results")
        told("bundle results a.zip --traces")
        assert [place for place, _ in written() if place.endswith(f"{path.parent.name}/{path.name}")] == []


def test_what_the_user_names_may_be_a_link(results: Path) -> None:
    Path("folder").symlink_to("results")
    for name in (LEDGER, LINES, "cells.csv"):
        Path(name).symlink_to(results / name)
    for command in ("report folder", f"show cell {CELL} folder", "bundle folder a.zip", f"compare {LEDGER} cells.csv"):
        assert "error" not in told(command), command
    for name in (LEDGER, LINES):
        assert len(Results.load(name)) == 2
