"""Results as lines of JSON: written beside a ledger as cells end, packed for git, and read, whoever wrote them.

The last line of a cell counts. So a run takes nothing out of its file: what came later stands below.
"""

import json
import lzma
import os
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from io import DEFAULT_BUFFER_SIZE, BufferedReader, RawIOBase, TextIOWrapper
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, Literal, Self, TypeVar

from stlbench.errors import UsageError
from stlbench.records.identity import IDENTITY, CellId, ReadCell, valid
from stlbench.records.result import NOT_RUN, TASK_FOLDER, Result, from_json, plain, to_json
from stlbench.records.result_files import LINES, PACKED, appended, is_there, to_read, write
from stlbench.records.rows import LedgerWarning
from stlbench.records.schema import LONGEST

_T = TypeVar("_T")
_ENDS = tuple(name.removeprefix("cells") for name in (LINES, PACKED))
_UNPACKED = 2**33  # the most bytes that a packed file may have unpacked: a small one may be made to fill all time
_MEMORY = 2**27  # bytes that unpacking may take; `xz -9` needs half of it, and a file may ask for 4 GiB
_KEY = re.compile(rb'"key": "([^"]+)"')  # no part of a cell's identity, which stands before, is an object
_REMOVED: Literal["removed"] = "removed"
"""The status in a line of a cell that was taken out."""


@dataclass(frozen=True)
class Lacking:
    """A line of a cell without a result: it was planned, or taken out."""

    cell: CellId
    key: str
    status: str = NOT_RUN

    @property
    def text(self) -> str:
        return json.dumps({**self.cell.plain, "key": self.key, "status": self.status})

    @classmethod
    def of(cls, text: str) -> Self | None:
        """The content of a line; None if it is of a result. Raises `ValueError` if a part is missing or wrong."""
        if NOT_RUN not in text and _REMOVED not in text:
            return None
        content = plain(text)
        if not isinstance(content, dict) or content.get("status") not in (NOT_RUN, _REMOVED):
            return None
        return cls(_cell_of(content), str(content.get("key", "")), content["status"])


def is_lines(path: Path) -> bool:
    """Whether a file of this name has lines of results."""
    return path.name.endswith(_ENDS)


def entries(path: Path) -> Iterator[Result | Lacking]:
    """The last line of each cell of a file, in the order of these lines. No cell that was taken out has one.

    A line that was cut at the end of the file, as by a kill, is left out with a `LedgerWarning`. Raises `UsageError` if
    any other line is none of a result, or the file cannot be read.
    """
    # read twice, so that only one result is in memory at a time
    last = {_checked(_cell_of, text, where): where for text, where in _texts(path)}
    counted = set(last.values())
    for text, where in _texts(path, warn=False):
        if where in counted:
            entry = _checked(Lacking.of, text, where) or _checked(from_json, text, where)
            if not (isinstance(entry, Lacking) and entry.status == _REMOVED):
                yield entry


def append(folder: Path, results: Iterable[Result] = (), removed: Iterable[CellId] = ()) -> None:
    """Write results, and cells that were taken out, at the end of `cells.jsonl`: on disk on return.

    A line that was cut there is taken away first. Raises `UsageError` as `result_files.appended`.
    """
    texts = (to_json(_without_path(result)) for result in results)
    with appended(folder / LINES, folder) as file:
        _end_line(file)
        for text in chain(texts, (Lacking(cell, "", _REMOVED).text for cell in removed)):
            file.write(f"{text}\n".encode())


def keys(folder: Path) -> set[str]:
    """The keys in the lines of `cells.jsonl`, which are not checked."""
    if not is_there(folder / LINES, folder):
        return set()
    with to_read(folder / LINES, folder) as file:
        found = map(_KEY.search, iter(partial(file.readline, LONGEST + 1), b""))
        return {match[1].decode(errors="replace") for match in found if match}


def write_lines(results: Iterable[Result], path: Path, planned: Mapping[str, CellId] | None = None) -> int:
    """Write `text_of` into a file, packed if its name says so; how many lines. Raises `UsageError` if it cannot."""
    text = text_of(results, planned)
    write(path, lzma.compress(text.encode()) if _is_packed(path) else text)
    return text.count("\n")


def text_of(results: Iterable[Result], planned: Mapping[str, CellId] | None = None) -> str:
    """One line per result, and per cell that was `planned` and has none, ordered by cell.

    Nothing is rounded, and nothing left out but the paths of tasks that are folders.
    """
    texts = [(result.id, to_json(_without_path(result))) for result in results]
    texts += [(cell, Lacking(cell, key).text) for key, cell in (planned or {}).items()]
    return "".join(text + "\n" for _, text in sorted(texts))


def _without_path(result: Result) -> Result:
    """A path of this machine means nothing elsewhere, and lines from elsewhere should not say where code is."""
    facts = {name: value for name, value in result.provenance.items() if name != TASK_FOLDER}
    return replace(result, provenance=facts)


def _cell_of(text: object) -> CellId:
    content = plain(text) if isinstance(text, str) else text
    if not isinstance(content, dict):
        raise ValueError(f"expected an object, got {text!r:.80}")
    cell: CellId = valid(ReadCell, {name: content[name] for name in IDENTITY if name in content})
    return cell


def _is_cut(text: str) -> bool:
    """Whether the end of a file is the beginning of a line that stlbench writes."""
    if not text.startswith("{"):
        return False
    try:
        plain(text)
    except json.JSONDecodeError:
        return True
    except ValueError:  # no line of ours is so deep
        return False
    return False


def _end_line(file: BinaryIO) -> None:
    """Have a file end in a whole line."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - 1))
    if file.read() in (b"", b"\n"):  # of a long file no more is read at each line
        return
    file.seek(max(0, size - LONGEST - 1))
    if tail := file.read().rpartition(b"\n")[2]:
        if _is_cut(tail.decode(errors="replace")):
            file.seek(file.truncate(size - len(tail)))
        else:
            file.write(b"\n")


def _texts(path: Path, *, warn: bool = True) -> Iterator[tuple[str, str]]:
    try:
        with to_read(path, path.parent) as raw, _unpacked(raw, path) as binary:
            file, room = TextIOWrapper(binary, encoding="utf-8"), _UNPACKED
            for number, text in enumerate(iter(partial(file.readline, LONGEST + 1), ""), 1):
                where, room = f"{path}, line {number}", room - len(text)
                if len(text) > LONGEST:
                    raise UsageError(f"{where}: it has more than {LONGEST >> 20} MiB")
                if room < 0 and binary is not raw:
                    raise UsageError(f"{where}: the file would be more than {_UNPACKED >> 30} GiB unpacked")
                if text.endswith("\n") or binary is not raw or not _is_cut(text):
                    yield text, where
                elif warn:
                    why = "it was cut, as by a kill, and is left out"
                    warnings.warn(f"{where}: {why}; `stlbench run` measures its cell", LedgerWarning, stacklevel=4)
    except (OSError, EOFError, UnicodeError, lzma.LZMAError) as error:
        raise UsageError(f"cannot read {path}: {error}") from error


def _unpacked(raw: BinaryIO, path: Path) -> BinaryIO:
    return BufferedReader(_Unpacker(raw)) if _is_packed(path) else raw


def _is_packed(path: Path) -> bool:
    return path.name.endswith(_ENDS[1])


class _Unpacker(RawIOBase):
    """A packed file, read as what it packs; `lzma.open` has no limit of memory."""

    def __init__(self, raw: BinaryIO) -> None:
        self._raw, self._unpacker = raw, lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_MEMORY)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        into = memoryview(buffer)
        while not self._unpacker.eof:
            packed = self._raw.read(DEFAULT_BUFFER_SIZE) if self._unpacker.needs_input else b""
            if self._unpacker.needs_input and not packed:
                raise EOFError("it ends too early")
            if text := self._unpacker.decompress(packed, len(into)):
                into[: len(text)] = text
                return len(text)
        if self._unpacker.unused_data or self._raw.read(1):
            raise EOFError("it goes on after its end")
        return 0


def _checked(parse: Callable[[str], _T], text: str, where: str) -> _T:
    try:
        return parse(text)
    except ValueError as error:
        cause = str(error).splitlines()[0]
        raise UsageError(f"{where}: not a result as `stlbench export --format jsonl` writes it: {cause}") from error
