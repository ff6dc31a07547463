"""A leaderboard in a folder: its bundles scored from the same fresh starts, and the tables of that."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from pathlib import Path

from stlbench import __version__
from stlbench.errors import UsageError
from stlbench.leaderboard import entry
from stlbench.leaderboard.entry import Entry, Refused, Scores
from stlbench.leaderboard.scoring import Told, score
from stlbench.leaderboard.tables import bundles, in_markup, results
from stlbench.records.outputs import write
from stlbench.report import to_csv, to_markdown

PAGE, TABLE = "table.md", "table.csv"
"""Names of the tables in the folder."""
DRAWS = 2**31
"""Seeds of fresh starts are below it."""


def build(paths: Sequence[Path], folder: Path, draw: int | None = None, told: Told = lambda name, said: None) -> Scores:
    """Score bundles, and write scores.json, table.md and table.csv over those of before.

    Args:
        paths: of all the bundles of the leaderboard, or of folders with them.
        folder: where the files go.
        draw: seed of the fresh starts; where None one that nobody could know.
        told: is called with each cell that was scored and what was found.

    Raises:
        UsageError: a bundle is not there, two have the same name, or the folder cannot be written.
    """
    drawn = secrets.randbelow(DRAWS) if draw is None else draw
    found = [score(path, drawn, told) for path in _files(paths)]
    scores = Scores(
        draw=drawn,
        scored_by=__version__,
        entries=tuple(each for each in found if isinstance(each, Entry)),
        refused=tuple(each for each in found if isinstance(each, Refused)),
    )
    entry.write(folder, scores)
    write(folder / PAGE, page(scores))
    write(folder / TABLE, to_csv(results(scores)))
    return scores


def _files(paths: Sequence[Path]) -> list[Path]:
    """The bundles, by name; of a folder its files whose names end in .zip."""
    found = list[Path]()
    for path in paths:
        if not path.exists():
            raise UsageError(f"{path}: there is no such file; `stlbench bundle` writes bundles")
        found += [each for each in path.iterdir() if each.suffix == ".zip"] if path.is_dir() else [path]
    if len({path.name for path in found}) < len(found):
        raise UsageError("two of the bundles have the same name, by which the leaderboard knows them")
    return sorted(found, key=lambda path: path.name)


def page(scores: Scores) -> str:
    """Its tables as Markdown."""
    return "\n".join(to_markdown(in_markup(table)) for table in (results(scores), bundles(scores)))
