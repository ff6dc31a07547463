"""Is anything slower than before? Micro-benchmarks of base and head in turns, and a t-test; see docs/howto/share.md.

    python tests/benchmarks/versus.py --base ../base/.venv/bin/python --package stlbench -- tests/benchmarks -k update

Base and head are two interpreters, each with its own version of the package installed. Both run the same files of
pytest-benchmark, those of the head, in a fresh process a turn: base, head, head, base, base, ... This file needs
stlbench and nothing else of this folder: to use it for another package, copy it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import special

from stlbench.errors import UsageError
from stlbench.gate.judge import ALPHA, EXIT, FREEDOM, LEVEL, Verdict
from stlbench.report import Column, Table, to_markdown
from stlbench.report.statistics.differences import holm

Side = Literal["base", "head"]

TOLERATED = 1.25
"""The largest average ratio of CPU times, head over base, that is not worse."""
TURNS = 6
"""Of each side. With fifty benchmarks and 6 turns twice the time is found if turns scatter by less than 20 %."""


class Turn(NamedTuple):
    """What one process measured."""

    seconds: Mapping[str, float]
    """Benchmark -> its fastest round: what disturbs a round only makes it slower."""
    failed: tuple[str, ...] = ()
    """Pytest's lines about what failed."""
    origin: str | None = None
    """File that the package was imported from."""


@dataclass(frozen=True)
class Comparison:
    """One benchmark. Seconds are medians over the turns, ratios are of head over base."""

    benchmark: str
    base: float
    head: float
    ratio: float
    """Geometric mean over the turns."""
    high: float
    """One-sided 95 % limit of the ratio, from above."""
    turns: int
    chance: float
    """Holm-corrected p-value of the t-test that the head is no slower."""
    verdict: Verdict


@dataclass(frozen=True)
class Judgement:
    """All that was compared, and all that was not."""

    comparisons: tuple[Comparison, ...]
    head_alone: tuple[str, ...]
    """What the base cannot run. It is named, and changes no verdict."""
    missing: tuple[str, ...]
    """Pytest's lines about what failed with the head, and what the base measured and the head did not."""

    @property
    def verdict(self) -> Verdict:
        """The first of: worse, missing, cannot tell. If the base could run nothing, nobody can tell."""
        found = {entry.verdict for entry in self.comparisons}
        if "worse" in found:
            return "worse"
        if self.missing or not (self.comparisons or self.head_alone):
            return "missing"
        return "cannot tell" if "cannot tell" in found or not self.comparisons else "no worse"


# ---------------------------------------------------------------------------------------------------------- measure

PROGRAM = """
import sys
try:
    import pytest, pytest_benchmark
except ImportError as error:
    sys.exit(str(error))
code = pytest.main(sys.argv[2:])
package = sys.modules.get(sys.argv[1])
print()
print(package and (package.__file__ or list(package.__path__)[0]))
sys.exit(code)
"""
"""Runs pytest and prints in the last line where the package came from."""


def order(turns: int) -> Iterator[Side]:
    """Base, head, head, base, base, head, ...: neither is always first, and a steady drift cancels out."""
    for turn in range(turns):
        yield from ("base", "head") if turn % 2 == 0 else ("head", "base")


def measure(
    interpreters: Mapping[Side, str], package: str, arguments: Sequence[str], turns: int
) -> dict[Side, list[Turn]]:
    """Run pytest with these arguments, in turns.

    Raises:
        UsageError: pytest cannot run so, the benchmarks do not import the package, or both import the same file.
    """
    found: dict[Side, list[Turn]] = {"base": [], "head": []}
    for number, side in enumerate(order(turns), start=1):
        turn = run(interpreters[side], package, arguments)
        print(f"[{number}/{2 * turns}] {side}: {len(turn.seconds)} benchmarks", file=sys.stderr, flush=True)
        found[side].append(turn)
        if number == 2:
            _check_origins(interpreters, package, found)
    return found


def _check_origins(interpreters: Mapping[Side, str], package: str, found: Mapping[Side, Sequence[Turn]]) -> None:
    """Measuring one version twice would find nothing ever."""
    base, head = (found[side][0].origin for side in ("base", "head"))
    if head is None:
        raise UsageError(f"the benchmarks do not import {package}; --package names what is compared")
    if base == head and interpreters["base"] != interpreters["head"]:
        raise UsageError(f"base and head both import {package} from {head}; each needs it installed on its own")


def run(interpreter: str, package: str, arguments: Sequence[str]) -> Turn:
    """One process. It does not see the current folder (-P) nor PYTHONPATH, lest both sides import the head.

    Nor does it take itself for a worker of pytest-xdist, where pytest-benchmark would be silent.
    """
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHONPATH", "PYTEST_XDIST"))
    }
    environment |= {"OMP_NUM_THREADS": "1", "COLUMNS": "160"}  # columns: of the lines about what failed
    with TemporaryDirectory() as folder:
        file = Path(folder, "benchmarks.json")
        further = ["--benchmark-only", f"--benchmark-json={file}", "--continue-on-collection-errors", "-q"]
        command = [interpreter, "-P", "-c", PROGRAM, package, *arguments, *further]
        ended = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        lines = ended.stdout.splitlines()
        if ended.returncode not in (0, 1, 5) or not lines:  # 1: some failed; 5: nothing was selected
            said = [line for line in ended.stderr.splitlines() if line.strip()] or [f"exit code {ended.returncode}"]
            raise UsageError(f"{interpreter} cannot run the benchmarks: {said[-1]}")
        failed = tuple(line for line in lines if line.startswith(("FAILED ", "ERROR ")))
        return Turn(read(file), failed, None if lines[-1] == "None" else lines[-1])


def read(file: Path) -> dict[str, float]:
    """Benchmark -> seconds of its fastest round, from what --benchmark-json wrote; nothing where it wrote nothing."""
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    entries = json.loads(text)["benchmarks"] if text else []
    return {entry["fullname"]: entry["stats"]["min"] for entry in entries if entry["stats"]["min"] > 0}


# ------------------------------------------------------------------------------------------------------------ judge


def judge(base: Sequence[Turn], head: Sequence[Turn], tolerated: float = TOLERATED) -> Judgement:
    """Compare each benchmark over the turns in which both sides measured it. It is

    - worse: if the mean ratio is above `tolerated`, and a one-sided paired t-test of the logarithms says that the head
      is slower, with p < 0.01 after Holm's correction;
    - no worse: if the mean ratio is at most `tolerated`, and its one-sided 95 % limit at most the square of that;
    - cannot tell: otherwise, and always with fewer than three turns.
    """
    pairs = list(zip(base, head, strict=True))
    names = sorted({name for one, two in pairs for name in one.seconds.keys() & two.seconds.keys()})
    tests = [_test(name, pairs) for name in names]
    chances = holm([test.chance for test in tests])
    decided = [_decide(test, chance, tolerated) for test, chance in zip(tests, chances, strict=True)]
    one, two = ({name for turn in turns for name in turn.seconds}.difference(names) for turns in (base, head))
    failed = sorted({line for turn in head for line in turn.failed})
    missing = [*failed, *(name for name in sorted(one) if not any(name in line for line in failed))]
    return Judgement(tuple(sorted(decided, key=lambda entry: -entry.ratio)), tuple(sorted(two)), tuple(missing))


def _test(name: str, pairs: Sequence[tuple[Turn, Turn]]) -> Comparison:
    """A benchmark with its own p-value, before it is corrected and decided."""
    both = [(one.seconds[name], two.seconds[name]) for one, two in pairs if name in one.seconds and name in two.seconds]
    base, head = np.array(both).T
    losses = np.log(head / base)
    loss, freedom = float(losses.mean()), len(losses) - 1
    high, chance = math.inf, 1.0
    if freedom >= FREEDOM:
        error = float(losses.std(ddof=1)) / math.sqrt(len(losses))
        high = math.exp(loss + error * float(special.stdtrit(freedom, LEVEL)))
        chance = float(special.stdtr(freedom, -loss / error)) if error > 0 else float(loss <= 0)
    middle = float(np.median(base)), float(np.median(head))
    return Comparison(name, *middle, math.exp(loss), high, len(losses), chance, "cannot tell")


def _decide(test: Comparison, chance: float, tolerated: float) -> Comparison:
    verdict: Verdict = "cannot tell"
    if test.ratio > tolerated and chance < ALPHA:
        verdict = "worse"
    elif test.ratio <= tolerated and test.high <= tolerated**2:
        verdict = "no worse"
    return replace(test, chance=chance, verdict=verdict)


# -------------------------------------------------------------------------------------------------------------- say


def facts(judgement: Judgement) -> dict[str, Any]:
    """All that was found, as values that JSON has."""
    rows = [
        {**asdict(entry), "high": entry.high if math.isfinite(entry.high) else None} for entry in judgement.comparisons
    ]
    return {
        "verdict": judgement.verdict,
        "exit_code": EXIT[judgement.verdict],
        "comparisons": rows,
        "head_alone": judgement.head_alone,
        "missing": judgement.missing,
    }


def markdown(judgement: Judgement, tolerated: float = TOLERATED) -> str:
    """A summary for a terminal, a file, or the page of a CI job: the slowest first."""
    titles = ("verdict", "benchmark", "base [ms]", "head [ms]", "head / base", "95 % limit", "turns", "p")
    columns = tuple(Column(title, right=place > 1) for place, title in enumerate(titles))
    rows = tuple(
        (
            *(entry.verdict, entry.benchmark, f"{entry.base * 1e3:.3g}", f"{entry.head * 1e3:.3g}"),
            *(f"x{entry.ratio:.2f}", f"x{entry.high:.2f}", str(entry.turns), f"{entry.chance:.2g}"),
        )
        for entry in judgement.comparisons
    )
    notes = (
        f"Worse: slower by more than x{tolerated:g} on average, and p < {ALPHA} after Holm's correction.",
        "Times are of the fastest round of a process, their medians over the turns; ratios are taken turn by turn.",
    )
    lines = [f"# Speed, head against base: {judgement.verdict}", ""]
    lines += [f"- missing: {text}" for text in judgement.missing]
    lines += [f"- the base cannot run it: {name}" for name in judgement.head_alone]
    table = [to_markdown(Table("Benchmarks", columns, rows, notes))] if rows else []
    return "\n".join([*lines, *([""] if len(lines) > 2 else []), *table])


def main(words: Sequence[str] | None = None) -> int:
    """Measure, judge, print the summary, write it into a folder, and give back the exit code."""
    parser = argparse.ArgumentParser(description="Is anything slower than before? Exit codes as of `stlbench gate`.")
    parser.add_argument("--base", required=True, metavar="PYTHON", help="interpreter with the version before")
    parser.add_argument("--head", default=sys.executable, metavar="PYTHON", help="the one after (default: this one)")
    parser.add_argument("--package", required=True, metavar="NAME", help="what has two versions, as it is imported")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="of each side (default: %(default)s)")
    parser.add_argument("--tolerated", type=float, default=TOLERATED, metavar="X", help="ratio (default: %(default)s)")
    parser.add_argument("--results", type=Path, default=Path("results/versus"), metavar="DIR", help="for the summary")
    parser.add_argument("pytest", nargs="+", metavar="ARGUMENT", help="of pytest, after --: files, -k, -m")
    options = parser.parse_args(words)
    try:
        return _compare(options)
    except (UsageError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _compare(options: argparse.Namespace) -> int:
    if options.turns <= FREEDOM or not options.tolerated > 1:
        raise UsageError(f"--turns is at least {FREEDOM + 1}, and --tolerated more than 1")
    found = measure({"base": options.base, "head": options.head}, options.package, options.pytest, options.turns)
    judgement = judge(found["base"], found["head"], options.tolerated)
    text = markdown(judgement, options.tolerated)
    options.results.mkdir(parents=True, exist_ok=True)
    (options.results / "versus.json").write_text(json.dumps(facts(judgement), indent=2) + "\n", encoding="utf-8")
    (options.results / "versus.md").write_text(text, encoding="utf-8")
    print(text, end="")
    return EXIT[judgement.verdict]


if __name__ == "__main__":
    sys.exit(main())
