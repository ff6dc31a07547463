"""The verdict as a comment on a pull request: what is wrong in sight, everything else folded away."""

from __future__ import annotations

from stlbench.gate.judge import Judgement
from stlbench.gate.summary import Named, head, settings, trouble
from stlbench.report import to_markdown

LIMIT = 60_000
"""Characters at most; GitHub refuses comments of more than 65,536."""
LEFT_OUT = "\nThe rest is left out here; gate.md has all of it.\n"


def comment(title: str, judgement: Judgement, base: Named, new: Named) -> str:
    """Markdown that begins with a mark, not shown, by which the next run against this base finds and replaces it."""
    wrong, every = trouble(judgement), settings(judgement)
    mark = f"{title} {base[0]}".replace("-->", "")
    shown = [f"<!-- {mark} -->", head(title, judgement, base, new)]
    shown += [to_markdown(wrong)] if wrong.rows else []
    folded = f"<details><summary>{every.title}</summary>\n\n{to_markdown(every)}\n</details>\n" if every.rows else ""
    text = "\n".join(shown)
    if len(text) + len(folded) <= LIMIT:
        return text + folded
    if len(text) <= LIMIT:
        return text + LEFT_OUT
    return text[:LIMIT].rpartition("\n")[0] + "\n" + LEFT_OUT
