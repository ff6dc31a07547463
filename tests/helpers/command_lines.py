"""Command lines that pages show, parsed and not run."""

from __future__ import annotations

from typing import Any

import typer

from stlbench.cli import app


def parsed(words: list[str]) -> dict[str, object]:
    """The parameters of the command that these words would run."""
    command: Any = typer.main.get_command(app)
    path = list[str]()
    while hasattr(command, "commands") and not words[0].startswith("-"):
        assert words[0] in command.commands, f"no command '{words[0]}'"
        command, path, words = command.commands[words[0]], [*path, words[0]], words[1:]
    with command.make_context(" ".join(path), list(words)) as context:  # which leaves stdout as it was
        return dict(context.params)
