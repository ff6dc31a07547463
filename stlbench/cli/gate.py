"""`stlbench gate`: measure again what a reference holds, and say whether it is worse."""

from __future__ import annotations

import json
import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stlbench.cli.common import LEDGER, Json, print_json
from stlbench.cli.compare import facts, markdown
from stlbench.cli.run import build_executor, parse_seeds, plan, run_missing
from stlbench.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from stlbench.contract import Executor
    from stlbench.gate.comparison import Recording, Sample
    from stlbench.study.matrix import Cell

SEEDS = "10"
"""Seeds of a new reference."""


@dataclass(frozen=True)
class Selection:
    """The options that choose cells; None where not given."""

    tasks: str | None
    methods: str | None
    agents: str | None
    seeds: str | None
    budget: str

    @property
    def is_given(self) -> bool:
        """Any of the four."""
        return any(part is not None for part in (self.tasks, self.methods, self.agents, self.seeds))


def gate(
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE", help="A folder that --update wrote.")],
    budget: Annotated[str, typer.Option(metavar="NAME", help="Budget of the cells.")] = "smoke",
    tasks: Annotated[
        str | None, typer.Option(metavar="LIST", help="Tasks, a comma list.", show_default="all in the reference")
    ] = None,
    methods: Annotated[
        str | None, typer.Option(metavar="LIST", help="Methods, a comma list.", show_default="all in the reference")
    ] = None,
    agents: Annotated[
        str | None, typer.Option(metavar="LIST", help="Agents, a comma list.", show_default="all in the reference")
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(metavar="SEEDS", help="As in `stlbench run`.", show_default="all in the reference"),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Cells at a time.", show_default="2, or 1 on a single core")
    ] = None,
    results: Annotated[Path, typer.Option(metavar="DIR", help="Folder of ledger, gate.md and gate.json.")] = Path(
        "results/gate"
    ),
    executor: Annotated[str, typer.Option(metavar="NAME", help="Where cells run.")] = "local",
    update: Annotated[bool, typer.Option("--update", help="Write the reference instead of comparing with it.")] = False,
    as_json: Json = False,
) -> None:
    """Measure the cells of a reference again, and say whether they are worse.

    Robustness and satisfaction are compared seed by seed, CPU time and the reward's cost relative to a calibration
    measured beside the cells. Exit codes: 0 no worse, 1 worse, 3 these seeds cannot tell, 4 nothing measured or cells
    missing, 2 bad input, 130 after ctrl-C. The same command again measures only what is missing in DIR.

    --update alone measures and writes anew what the reference holds. With --tasks, --methods, --agents or --seeds the
    reference will hold what these name, the rest as in `stlbench run` with ten seeds.

    \b
    Examples:
      stlbench gate results/gate-reference --budget smoke
      stlbench gate reference --update --tasks hold-disc --methods funnel,flag --seeds 10
    """
    if results.resolve() == reference.resolve():
        raise UsageError(f"--results {results} is the reference itself; what is measured now needs another folder")
    wanted = Selection(tasks, methods, agents, seeds, budget)
    place = build_executor(executor, jobs or min(2, os.cpu_count() or 1))
    if update:
        cells = _named(wanted) if wanted.is_given else _held(_base(reference, wanted))
        _update(reference, cells, place, results, as_json)
        return
    base = _base(reference, wanted)
    _judge(base, (str(results), _measure(_held(base), place, results)), str(reference), results, as_json)


# ---------------------------------------------------------------------------------------------------------- compare


def _judge(base: Recording, new: tuple[str, Recording], path: str, folder: Path, as_json: bool) -> None:
    """Write and print the summaries, and exit."""
    from stlbench.gate import comparison
    from stlbench.gate.judge import EXIT, judge

    judgement = judge(comparison.pair(base, new[1]))
    found, text = facts(judgement, (path, base), new), markdown("stlbench gate", judgement, (path, base), new)
    try:
        (folder / "gate.json").write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        (folder / "gate.md").write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"cannot write the summary: {error}") from error
    if as_json:
        print_json(found)
    else:
        typer.echo(text, nl=False)
    raise typer.Exit(EXIT[judgement.verdict])


def _base(reference: Path, wanted: Selection) -> Recording:
    """The cells of the reference that the options choose."""
    from dataclasses import replace

    from stlbench.gate import comparison
    from stlbench.registry.choices import parse_choices

    if not reference.exists():
        raise UsageError(f"there is no reference at {reference}; --update with --tasks and --methods makes one")
    recording = comparison.load(reference)
    kept = _chosen(list(recording.samples.values()), "budget", [wanted.budget])
    for kind, text in (("task", wanted.tasks), ("method", wanted.methods), ("agent", wanted.agents)):
        if text is not None:
            kept = _chosen(kept, kind, [str(choice) for choice in parse_choices(text)])
    if wanted.seeds is not None:
        kept = _chosen(kept, "seed", [str(seed) for seed in parse_seeds(wanted.seeds)])
    return replace(recording, samples={entry.identity: entry for entry in kept})


def _chosen(samples: list[Sample], kind: str, names: Collection[str]) -> list[Sample]:
    there = {str(getattr(entry, kind)) for entry in samples}
    for name in names:
        if name not in there:
            raise UsageError(f"the reference has no cells of {kind} '{name}'{did_you_mean(name, there)}")
    return [entry for entry in samples if str(getattr(entry, kind)) in names]


# ---------------------------------------------------------------------------------------------------------- measure


def _held(base: Recording) -> tuple[Cell, ...]:
    """The cells of a recording as they are planned now, task by task, since an agent may have no recipe in others."""
    from stlbench.registry.choices import parse_choice
    from stlbench.study import matrix

    cells: list[Cell] = []
    samples = base.samples.values()
    for task in sorted({entry.task for entry in samples}):
        own = [entry for entry in samples if entry.task == task]
        methods = [parse_choice(name) for name in sorted({entry.method for entry in own})]
        agents = [parse_choice(name) for name in sorted({entry.agent for entry in own})]
        cells += matrix.plan([task], methods, agents, sorted({entry.seed for entry in own}), own[0].budget)
    return tuple(cell for cell in cells if (cell.task, cell.method, cell.agent, cell.budget, cell.seed) in base.samples)


def _measure(cells: tuple[Cell, ...], executor: Executor, folder: Path) -> Recording:
    """Run what is missing or was computed by other code, or on another machine."""
    from stlbench.gate import comparison
    from stlbench.gate.calibration import CalibratedLedger
    from stlbench.registry.fingerprint import fingerprint
    from stlbench.study import matrix
    from stlbench.study.provenance import collect

    stamp = {name: value for name, value in collect(executor.jobs).items() if name not in ("jobs", "time")}
    with CalibratedLedger(folder / LEDGER, {**stamp, "harness": fingerprint("stlbench.study.trial")[:12]}) as ledger:
        done = ledger.finished((cell.key for cell in cells), retry=True)
        matrix.check(cell for cell in cells if cell.key not in done)
        try:
            run_missing(cells, len(done), ledger, executor, True, folder)
        except KeyboardInterrupt:
            typer.echo(f"interrupted; the same command goes on with what is recorded in {folder}/", err=True)
            raise typer.Exit(130) from None
        return comparison.gather(ledger.results({cell.key for cell in cells}))


# ----------------------------------------------------------------------------------------------------------- update


def _named(wanted: Selection) -> tuple[Cell, ...]:
    """The cells that the options name, with the defaults of `stlbench run`."""
    return plan(
        wanted.tasks or "hold-disc",
        wanted.methods or "funnel,flag",
        wanted.agents,
        wanted.seeds or SEEDS,
        wanted.budget,
    )


def _update(reference: Path, cells: tuple[Cell, ...], executor: Executor, folder: Path, as_json: bool) -> None:
    """Measure the cells and write the reference, unless one of them ended by accident."""
    from stlbench.gate import comparison
    from stlbench.result import ACCIDENTS

    recording = _measure(cells, executor, folder)
    failed = [entry for entry in recording.samples.values() if entry.status in ACCIDENTS]
    if failed:
        for entry in failed:
            typer.echo(f"{entry.name} {entry.status}: {entry.reason}", err=True)
        typer.echo(f"{len(failed)} of {len(recording.samples)} cells failed; no reference was written", err=True)
        raise typer.Exit(1)
    comparison.save(reference, recording)
    if as_json:
        print_json({"reference": str(reference), "cells": len(recording.samples)})
    else:
        typer.echo(f"Written to {reference}/: cells.csv, provenance.json; {len(recording.samples)} cells")
