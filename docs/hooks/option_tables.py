"""A hook of mkdocs: what each command does and takes, from the help of the command itself.

`<!-- command: run -->` in a page becomes the description of `stlbench run` and a table of its arguments and options.
"""

from __future__ import annotations

import inspect
import re
from typing import Any

import typer

from stlbench.cli import app

_PLACE = re.compile(r"^<!-- command: ([\w -]+) -->$", re.MULTILINE)
_EXAMPLES = re.compile(r"^\W*Examples?:$", re.MULTILINE)
_TYPE = re.compile(r" <(path|str|list\[str\])>$")
_RECORD = re.compile(r"(?P<meaning>.*?)(?:\s*\[(?P<notes>[^]]*)\])?", re.DOTALL)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by mkdocs for each page."""
    return _PLACE.sub(lambda place: section(place[1]), markdown)


def section(name: str) -> str:
    """Description and options of a command such as "show cell", in Markdown. Raises `KeyError` if there is none."""
    command: Any = typer.main.get_command(app)
    for word in name.split():
        command = command.commands[word]
    context = typer.Context(command, info_name=name)
    records = [record for parameter in command.get_params(context) if (record := parameter.get_help_record(context))]
    rows = [_row(*record) for record in records if not record[0].startswith("--help")]
    description = _EXAMPLES.split(inspect.cleandoc(command.help))[0].strip()
    return "\n".join([description, "", "| | default | meaning |", "|---|---|---|", *rows])


def _row(words: str, text: str) -> str:
    """A row of the table, from a record of the help: ("--jobs N", "Cells at a time.  [default: 2; x>=1]")."""
    parts = _RECORD.fullmatch(" ".join(text.split()))
    assert parts is not None  # the pattern fits any text
    notes = (parts["notes"] or "").split("; ")
    default = next((note.removeprefix("default: ").strip("()") for note in notes if note.startswith("default: ")), "")
    default = "required" if "required" in notes else default
    limits = [f"`{note}`" for note in notes if re.search("[<>]=?", note)]
    meaning = " ".join([parts["meaning"].replace("|", "\\|"), *limits])
    return f"| `{_TYPE.sub('', words)}` | {default} | {meaning} |"
