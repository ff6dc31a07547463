"""Thousands of cells, some of which misbehave in every way that is known, in a run that is killed again and again.

    python tests/long/soak.py --cells 10000 --kills 50 --folder build/soak

Say it again, and it goes on where it was. It prints what was found and exits with code 1 where a promise was broken:
every cell once in the ledger, each fault with its right status, nothing announced and then lost, innocent cells all
alike, the run's memory and descriptors flat, no process and no temporary file left.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import psutil
from long.faults import KINDS, install
from long.soaked import ANNOUNCED, RESULTS, kinds

from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import MAIN, Result

__all__ = ["Soak", "main"]

MARK = "STLBENCH_SOAK"
"""A variable that all processes of a soak have, so that those that are left can be found."""

FLAT = 40 * 2**20
"""Bytes by which the run's memory may differ between its lives."""


@dataclass
class Found:
    """What is known so far; it survives the one who soaks."""

    kills: int = 0
    lives: int = 0
    memory: list[int] = field(default_factory=list)
    """Bytes of the run's own process, about once in a second."""
    descriptors: list[int] = field(default_factory=list)
    seconds: float = 0.0
    broken: list[str] = field(default_factory=list)


class Soak:
    """One soak in one folder.

    Args:
        folder: of results, plugins and temporary files.
        count: of cells.
        share: of cells that misbehave.
        kills: how often the run is killed.
        jobs: cells at a time.
        seed: of what is random.
    """

    def __init__(self, folder: Path, count: int, share: float, kills: int, jobs: int, seed: int = 0) -> None:
        self.folder, self.count, self.share, self.kills, self.jobs, self.seed = folder, count, share, kills, jobs, seed
        self._state = folder / "soak.json"
        self.found = Found(**json.loads(self._state.read_text())) if self._state.exists() else Found()
        self._rng = np.random.default_rng([seed, self.found.lives])
        self._mark = f"{folder.absolute()}-{os.getpid()}"
        for name in ("plugins", "tmp"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        install(folder / "plugins")

    def run(self) -> Found:
        """Let it live until all is done, killing it as often as was said."""
        while True:
            begin = time.monotonic()
            ended = self._life(kill=self.found.kills < self.kills)
            self.found.seconds += time.monotonic() - begin
            self.found.lives += 1
            self._look()
            self._state.write_text(json.dumps(asdict(self.found)))
            print(f"life {self.found.lives}: {len(self._announced())} cells announced", file=sys.stderr, flush=True)
            if ended:
                self._judge()
                return self.found

    # ------------------------------------------------------------------------------------------------------ one life

    def _life(self, kill: bool) -> bool:
        """Whether the run came to its end, rather than being killed."""
        numbers = map(str, (self.count, self.share, self.seed, self.jobs))
        command = [sys.executable, Path(__file__).with_name("soaked.py"), self.folder, *numbers]
        run = psutil.Popen(command, env=self._environment(), start_new_session=True)
        until = self._moment() if kill else None
        while run.poll() is None:
            self._sample(run)
            if until is not None and next(until):
                run.kill()
                self.found.kills += 1
                break
            time.sleep(0.05)
        if run.wait() not in (0, -signal.SIGKILL):
            self._broken(f"the run ended with exit code {run.wait()}")
            raise SystemExit("\n".join(self.found.broken))
        return bool(run.wait() == 0)

    def _environment(self) -> dict[str, str]:
        path = [self.folder / "plugins", Path(__file__).parents[1], os.environ.get("PYTHONPATH", "")]
        own = {"PYTHONPATH": os.pathsep.join(map(str, path)), "TMPDIR": str((self.folder / "tmp").absolute())}
        return {**os.environ, **own, MARK: self._mark}

    def _moment(self) -> Iterator[bool]:
        """When to kill: after some cells, so that the kills are spread over all; one time in five at the beginning."""
        announced = len(self._announced())
        if self._rng.random() < 0.2:
            end = time.monotonic() + self._rng.uniform(0, 8)
            while True:
                yield time.monotonic() > end
        left = (self.count - announced) / (self.kills - self.found.kills + 1)
        some = announced + self._rng.integers(1, max(2, round(2 * left)))
        while len(self._announced()) < some:
            yield False
        end = time.monotonic() + self._rng.uniform(0, 0.2)
        while True:
            yield time.monotonic() > end

    def _announced(self) -> list[int]:
        with suppress(FileNotFoundError):
            return [int(line) for line in (self.folder / ANNOUNCED).read_text().splitlines()]
        return []

    def _sample(self, run: psutil.Popen) -> None:
        now = time.monotonic()
        if now - getattr(self, "_sampled", 0.0) > 1 and (self.folder / RESULTS / LEDGER).exists():
            self._sampled = now
            with suppress(psutil.Error):
                memory, descriptors = run.memory_info().rss, run.num_fds()
                if not memory:  # it ends
                    return
                self.found.memory.append(memory)
                self.found.descriptors.append(descriptors)

    # -------------------------------------------------------------------------------------------------------- looking

    def _look(self) -> None:
        """After a life: nothing runs, nothing lies about, and what was announced is recorded."""
        end = time.monotonic() + 60
        while (left := self._processes()) and time.monotonic() < end:
            time.sleep(0.1)
        for process in left:
            self._broken(f"a process is left: {process} {process.status()}")
            process.kill()
        if names := [path.name for path in (self.folder / "tmp").iterdir()]:
            self._broken(f"temporary files are left: {names[:5]}")
        if lost := set(self._announced()) - {result.id.seed for result in self._results()}:
            self._broken(f"cells were announced and are lost: {sorted(lost)[:10]}")

    def _processes(self) -> list[psutil.Process]:
        found = list[psutil.Process]()
        for process in psutil.process_iter():
            with suppress(psutil.Error, OSError):
                if f"{MARK}={self._mark}".encode() in Path(f"/proc/{process.pid}/environ").read_bytes():
                    found.append(process)
        return found

    def _results(self) -> list[Result]:
        if not (self.folder / RESULTS / LEDGER).exists():
            return []
        with Ledger(self.folder / RESULTS / LEDGER) as ledger:
            return list(ledger.results())

    def _broken(self, what: str) -> None:
        self.found.broken.append(f"life {self.found.lives}: {what}")

    # -------------------------------------------------------------------------------------------------------- judging

    def _judge(self) -> None:
        done, results = kinds(self.count, self.share, self.seed), self._results()
        if Counter(result.id.seed for result in results) != Counter(range(self.count)):
            self._broken(f"{len(results)} results of {self.count} cells")
        for result in results:
            self._judge_one(result, done[result.id.seed])
        innocent = [each.measurement for each in results if each.id.method.name == "soak-innocent"]
        scores = {measured.selected[MAIN].mean for measured in innocent if measured}
        if len(scores) > 1:
            self._broken(f"innocent cells have {len(scores)} different scores")
        if parts := [path.name for path in (self.folder / RESULTS).rglob("*.part")]:
            self._broken(f"half written files are left: {parts[:5]}")
        for name, values, most in (("memory", self.found.memory, FLAT), ("descriptors", self.found.descriptors, 20)):
            late = values[len(values) // 2 :]
            if late and max(late) - np.median(values) > most:
                self._broken(f"{name} of the run: {np.median(values):.0f} at most times, {max(late)} late")

    def _judge_one(self, result: Result, kind: str | None) -> None:
        status, reason = ("done", "") if kind is None else (KINDS[kind].status, KINDS[kind].reason)
        if result.status != status or reason not in result.reason:
            self._broken(f"{result.id.name} should be {status} {reason}, it is {result.status} {result.reason}")


def told(soak: Soak) -> str:
    """What was found, for a person."""
    found, done = soak.found, kinds(soak.count, soak.share, soak.seed)
    faults, statuses = Counter(kind for kind in done if kind), Counter(each.status for each in soak._results())
    return "\n".join(
        [
            f"{soak.count} cells, {sum(faults.values())} of them faults of {len(faults)} kinds, {soak.jobs} at a time",
            f"{found.kills} kills, {found.seconds:.0f} s, {found.seconds / soak.count:.3f} s for each cell",
            f"memory of the run: {_span([size / 2**20 for size in found.memory])} MiB",
            f"descriptors of the run: {_span(found.descriptors)}",
            f"statuses: {', '.join(f'{n} {status}' for status, n in statuses.items())}",
            *(found.broken or ["every promise was kept"]),
        ]
    )


def _span(values: Sequence[float]) -> str:
    if not values:
        return "not seen"
    return f"{np.min(values):.0f} to {np.max(values):.0f}, mostly {np.median(values):.0f}"


def main() -> int:
    """See the top of this file."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--cells", type=int, default=10_000)
    options.add_argument("--share", type=float, default=0.05, help="of cells that misbehave")
    options.add_argument("--kills", type=int, default=50)
    options.add_argument("--jobs", type=int, default=2)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--folder", type=Path, default=Path("build/soak"))
    said = options.parse_args()
    soak = Soak(said.folder, said.cells, said.share, said.kills, said.jobs, said.seed)
    soak.run()
    print(told(soak))
    return bool(soak.found.broken)


if __name__ == "__main__":
    sys.exit(main())
