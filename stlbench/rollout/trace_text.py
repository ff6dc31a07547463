"""The text of a table in a file that a user names. A stranger may have made it, so its size is limited."""

from __future__ import annotations

import codecs
import gzip
import io
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TextIO

from stlbench.errors import UsageError

STDIN = Path("-")
LARGEST = 2**29  # bytes of a file, and characters of its text
ROW = 2**24  # characters of a row, which may go over several lines
_HEAD = 2**12
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_GZIP = b"\x1f\x8b"
_OTHERS = {
    b"{": "JSON",
    b"[": "JSON",
    b"MATLAB": "a MAT-file",
    b"\x89HDF": "HDF5, as MATLAB 7.3 writes it",
    b"PAR1": "Parquet",
    b"PK\x03\x04": "a zip file, such as a spreadsheet",
    b"\x93NUMPY": "one array of NumPy",
    b"\0": "no text: it has a byte 0",
}
"""How files begin that are no table of text -> what they are."""
_REMEDY = "write a table of text (CSV), as writetable of MATLAB and to_csv of pandas do, or an .npz"


class Lines(Iterator[str]):
    """The lines of a table of text: UTF-8 or, with its mark, UTF-16; also compressed by gzip.

    Raises, also on the way, `OSError`, `EOFError`, `zlib.error` or `UnicodeError` where it cannot be read, and
    `UsageError` where it is too large or has another format.
    """

    def __init__(self, path: Path, source: str) -> None:
        self._source = source
        self._file = self._opened(path)
        self._row = self._all = 0

    def __next__(self) -> str:
        line = self._file.readline(ROW + 1)
        self._row += len(line)
        self._all += len(line)
        if self._row > ROW:
            raise UsageError(f"{self._source}: a row has more than {ROW:,} characters; is a quotation mark missing?")
        if self._all > LARGEST:
            raise self._too_large()
        if not line:
            raise StopIteration
        return line

    def end_row(self) -> None:
        self._row = 0

    def _opened(self, path: Path) -> TextIO:
        with nullcontext(sys.stdin.buffer) if path == STDIN else path.open("rb") as file:
            data = file.read(LARGEST + 1)
        if len(data) > LARGEST:
            raise self._too_large()
        content: io.BytesIO | gzip.GzipFile = io.BytesIO(data)
        if data.startswith(_GZIP):
            content = gzip.GzipFile(fileobj=content)
        head = content.read(_HEAD)
        content.seek(0)
        encoding = "utf-16" if head.startswith(_UTF_16) else "utf-8-sig"
        begin = head.removeprefix(codecs.BOM_UTF8).lstrip()
        for mark, form in _OTHERS.items():
            if begin.startswith(mark) or (mark == b"\0" and mark in head and encoding != "utf-16"):
                raise UsageError(f"{self._source} is {form}; {_REMEDY}")
        return io.TextIOWrapper(content, encoding, newline="")

    def _too_large(self) -> UsageError:
        rule = f"at most {LARGEST >> 20} MiB of text are read; leave rows or columns out, or write an .npz"
        return UsageError(f"{self._source} is too large: {rule}")
