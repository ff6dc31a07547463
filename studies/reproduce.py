"""Train again what a table or a figure of the pages, of README.md or of paper/ is made of.

    python studies/reproduce.py            list what there is, with CPU time
    python studies/reproduce.py NAME       run the study NAME, or the one that makes the table or figure NAME

Each study is a script of Bash in studies/reproduce/. Its first lines say what it is, its CPU time, and what it makes:
figures, and the blocks that `studies/pages.py` writes into pages, by their names. `1` is the table of paper/paper.md. A
study goes on where it was interrupted.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]


class Study(NamedTuple):
    script: Path
    what: str
    time: str
    makes: tuple[str, ...]


def read(script: Path) -> Study:
    """The study that the first three lines of a script describe."""
    what, time, makes = script.read_text(encoding="utf-8").splitlines()[:3]
    return Study(
        script,
        what.removeprefix("# "),
        time.removeprefix("# CPU time: "),
        tuple(makes.removeprefix("# Makes: ").split()),
    )


STUDIES = {path.stem: read(path) for path in sorted((ROOT / "studies" / "reproduce").glob("*.sh"))}


def find(name: str) -> Study | None:
    """The study of that name, or the one that makes what is called so."""
    if name in STUDIES:
        return STUDIES[name]
    return next((study for study in STUDIES.values() if name in study.makes), None)


def listing() -> str:
    """One paragraph per study."""
    parts = [
        f"{name}: {study.what}\n  CPU time: {study.time}; makes: {', '.join(study.makes)}"
        for name, study in STUDIES.items()
    ]
    return "\n".join([*parts, "make reproduce TABLE=NAME, with the name of a study or of what it makes"])


def main(words: list[str]) -> int:
    """The exit code."""
    if not words:
        print(listing())
        return 0
    study = find(words[0])
    if study is None:
        known = ", ".join([*STUDIES, *(name for study in STUDIES.values() for name in study.makes)])
        print(f"error: no study, table or figure '{words[0]}'; there are {known}", file=sys.stderr)
        return 2
    venv = os.environ.get("VENV", ".venv")
    environment = os.environ | {"PATH": f"{ROOT / venv / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    for command in (
        ["make", f"{venv}/ready-all"],
        ["bash", "-euxo", "pipefail", str(study.script)],
        ["python", "studies/pages.py"],
    ):
        done = subprocess.run(command, cwd=ROOT, env=environment, check=False)  # noqa: S603
        if done.returncode:
            return done.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
