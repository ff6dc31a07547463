"""A hook of mkdocs: what the files of a task say for people.

`<!-- task: overlap -->` in a page becomes the title, the formula, the source and the notes of that task, and
the comments on what was made for it by hand, if anything was.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import yaml

_PLACE = re.compile(r"^<!-- task: ([\w-]+) -->$", re.MULTILINE)
_COMMENT = re.compile(r"((?:^#.*\n)+)(\w+):", re.MULTILINE)
_TASKS = Path(__file__).parents[2] / "tasks/stlbench_tasks"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by mkdocs for each page."""
    return _PLACE.sub(lambda place: section(place[1]), markdown)


def section(name: str) -> str:
    """What the files of a task say, in Markdown. Raises `FileNotFoundError` if there is no such task."""
    place = _TASKS / name.replace("-", "_")
    text = (place / "task.yaml").read_text(encoding="utf-8")
    helped = place / "by_hand.yaml"
    by_hand = helped.read_text(encoding="utf-8") if helped.exists() else ""
    file = {key: " ".join(str(value).split()) for key, value in yaml.safe_load(text).items()}
    source, notes = (html.escape(file[key], quote=False).rstrip(".") for key in ("source", "notes"))
    held = f", each action held for {file['hold']}" if "hold" in file else ""
    unit = "intervals in seconds, " if file.get("time") == "seconds" else ""
    steps = f"{unit}in steps of {file['sampling_time']} s{held}"
    comments = {key: " ".join(lines.replace("#", "").split()) for lines, key in _COMMENT.findall(by_hand)}
    made = "".join(f"\n- `{key}`: {html.escape(comment, quote=False)}" for key, comment in comments.items())
    return f"**`{name}`**: {file['title']}, `{file['formula']}`, {steps}. Source: {source}.\n\n{notes}." + (
        f"\n\nBy hand:\n{made}" if made else ""
    )
