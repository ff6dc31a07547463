"""What is read from a stranger's folder is a file in it, to which no link leads, and which nobody has to wait for."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

import pytest

from stlbench.errors import UsageError
from stlbench.records.result_files import end_of_log, is_there, names, read, to_read


def bound(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made, chdir(path.parent):  # the path of a socket has to be short
        made.bind(path.name)


PLANTED: dict[str, Callable[[Path], object]] = {
    "link": lambda path: path.symlink_to(path.parents[1] / "secret"),
    "link to nothing": lambda path: path.symlink_to(path.parents[1] / "nothing"),
    "link to a device": lambda path: path.symlink_to("/dev/zero"),
    "loop": lambda path: path.symlink_to(path),
    "pipe": os.mkfifo,
    "socket": bound,
    "folder": os.mkdir,
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "secret").write_text("secret\n")
    (tmp_path / "results").mkdir()
    return tmp_path / "results"


@pytest.mark.parametrize("what", PLANTED)
def test_what_is_no_file_is_not_read(folder: Path, what: str) -> None:
    path = folder / "name.log"
    PLANTED[what](path)
    assert not is_there(path, folder)
    assert end_of_log(path, folder) == []
    said = "is a link, and stlbench reads through none" if path.is_symlink() else "cannot read|Is a directory"
    with pytest.raises((UsageError, IsADirectoryError), match=said):
        to_read(path, folder)


def test_nor_is_a_file_behind_a_link_to_a_folder(folder: Path) -> None:
    (folder / "logs").symlink_to(folder.parent)
    assert not is_there(folder / "logs" / "secret", folder)
    assert names(folder / "logs", folder, "") == []
    assert is_there(folder / "logs" / "secret", folder / "logs")  # a folder that the user names
    with pytest.raises(UsageError, match="logs is a link"):
        read(folder / "logs" / "secret", folder)
    with pytest.raises(UsageError, match="is not inside"):
        read(folder / ".." / "secret", folder)


def test_nor_what_takes_the_place_of_a_file_after_the_look_at_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stlbench.records.result_files.inside", lambda path, *_: path)
    os.mkfifo(folder / "pipe")
    (folder / "link").symlink_to(folder.parent / "secret")
    with pytest.raises(UsageError, match="it is no file"):
        to_read(folder / "pipe", folder)
    with pytest.raises(OSError, match="symbolic links"):
        to_read(folder / "link", folder)


def test_a_file_and_none_at_all(folder: Path) -> None:
    (folder / "logs").mkdir()
    (folder / "logs" / "a.log").write_text("one\ntwo\x1b\nthree\n")
    assert read(folder / "logs" / "a.log", folder) == b"one\ntwo\x1b\nthree\n"
    assert end_of_log(folder / "logs" / "a.log", folder, 2) == ["two\\x1b", "three"]
    assert names(folder / "logs", folder, (".log", ".txt")) == ["a.log"]
    assert not is_there(folder / "logs" / "b.log", folder)
    assert not is_there(folder / "logs" / "a.log" / "b", folder)
    assert not is_there(folder / "no\0name", folder)
    with pytest.raises(FileNotFoundError):
        to_read(folder / "logs" / "b.log", folder)
