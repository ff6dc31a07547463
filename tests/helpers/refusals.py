"""What a command says that refuses its input."""

from __future__ import annotations

from typer.testing import Result


def refused(done: Result) -> str:
    """The only line of a command that exits with code 2; nothing is on stdout."""
    assert (done.exit_code, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    return str(line)
