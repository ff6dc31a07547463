"""What `stlbench gate` and `stlbench compare` leave in a folder: for programs, for people, for CI servers."""

from __future__ import annotations

import json
from pathlib import Path

from stlbench.gate.comment import comment
from stlbench.gate.judge import Judgement
from stlbench.gate.junit import junit
from stlbench.gate.summary import Named, facts, markdown
from stlbench.records import outputs


def write(folder: Path, title: str, judgement: Judgement, base: Named, new: Named) -> None:
    """Write gate.json, gate.md, gate.xml for CI servers, and comment.md for a pull request.

    Raises `UsageError` where the folder cannot be written.
    """
    contents = {
        "gate.json": json.dumps(facts(judgement, base, new), indent=2, ensure_ascii=False) + "\n",
        "gate.md": markdown(title, judgement, base, new),
        "gate.xml": junit(title, judgement),
        "comment.md": comment(title, judgement, base, new),
    }
    for name, content in contents.items():
        outputs.write(folder / name, content)
