"""`stlbench falsify` and `stlbench certify`: does a policy fail from some start, and with which probability?"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.actors import Chosen, one_by_one, takes_actors
from stlbench.cli.options import Seed, TaskFolders
from stlbench.cli.output import Json, show
from stlbench.records.outputs import inside
from stlbench.report import Table
from stlbench.search import certify as certifying
from stlbench.search import falsify as search
from stlbench.search.actor import Actor
from stlbench.search.certify import Certificate, plain
from stlbench.search.falsify import Falsification

if TYPE_CHECKING:
    _Written = tuple[Falsification, list[Path]]  # a result, and the files that it was written to


@takes_actors
def falsify(
    chosen: Chosen,
    evaluations: Annotated[int, typer.Option(metavar="N", help="The most episodes to simulate.")] = 10_000,
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
    seed: Seed = 0,
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
      stlbench falsify reach-stay/funnel/dqn/0
      stlbench falsify --all --results study --evaluations 2000
      stlbench falsify --controller reach-stay,robot-nav --least
      stlbench falsify --task pendulum my_controllers:energy --on state
    """
    from stlbench.search.outputs import write

    how = search.How(optimiser, evaluations, least, seed)
    search.check(how)
    actors, place = chosen.load(), out or inside(chosen.results / "falsified", chosen.results)

    def work(actor: Actor, progress: Callable[[int, float], None]) -> _Written:
        result = search.falsify(actor, how, progress)
        return result, write(result, place) if result.found or result.open or least else []

    one_by_one(
        actors,
        evaluations,
        work,
        lambda one: _line(one[0]),
        lambda results: show(as_json, [_facts(*one) for one in results], _text(results)),
    )


def _facts(one: Falsification, files: list[Path]) -> dict[str, Any]:
    witness, loss = one.witness, one.loss
    early = one.steps if loss is None else loss.step
    return {
        "searched": one.actor.name,
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


def _text(results: list[_Written]) -> Iterator[str | Table]:
    from stlbench.search.outputs import falsifications

    files = [path for _, paths in results for path in paths]
    if len(results) == 1:
        yield from _lines(results[0][0])
        yield from map(str, files)
        return
    yield falsifications([one for one, _ in results])
    if files:
        yield f"{len(files)} files in {files[0].parent}"


def _lines(one: Falsification) -> Iterator[str]:
    robustness = f"{one.worst.robustness:.6g}, {one.worst.verdict}"
    if one.open:
        what = "verdict open: the episode ended early, what would follow decides"
        robustness = f"at least {one.worst.robustness:.6g}, {what}"
    yield _line(one)
    yield f"start:      {one.start_text(9)}"
    yield f"robustness: {robustness}"
    yield f"{'failed:' if one.found else 'open:' if one.open else 'least:':<11} {one.failed}"
    if (witness := one.witness) is not None:
        predicate = f"{'not ' if witness.sign < 0 else ''}{witness.predicate}"
        at = f"step {witness.step} ({witness.step * one.actor.task.file.sampling_time:.6g} s)"
        yield f"because:    {predicate} at {at}: margin {witness.margin:.6g}"


def _line(one: Falsification) -> str:
    spent = f"{one.evaluations} evaluations, {one.cpu_seconds:.1f} s CPU"
    words = {"violated": "counterexample", "open": "no counterexample, verdict open"}
    word = words.get(one.worst.verdict, "no counterexample")
    if one.first is not None:
        word += f", the first in evaluation {one.first}"
    return f"{one.actor.name}: {word} ({one.how.optimiser}, {spent})"


@takes_actors
def certify(
    chosen: Chosen,
    confidence: Annotated[float, typer.Option(metavar="C", help="Probability that the answer is right.")] = 0.99,
    starts: Annotated[
        int | None,
        typer.Option(metavar="N", help="Random starts.", show_default="1000; with a rule to stop at most 100,000"),
    ] = None,
    at_least: Annotated[
        float | None,
        typer.Option(metavar="P", help="Stop when it is shown that the probability is at least P, or that it is less."),
    ] = None,
    until: Annotated[
        float | None, typer.Option(metavar="WIDTH", help="Stop when the interval is no wider than this.")
    ] = None,
    seed: Seed = 0,
    task_folders: TaskFolders = None,
    as_json: Json = False,
) -> None:
    """Say with which probability a policy satisfies its task's formula from a random start.

    The starts are others than those of training, of selection and of the report. With a fixed number of them the
    interval is that of Clopper and Pearson. With --at-least or --until the test looks after every batch and stops
    early, by an interval that is valid at any time. The exit code is 0 whatever is found, and 2 if a policy or a task
    fails.

    \b
    Examples:
      stlbench certify reach-stay/funnel/dqn/0 --confidence .99
      stlbench certify reach-stay/funnel/dqn/0 --at-least .95
      stlbench certify --controller robot-nav --until .02
    """
    claim = certifying.Claim(confidence, starts, at_least, until, seed)
    certifying.check(claim)
    one_by_one(
        chosen.load(),
        claim.most,
        lambda actor, progress: certifying.certify(actor, claim, progress),
        _certificate_line,
        lambda certificates: show(as_json, [one.facts for one in certificates], _certificate_text(certificates)),
    )


def _certificate_text(certificates: list[Certificate]) -> Iterator[str | Table]:
    from stlbench.search.outputs import certificates as table

    yield _certificate_line(certificates[0]) if len(certificates) == 1 else table(certificates)


def _certificate_line(one: Certificate) -> str:
    counts, what = f"{one.satisfied} of {one.starts} random starts", "the probability"
    if one.open:
        counts += f", violated from {one.violated}, open from {one.open} that ended early"
        what = "the probability that every continuation satisfies"
    interval = f"[{one.interval.low:.4f}, {one.interval.high:.4f}]"
    line = f"{one.actor.name}: satisfied from {counts}; "
    line += f"with confidence {plain(one.claim.confidence)} {what} is in {interval}"
    if one.claim.at_least is None:
        return line
    return f"{line}; that it is at least {plain(one.claim.at_least)} is {one.verdict}"
