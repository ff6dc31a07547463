"""Write what comes from committed results and task files into README.md, docs/ and paper/, each between markers.

python studies/pages.py            write them, from results/reference and results/tuning
python studies/pages.py --check    write nothing; exit code 1 where a page says something else
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import joss
import learners
import page_reference
import page_schedules
import page_suite
import page_tasks
import paired
import race
import solve_foreign
import solve_nested
import suite_answers
import survey
from recorded import markdown

ROOT = Path(__file__).parents[1]

PAGES: Mapping[str, Mapping[str, Callable[[], str]]] = {
    "README.md": {"study": page_reference.headline},
    "docs/reproduction.md": {
        "study": page_reference.study,
        "verdicts": page_reference.verdicts,
        "tracks": page_reference.tracks,
        "measures": page_reference.measures,
    },
    "docs/findings.md": {
        "planned": page_reference.planned,
        "planned-overlap": page_reference.overlapping,
        "survey-survived": survey.survived,
        "survey-planned": lambda: markdown(*survey.planned()),
    },
    "docs/howto/solve.md": {
        "solve-foreign": solve_foreign.page,
        "solve-nested": solve_nested.page,
        "solve-race": race.page,
    },
    "docs/explanation/auto.md": {
        "auto": page_tasks.auto,
        "auto-field": page_tasks.auto_field,
        "auto-verdicts": page_tasks.auto_verdicts,
        "auto-parts": page_tasks.auto_parts,
    },
    "docs/explanation/suite.md": {
        "suite": page_suite.drawn,
        "suite-schedules": page_schedules.table,
        "suite-quick": page_schedules.quick,
        "suite-core": lambda: page_suite.methods("suite-core"),
        "suite-fresh": paired.stated,
        "suite-fresh-earlier": lambda: paired.stated("suite-fresh-earlier"),
        "suite-sources": suite_answers.components,
        "suite-held-out": suite_answers.held_out,
        "suite-many": page_suite.many,
    },
    "docs/reference/tasks.md": {
        "field": page_tasks.field,
    },
    "docs/robots.md": {
        "robots": page_tasks.robots,
        "learners": learners.page,
    },
    "paper/paper.md": {
        "scope": joss.scope,
        "limits": joss.limits,
        "headline": joss.headline,
        "table": joss.table,
    },
}


def written(text: str, blocks: Mapping[str, Callable[[], str]]) -> str:
    """The page with its tables as the results have them. `ValueError` where a marker is not there."""
    for name, block in blocks.items():
        begin, end = f"<!-- --8<-- [start:{name}] -->\n", f"<!-- --8<-- [end:{name}] -->"
        head, tail = text.index(begin) + len(begin), text.index(end)
        text = f"{text[:head]}{block()}\n{text[tail:]}"
    return text


def main(words: Sequence[str]) -> int:
    """The exit code."""
    different = 0
    for name, blocks in PAGES.items():
        page = ROOT / name
        before = page.read_text(encoding="utf-8")
        after = written(before, blocks)
        if after != before:
            different += 1
            print(f"{name}: {'differs from the results' if '--check' in words else 'written'}")
            if "--check" not in words:
                page.write_text(after, encoding="utf-8")
    return int(bool(different) and "--check" in words)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
