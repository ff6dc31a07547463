"""A hook of mkdocs: what a task file says for people.

`<!-- task: overlap -->` in a page becomes the title, the formula, the source and the notes of that task.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import yaml

_PLACE = re.compile(r"^<!-- task: ([\w-]+) -->$", re.MULTILINE)
_TASKS = Path(__file__).parents[2] / "tasks/stlbench_tasks"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by mkdocs for each page."""
    return _PLACE.sub(lambda place: section(place[1]), markdown)


def section(name: str) -> str:
    """What the file of a task says, in Markdown. Raises `FileNotFoundError` if there is no such task."""
    text = (_TASKS / name.replace("-", "_") / "task.yaml").read_text(encoding="utf-8")
    file = {key: " ".join(str(value).split()) for key, value in yaml.safe_load(text).items()}
    source, notes = (html.escape(file[key], quote=False).rstrip(".") for key in ("source", "notes"))
    held = f", each action held for {file['hold']}" if "hold" in file else ""
    unit = "intervals in seconds, " if file.get("time") == "seconds" else ""
    steps = f"{unit}in steps of {file['sampling_time']} s{held}"
    return f"**`{name}`**: {file['title']}, `{file['formula']}`, {steps}. Source: {source}.\n\n{notes}."
