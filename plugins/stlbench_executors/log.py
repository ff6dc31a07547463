"""What a cell writes to standard output and error, in a file that cannot grow without end."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

PART = 64 * 1024
"""Bytes that are kept of the beginning, and as many of the end."""


class Log:
    """A pipe whose content goes to a file; there is no file where nothing is written.

    Args:
        path: the file, of which an older one is removed.
    """

    def __init__(self, path: Path) -> None:
        self.reading, self.writing = os.pipe()
        os.set_blocking(self.reading, False)
        self._path, self._length, self._tail = path, 0, bytearray()
        with suppress(OSError):
            if not path.parent.is_symlink():
                path.unlink(missing_ok=True)

    def take(self) -> bool:
        """Read what is there; False where nothing will come any more."""
        for _ in range(64):  # not for ever, where a cell writes faster
            try:
                data = os.read(self.reading, PART)
            except BlockingIOError:
                return True
            if not data:
                return False
            self._keep(data)
        return True

    def close(self) -> None:
        """Write the end of what was written, and how much lies between it and the beginning."""
        os.close(self.writing)
        self.take()
        os.close(self.reading)
        left_out = self._length - PART - len(self._tail)
        if left_out > 0:
            self._write(f"\n... {left_out} bytes left out ...\n".encode())
        self._write(bytes(self._tail))

    def _keep(self, data: bytes) -> None:
        room = max(0, PART - self._length)
        self._length += len(data)
        self._write(data[:room])
        self._tail = (self._tail + data[room:])[-PART:]

    def _write(self, data: bytes) -> None:
        if data:
            with suppress(OSError):  # a full disk, or a link: the cell may go on without a log
                self._path.parent.mkdir(parents=True, exist_ok=True)
                folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
                try:
                    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
                    with open(os.open(self._path.name, flags, 0o666, dir_fd=folder), "ab") as file:
                        file.write(data)
                finally:
                    os.close(folder)
