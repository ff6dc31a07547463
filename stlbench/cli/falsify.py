"""`stlbench falsify`: search for a start from which a policy violates its task's formula."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import Json, console, print_json
from stlbench.cli.subjects import All, Budget, Cells, Controller, Final, RunFolder, subjects

if TYPE_CHECKING:
    from stlbench.search.falsify import Falsification


def falsify(
    cells: Cells = None,
    results: RunFolder = Path("results"),
    controller: Controller = None,
    every: All = False,
    budget: Budget = None,
    final: Final = False,
    evaluations: Annotated[int, typer.Option(metavar="N", help="Episodes that are simulated at most.")] = 10_000,
    optimiser: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="differential-evolution, dual-annealing, direct, shgo, or random to compare with."
        ),
    ] = "differential-evolution",
    least: Annotated[
        bool, typer.Option("--least", help="Go on after a counterexample, for the least robustness.")
    ] = False,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the search.")] = 0,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the files.", show_default="DIR of --results/falsified")
    ] = None,
    as_json: Json = False,
) -> None:
    """Search for a start from which a policy violates its task's formula.

    A global optimiser of SciPy minimises the robustness over the task's initial states; the search stops at the first
    counterexample. Printed are the start, the robustness, and the predicate and the step that it comes from. The trace
    (.npz, .csv) and its picture are written. Of several cells a table is printed. The exit code is 0 whatever is found.

    \b
    Examples:
      stlbench falsify hold-disc/funnel/dqn/0
      stlbench falsify --all --results study --evaluations 2000
      stlbench falsify --controller hold-disc,robot-nav --least
    """
    from stlbench.cli.counter import Counter
    from stlbench.search import falsify as search
    from stlbench.search.files import write

    how = search.How(optimiser, evaluations, least, seed)
    search.check(how)
    named = subjects(cells, results, budget, every, final, controller)
    found, paths = list[search.Falsification](), list[list[Path]]()
    with Counter(len(named), evaluations) as counter:
        for subject in named:
            counter.begin(subject.name)
            one = search.falsify(subject, how, lambda count, _: counter.count(count))
            found.append(one)
            paths.append(write(one, out or results / "falsified") if one.found or least else [])
            counter.ended(_line(one))
    _show(found, paths, as_json)


def _show(found: list[Falsification], paths: list[list[Path]], as_json: bool) -> None:
    from stlbench.report import to_screen
    from stlbench.search.tables import falsifications

    if as_json:
        print_json([_facts(one, files) for one, files in zip(found, paths, strict=True)])
        return
    if len(found) == 1:
        for line in [*_lines(found[0]), *map(str, paths[0])]:
            typer.echo(line)
    else:
        to_screen(falsifications(found), console())
        if files := [path for several in paths for path in several]:
            typer.echo(f"{len(files)} files in {files[0].parent}")


def _line(one: Falsification) -> str:
    """What was found, in short."""
    spent = f"{one.evaluations} evaluations, {one.cpu_seconds:.1f} s CPU"
    word = f"counterexample, the first in evaluation {one.first}" if one.found else "no counterexample"
    return f"{one.subject.name}: {word} ({one.how.optimiser}, {spent})"


def _lines(one: Falsification) -> list[str]:
    """One search in full."""
    witness, task = one.witness, one.subject.task
    at = f"step {witness.step} ({witness.step * task.file.sampling_time:.6g} s)"
    return [
        _line(one),
        f"start:      {', '.join(f'{name} = {value:.9g}' for name, value in one.start.items())}",
        f"robustness: {one.worst.robustness:.6g}, {'violated' if one.found else 'satisfied'}",
        f"{'failed:' if one.found else 'least:':<11} {witness.conjunct}",
        f"because:    {'not ' if witness.sign < 0 else ''}{witness.predicate} at {at}: margin {witness.margin:.6g}",
    ]


def _facts(one: Falsification, files: list[Path]) -> dict[str, Any]:
    """One search as plain values."""
    witness = one.witness
    return {
        "searched": one.subject.name,
        "optimiser": one.how.optimiser,
        "seed": one.how.seed,
        "evaluations": one.evaluations,
        "counterexample": one.found,
        "first": one.first,
        "start": one.start,
        "robustness": one.worst.robustness,
        "conjunct": str(witness.conjunct),
        "predicate": str(witness.predicate),
        "step": witness.step,
        "margin": witness.margin,
        "cpu_seconds": one.cpu_seconds,
        "files": [str(path) for path in files],
    }
