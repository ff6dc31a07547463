"""`stlbench gate` and `stlbench compare`: are new results worse than a reference, or than other results?"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from stlbench import contract
from stlbench.cli.options import Listed, study_options
from stlbench.cli.output import Json, show
from stlbench.cli.run import DEFAULTS
from stlbench.errors import UsageError
from stlbench.gate import summary
from stlbench.gate.judge import EXIT, Judgement, judge
from stlbench.gate.snapshot import Snapshot, cells_of, load, measure, save, select
from stlbench.gate.summary import Named
from stlbench.gate.turns import both_trees, judge_turns, take_turns
from stlbench.records.result import ACCIDENTS
from stlbench.registry.choices import LOCAL
from stlbench.study.cell import Cell
from stlbench.study.progress import Progress
from stlbench.study.scheduler import build_executor
from stlbench.study.study import Study, read_choices, read_seeds, read_tasks

SEEDS = "10"  # seeds of a new reference


def compare(
    base: Annotated[Path, typer.Argument(metavar="BASE", help="Folder of results, ledger, reference, or bundle.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="The same for the results to be judged.")],
    results: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Also write gate.md, gate.json, gate.xml (JUnit), comment.md there."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Say whether NEW is worse than BASE.

    Cells are paired by task, method, agent, seed and budget; cells of NEW alone are left out. Exit codes: 0 no worse,
    1 worse, 3 these seeds cannot tell, 4 nothing measured or cells of BASE are missing, 2 bad input.

    \b
    Examples:
      stlbench compare results-before results-after
      stlbench compare results/gate-reference results/gate/ledger.sqlite --json
    """
    first, second = (str(base), load(base)), (str(new), load(new))
    _end("stlbench compare", judge(first[1], second[1]), first, second, results, as_json)


@study_options("jobs", "executor")
def gate(
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE", help="A folder that --update wrote.")] = Path(
        "results/gate-reference"
    ),
    against: Annotated[
        str | None,
        typer.Option(metavar="REV", help="Also compare costs: train by turns with the code of this git revision."),
    ] = None,
    budget: Annotated[str, typer.Option(metavar="NAME", help="Budget of the cells.")] = "smoke",
    tasks: Listed = None,
    methods: Listed = None,
    agents: Listed = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="SEEDS", help="As in `stlbench run`.", show_default="all in the reference")
    ] = None,
    results: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the ledger and of the summaries.")] = Path(
        "results/gate"
    ),
    *,
    update: Annotated[bool, typer.Option("--update", help="Write the reference instead of comparing with it.")] = False,
    as_json: Json = False,
    **options: Any,
) -> None:
    """Measure the cells of a reference again, and say whether they are worse.

    Robustness and satisfaction are compared seed by seed. Costs are compared only by --against: it trains each cell
    with the code of a git revision and with that of the working tree, by turns, one at a time. Exit codes: 0 no worse,
    1 worse, 3 cannot tell, 4 nothing measured or cells missing, 2 bad input, 130 after ctrl-C. Without --against, the
    same command again measures only what is missing in DIR. Remove DIR to measure all anew, as after a change of
    stlbench itself.

    --update alone measures and writes again what the reference holds. With --tasks, --methods, --agents or --seeds the
    reference will hold what these name, the rest as in `stlbench run` with ten seeds.

    \b
    Examples:
      stlbench gate results/gate-reference --budget smoke
      stlbench gate results/gate-reference --against origin/main
      stlbench gate reference --update --tasks reach-stay --methods funnel,flag --seeds 10
    """
    if results.resolve() == reference.resolve():
        raise UsageError(f"--results {results} is the reference itself; new measurements need another folder")
    chosen = {"task": read_tasks(tasks), "method": read_choices(methods), "agent": read_choices(agents)}
    executor = options.get("executor", LOCAL)
    place = build_executor(executor, options.get("jobs"))
    if against is not None and (update or executor != LOCAL):
        raise UsageError("--against trains here and writes no reference: leave out --update and --executor")
    if update:
        if tasks is methods is agents is seeds is None:
            cells = cells_of(select(reference, budget=[budget]))
        else:
            named = {name: chosen or DEFAULTS[name] for name, chosen in (("tasks", tasks), ("methods", methods))}
            cells = Study.of({**named, "seeds": seeds or SEEDS, "agents": agents, "budget": budget}).cells()
        _update(reference, _measured(cells, results, place), as_json)
        return
    base = select(reference, budget=[budget], **chosen, seed=read_seeds(seeds))
    cells = cells_of(base)
    if against is None:
        new = _measured(cells, results, place)
        judgement = judge(base, new)
    elif folders := sorted({cell.id.task.name for cell in cells if cell.folder is not None}):
        rule = "each revision finds its tasks by their entry points"
        raise UsageError(f"--against: {rule}, and {', '.join(folders)} is a folder; leave --against out")
    else:
        base, new, judgement = _by_turns(base, against)
    _end("stlbench gate", judgement, (str(reference), base), (str(results), new), results, as_json)


def _by_turns(reference: Snapshot, revision: str) -> tuple[Snapshot, Snapshot, Judgement]:
    try:
        with both_trees(revision) as (base, change):
            turns = take_turns(reference.samples, base, change, partial(typer.echo, err=True))
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
    judgement, new = judge_turns(reference, turns)
    provenance = {**reference.provenance, "costs against": base.name}
    return replace(reference, provenance=provenance), new, judgement


def _measured(cells: Sequence[Cell], folder: Path, executor: contract.Executor) -> Snapshot:
    try:
        with Progress() as progress:
            return measure(cells, folder, executor, progress)
    except KeyboardInterrupt:
        typer.echo(f"interrupted; the same command goes on with what is recorded in {folder}/", err=True)
        raise typer.Exit(130) from None


def _end(title: str, judgement: Judgement, base: Named, new: Named, folder: Path | None, as_json: bool) -> None:
    if folder is not None:
        summary.write(folder, title, judgement, base, new)
    text = summary.markdown(title, judgement, base, new).removesuffix("\n")
    show(as_json, summary.facts(judgement, base, new), [text])
    raise typer.Exit(EXIT[judgement.verdict])


def _update(reference: Path, snapshot: Snapshot, as_json: bool) -> None:
    count = len(snapshot.samples)
    failed = [sample for sample in snapshot.samples.values() if sample.status in ACCIDENTS]
    if failed:
        for sample in failed:
            typer.echo(f"{sample.id.name} {sample.status}: {sample.reason}", err=True)
        typer.echo(f"{len(failed)} of {count} cells failed; no reference was written", err=True)
        raise typer.Exit(1)
    save(reference, snapshot)
    written = f"Written to {reference}/: cells.csv, provenance.json; {count} cells"
    show(as_json, {"reference": str(reference), "cells": count}, [written])
