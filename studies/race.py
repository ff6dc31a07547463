"""The race of `stlbench solve` against peers, as results/solve/race.csv has it: for the page and for the benchmark."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

CELLS = Path(__file__).parents[1] / "results" / "solve" / "race.csv"
Cell = Mapping[str, Any]  # a line, whose numbers `cells` has read
_PEERS = ("PPO", "SAC", "TD3", "DQN")


class Race(NamedTuple):
    """The time that one task took with one seed."""

    seconds: float  # CPU time until the first policy of `solve` that satisfies, or until it gave up
    whole: float  # until `solve` has certified and written everything
    learned: bool
    peers: Mapping[str, Cell]

    @property
    def times(self) -> Bound | None:
        """How many times the seconds of `solve` the fastest peer took; None if nobody learned, or without a peer."""
        reached = [cell["cpu"] for cell in self.peers.values() if cell["reached"]]
        if not self.peers or not (self.learned or reached):
            return None
        fastest = min(reached or [cell["cpu"] for cell in self.peers.values()])
        return Bound(fastest / self.seconds, "<" if not self.learned else "" if reached else ">")


class Bound(NamedTuple):
    """A number, or one that is greater or less."""

    value: float
    sign: str = ""
    """Empty, or ">" or "<" where somebody gave up before."""

    def text(self, form: str) -> str:
        return f"{self.sign} {self.value:{form}}".lstrip()


def race_of(cells: Mapping[str, Cell]) -> Race | None:
    """The race from contestant -> line; None without a line of `solve`. A later line goes on from the one before."""
    tries = [cell for contestant, cell in cells.items() if contestant.startswith("solve")]
    if not tries:
        return None
    before = sum(cell["whole"] for cell in tries[:-1])
    peers = {contestant: cell for contestant, cell in cells.items() if not contestant.startswith("solve")}
    return Race(before + tries[-1]["cpu"], before + tries[-1]["whole"], tries[-1]["reached"], peers)


def cells(path: Path = CELLS) -> dict[str, dict[int, dict[str, Cell]]]:
    """Task -> seed -> contestant -> its line; empty without the file. A peer has no `whole`."""
    found = dict[str, dict[int, dict[str, Cell]]]()
    if path.is_file():
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                read = {
                    "cpu": float(row["cpu"]),
                    "whole": float(row["whole"] or 0),
                    "reached": row["reached"] == "True",
                }
                seeds = found.setdefault(row["task"], {})
                seeds.setdefault(int(row["seed"]), {})[row["contestant"]] = row | read
    return found


class Medians(NamedTuple):
    """A task over its seeds: texts of the medians, each the greater one of the middle."""

    seconds: str
    whole: str
    peers: Mapping[str, str]
    times: str


def medians(seeds: Mapping[int, Mapping[str, Cell]]) -> Medians:
    """The medians of a task from seed -> contestant -> line. Who gave up took longer than all who did not."""
    races = [race for each in seeds.values() if (race := race_of(each)) is not None]
    names = [name for name in _PEERS if any(name in race.peers for race in races)]
    seconds = _median(Bound(race.seconds, "" if race.learned else ">") for race in races)
    whole = _median(Bound(race.whole, "" if race.learned else ">") for race in races)
    times = [race.times for race in races if race.times is not None]
    return Medians(
        seconds=seconds.text(".0f"),
        whole="" if seconds.sign else whole.text(".0f"),
        peers={name: _of_peer([race.peers[name] for race in races if name in race.peers]) for name in names},
        times=_median(times).text(".2g") if times else "",
    )


def _of_peer(found: Sequence[Cell]) -> str:
    """Its seconds; where most seeds gave up, also the best share that the median seed had."""
    seconds = _median(Bound(cell["cpu"], "" if cell["reached"] else ">") for cell in found)
    share = sorted(float(cell["best"]) for cell in found)[len(found) // 2]
    return f"{seconds.text('.0f')} ({100 * share:.0f} %)" if seconds.sign else seconds.text(".0f")


def _median(values: Iterable[Bound]) -> Bound:
    """The middle one, the greater of two; what is greater than something is behind all others."""
    ordered = sorted(values, key=lambda each: ("< >".index(each.sign or " "), each.value))
    return ordered[len(ordered) // 2]


def page() -> str:
    """CPU seconds of `solve` and of each peer, one row per task; more than so many where 95 % were not reached."""
    if not (tasks := cells()):
        return "Not measured yet: `make bench PARTS=tests/benchmarks/test_solve.py`."
    head = f"| task | `solve` | and its certificate | {' | '.join(_PEERS)} | fastest peer / `solve` |"
    lines = [head, "|---|--:|--:|--:|--:|--:|--:|--:|"]
    for task, seeds in tasks.items():
        if any(race_of(each) for each in seeds.values()):
            found = medians(seeds)
            peers = [found.peers.get(name, "") for name in _PEERS]
            lines.append(f"| {' | '.join([task, found.seconds, found.whole, *peers, found.times])} |")
    return "\n".join(lines)
