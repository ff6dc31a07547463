"""The race of `stlbench solve` against peers, as results/solve/race.csv has it: for the page and for the benchmark."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

CELLS = Path(__file__).parents[1] / "results" / "solve" / "race.csv"
Cell = Mapping[str, Any]  # a line, whose numbers `cells` has read
_PEERS = ("PPO", "SAC", "TD3", "DQN")


class Race(NamedTuple):
    """The time that one task took."""

    seconds: float  # CPU time until the first policy of `solve` that satisfies, or until it gave up
    whole: float  # until `solve` has certified and written everything
    learned: bool
    peers: Mapping[str, Cell]

    @property
    def times(self) -> tuple[str, float] | None:
        """How many times the seconds of `solve` the fastest peer took; None if nobody learned, or without a peer.

        The text is empty, or ">" or "<" if the peers, or `solve`, gave up before they had learned.
        """
        reached = [cell["cpu"] for cell in self.peers.values() if cell["reached"]]
        if not self.peers or not (self.learned or reached):
            return None
        fastest = min(reached or [cell["cpu"] for cell in self.peers.values()])
        return "<" if not self.learned else "" if reached else ">", fastest / self.seconds


def race_of(cells: Mapping[str, Cell]) -> Race | None:
    """The race from contestant -> line; None without a line of `solve`. A later line goes on from the one before."""
    tries = [cell for contestant, cell in cells.items() if contestant.startswith("solve")]
    if not tries:
        return None
    before = sum(cell["whole"] for cell in tries[:-1])
    peers = {contestant: cell for contestant, cell in cells.items() if not contestant.startswith("solve")}
    return Race(before + tries[-1]["cpu"], before + tries[-1]["whole"], tries[-1]["reached"], peers)


def cells(path: Path = CELLS) -> dict[str, dict[str, Cell]]:
    """Task -> contestant -> its line; empty without the file. A peer has no `whole`."""
    found = dict[str, dict[str, Cell]]()
    if path.is_file():
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                read = {
                    "cpu": float(row["cpu"]),
                    "whole": float(row["whole"] or 0),
                    "reached": row["reached"] == "True",
                }
                found.setdefault(row["task"], {})[row["contestant"]] = row | read
    return found


def page() -> str:
    """CPU seconds of `solve` and of each peer, one row per task; more than so many where 95 % were not reached."""
    if not (tasks := cells()):
        return "Not measured yet: `make bench PARTS=tests/benchmarks/test_solve.py`."
    head = f"| task | `solve` | and its certificate | {' | '.join(_PEERS)} | fastest peer / `solve` |"
    lines = [head, "|---|--:|--:|--:|--:|--:|--:|--:|"]
    for task, contestants in tasks.items():
        if (race := race_of(contestants)) is not None:
            ours = [f"{race.seconds:.0f}", f"{race.whole:.0f}"] if race.learned else [f"> {race.seconds:.0f}", ""]
            peers = [_seconds(race.peers[name]) if name in race.peers else "" for name in _PEERS]
            lines.append(f"| {' | '.join([task, *ours, *peers, times_text(race)])} |")
    return "\n".join(lines)


def times_text(race: Race) -> str:
    """ "2.3", "> 4.1", or an empty text."""
    sign, times = race.times or ("", None)
    return "" if times is None else f"{sign} {times:.2g}".lstrip()


def _seconds(cell: Cell) -> str:
    return f"{cell['cpu']:.0f}" if cell["reached"] else f"> {cell['cpu']:.0f} ({100 * float(cell['best']):.0f} %)"
