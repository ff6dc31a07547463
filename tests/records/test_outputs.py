"""Files are replaced as a whole, through no link, and what cannot be written is one line."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from stlbench.errors import DiskFull, UsageError
from stlbench.records.result_files import inside, opened, write


def test_text_and_bytes_with_the_folders_above(tmp_path: Path) -> None:
    assert write(tmp_path / "a" / "b" / "text", "ä\n").read_bytes() == b"\xc3\xa4\n"
    assert write(tmp_path / "bytes", b"\x00").read_bytes() == b"\x00"
    assert write(tmp_path / "bytes", "shorter").read_text() == "shorter"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "bytes"]


def test_a_link_is_followed_nowhere_below_the_folder(tmp_path: Path) -> None:
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "victim").write_text("mine")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "folder").symlink_to(tmp_path / "outside")
    (tmp_path / "results" / "file").symlink_to(tmp_path / "outside" / "victim")
    (tmp_path / "results" / "nowhere").symlink_to(tmp_path / "outside" / "new")
    for name in ("folder/victim", "folder/new", "file", "nowhere"):
        with pytest.raises(UsageError, match=r"is a link, and stlbench writes through none"):
            write(tmp_path / "results" / name, "theirs", tmp_path / "results")
    with pytest.raises(UsageError, match="is not inside"):
        inside(tmp_path / "results" / ".." / "outside", tmp_path / "results")
    assert [path.name for path in (tmp_path / "outside").iterdir()] == ["victim"]
    assert (tmp_path / "outside" / "victim").read_text() == "mine"


def test_the_folder_that_the_user_names_may_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "results").symlink_to(tmp_path / "disk")
    write(tmp_path / "results" / "report.md", "text", tmp_path / "results")
    assert (tmp_path / "disk" / "report.md").read_text() == "text"


def test_the_other_name_of_a_file_keeps_its_content(tmp_path: Path) -> None:
    (tmp_path / "victim").write_text("mine")
    os.link(tmp_path / "victim", tmp_path / "report.md")
    write(tmp_path / "report.md", "theirs")
    assert (tmp_path / "victim").read_text() == "mine"


def test_a_link_in_the_place_of_the_unfinished_file_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "victim").write_text("mine")
    (tmp_path / f"report.md.{os.getpid()}.part").symlink_to(tmp_path / "victim")
    write(tmp_path / "report.md", "theirs")
    assert (tmp_path / "victim").read_text() == "mine"


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_where_writing_ends_early_the_file_of_before_stays(tmp_path: Path, error: BaseException) -> None:
    write(tmp_path / "file", "before")

    def half() -> None:
        with opened(tmp_path / "file") as file:
            file.write(b"half")
            raise error

    with pytest.raises((DiskFull, KeyboardInterrupt)):
        half()
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("file", "before")]


def test_what_is_no_file_is_left_as_it_is(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    with pytest.raises(UsageError, match=r"cannot write .*pipe: it is neither a file nor a folder"):
        write(tmp_path / "pipe", "")
    with pytest.raises(UsageError, match=r"cannot write .*folder: "):
        write(tmp_path / "folder", "")
    with pytest.raises(UsageError, match="cannot write /dev/null: it is neither"):
        write(Path("/dev/null"), "")
