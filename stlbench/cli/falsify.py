"""`stlbench falsify`: search for a start from which a policy violates its task's formula."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from stlbench.cli.common import Json, console, print_json
from stlbench.cli.options import TaskFolders
from stlbench.cli.subjects import (
    All,
    Budget,
    Controller,
    Method,
    Named,
    On,
    Policies,
    RunFolder,
    TaskName,
    Which,
    subjects,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from stlbench.search.falsify import Falsification
    from stlbench.search.subject import Subject


def falsify(
    policies: Policies = None,
    results: RunFolder = Path("results"),
    every: All = False,
    controller: Controller = None,
    budget: Budget = None,
    which: Which = "selected",
    task: TaskName = None,
    method: Method = None,
    on: On = "observation",
    evaluations: Annotated[int, typer.Option(metavar="N", help="Episodes that are simulated at most.")] = 10_000,
    optimiser: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="differential-evolution, dual-annealing, direct, shgo, or random to compare with.",
            show_default="differential-evolution; random where starts are seeds",
        ),
    ] = None,
    least: Annotated[
        bool, typer.Option("--least", help="Go on after a counterexample, for the least robustness.")
    ] = False,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the search.")] = 0,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of the files.", show_default="DIR of --results/falsified")
    ] = None,
    task_folders: TaskFolders = None,
    as_json: Json = False,
) -> None:
    """Search for a start from which a policy violates its task's formula.

    A global optimiser of SciPy minimises the robustness over the task's initial states; the search stops at the first
    counterexample. Printed are the start, the robustness, and the predicate and the step that it comes from. The trace
    (.npz, .csv) and its picture are written. Of several cells a table is printed. The exit code is 0 whatever is found,
    and 2 if a policy or a task fails.

    \b
    Examples:
      stlbench falsify hold-disc/funnel/dqn/0
      stlbench falsify --all --results study --evaluations 2000
      stlbench falsify --controller hold-disc,robot-nav --least
      stlbench falsify --task pendulum my_controllers:energy --on state
    """
    from stlbench.cli.counter import one_by_one
    from stlbench.records.outputs import inside
    from stlbench.search import falsify as search
    from stlbench.search.files import write

    how = search.How(optimiser, evaluations, least, seed)
    search.check(how)
    chosen = Named(policies or [], results, every, controller, budget, which, task, method, on)
    named, place = subjects(chosen), out or inside(results / "falsified", results)

    def work(subject: Subject, told: Callable[[int, float], None]) -> _Written:
        found = search.falsify(subject, how, told)
        return _Written(found, write(found, place) if found.found or found.open or least else [])

    one_by_one(named, evaluations, work, lambda one: _line(one.found), lambda found: _show(found, as_json))


class _Written(NamedTuple):
    """What was found, and the files that it was written to."""

    found: Falsification
    files: list[Path]


def _show(searched: list[_Written], as_json: bool) -> None:
    from stlbench.report import to_screen
    from stlbench.search.tables import falsifications

    if as_json:
        print_json([_facts(one.found, one.files) for one in searched])
        return
    if len(searched) == 1:
        for line in [*_lines(searched[0].found), *map(str, searched[0].files)]:
            typer.echo(line)
        return
    to_screen(falsifications([one.found for one in searched]), console())
    if files := [path for one in searched for path in one.files]:
        typer.echo(f"{len(files)} files in {files[0].parent}")


def _line(one: Falsification) -> str:
    """What was found, in short."""
    spent = f"{one.evaluations} evaluations, {one.cpu_seconds:.1f} s CPU"
    words = {"violated": "counterexample", "open": "no counterexample, verdict open"}
    word = words.get(one.worst.verdict, "no counterexample")
    if one.first is not None:
        word += f", the first in evaluation {one.first}"
    return f"{one.subject.name}: {word} ({one.how.optimiser}, {spent})"


def _lines(one: Falsification) -> list[str]:
    """One search in full."""
    lines = [
        _line(one),
        f"start:      {one.start_text(9)}",
        f"robustness: {_robustness(one)}",
        f"{'failed:' if one.found else 'open:' if one.open else 'least:':<11} {one.failed}",
    ]
    if (witness := one.witness) is not None:
        predicate = f"{'not ' if witness.sign < 0 else ''}{witness.predicate}"
        at = f"step {witness.step} ({witness.step * one.subject.task.file.sampling_time:.6g} s)"
        lines.append(f"because:    {predicate} at {at}: margin {witness.margin:.6g}")
    return lines


def _robustness(one: Falsification) -> str:
    """Its value and the verdict."""
    if not one.open:
        return f"{one.worst.robustness:.6g}, {one.worst.verdict}"
    return f"at least {one.worst.robustness:.6g}, verdict open: the episode ended early, what would follow decides"


def _facts(one: Falsification, files: list[Path]) -> dict[str, Any]:
    """One search as plain values."""
    witness, loss = one.witness, one.loss
    early = one.steps if loss is None else loss.step
    return {
        "searched": one.subject.name,
        "optimiser": one.how.optimiser,
        "seed": one.how.seed,
        "evaluations": one.evaluations,
        "counterexample": one.found,
        "verdict": one.worst.verdict,
        "first": one.first,
        "start": one.start,
        "robustness": one.worst.robustness,
        "failed": one.failed if one.found or one.open else None,
        "predicate": None if witness is None else str(witness.predicate),
        "step": early if witness is None else witness.step,
        "margin": None if witness is None else witness.margin,
        "cpu_seconds": one.cpu_seconds,
        "files": [str(path) for path in files],
    }
