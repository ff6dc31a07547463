"""`stlbench falsify` and `stlbench certify`: does a policy, of whatever kind, fail from some start, and with which
probability?
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.text import Text

from stlbench.cli.common import warn
from stlbench.cli.options import Architecture, Budget, From, Method, On, OwnActions, Seed, TaskFolders, Which, declare
from stlbench.cli.output import Json, show
from stlbench.errors import UsageError, one_line
from stlbench.records.result_files import inside
from stlbench.registry.choices import parse_choice
from stlbench.registry.named_tasks import parse_tasks
from stlbench.report.tables.table import Table
from stlbench.search import certify as certifying
from stlbench.search import falsify as search
from stlbench.search.actor import Actor, Unsearchable, foreign, of_cell, of_controller, of_policy
from stlbench.search.certify import Certificate, plain
from stlbench.search.falsify import Falsification
from stlbench.share.scoring import UNKNOWN, Shown, play
from stlbench.share.source import find_source
from stlbench.study.progress import bar_on
from stlbench.study.results import Results
from stlbench.task.task import load_task

T = TypeVar("T")


@dataclass(frozen=True)
class Chosen:
    """The options that name actors: `takes_actors` gives a command one for each field."""

    policies: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[CELL]...", help="task/method/agent/seed, as the run's lines name it; with --task POLICY."
        ),
    ] = None
    results: From = Path("results")
    every: Annotated[bool, typer.Option("--all", help="All cells of the folder that have a stored policy.")] = False
    controller: Annotated[
        str | None, typer.Option(metavar="LIST", help="Tasks whose controllers by hand are searched, a comma list.")
    ] = None
    budget: Budget = None
    which: Which = "selected"
    task: Annotated[
        str | None,
        typer.Option(metavar="TASK", help="Search policies from outside on it, named as in `stlbench score`."),
    ] = None
    method: Method = None
    on: On = None
    architecture: Architecture = None
    actions: OwnActions = None

    def load(self) -> list[Actor]:
        """All that the options name. Raises `UsageError` if they name nothing, or what cannot act."""
        if self.every and (self.policies or self.task):
            raise UsageError("--all takes all cells of the folder; do not name others")
        if self.task is None:
            outside = ("method", "on", "architecture", "actions")
            if given := [f"--{name}" for name in outside if getattr(self, name) is not None]:
                raise UsageError(f"{' and '.join(given)}: for policies from outside, with --task")
        actors = self._by_hand(self.controller) if self.controller else []
        if self.task is not None:
            actors += self._from_outside(self.task)
        elif self.policies or self.every:
            actors += self._stored()
        if not actors:
            raise UsageError("name a cell, --all for all cells of a folder of results, or a task by --controller")
        return actors

    @staticmethod
    def _by_hand(controllers: str) -> list[Actor]:
        actors = []
        for task in parse_tasks(controllers):
            with foreign(f"{task}, by hand"):
                actors.append(of_controller(load_task(task)))
        return actors

    def _from_outside(self, task_name: str) -> list[Actor]:
        if not self.policies:
            raise UsageError("--task needs a policy: module:function, or a file .zip (SB3) or .onnx")
        shown = Shown(self.on or "observation", UNKNOWN if self.method is None else parse_choice(self.method))
        with foreign(f"task {task_name}"):
            task = load_task(task_name)
        actors = []
        for policy in self.policies:
            source = find_source(policy, self.architecture, self.actions)
            if source.kind == "cell":
                raise UsageError(f"{policy} is a cell: name it without --task")
            if source.kind == "traces":
                raise UsageError(f"{policy} is recorded traces, which cannot act")
            name = f"{task.name}, {source.shown}"
            with foreign(name):
                actors.append(of_policy(name, (task.name, source.name), task, *play(task, source, shown)[:2]))
        return actors

    def _stored(self) -> list[Actor]:
        results = Results.load(self.results)
        if self.policies:
            return [of_cell(results.folder, results.cell(name, self.budget), self.which) for name in self.policies]
        actors: list[Actor] = []
        for result in results:
            stored = result.measurement is not None and result.measurement.policies is not None
            if stored and self.budget in (None, result.id.budget):
                try:
                    actors.append(of_cell(results.folder, result, self.which))
                except UsageError as error:
                    warn(str(error))
        if not actors:
            rest = f" and the budget {self.budget}" if self.budget else ""
            raise UsageError(f"{self.results} has no cell with a stored policy that can be used{rest}")
        return actors


def takes_actors(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of `Chosen`, which it takes as its first argument."""
    shared = inspect.signature(Chosen, eval_str=True).parameters.values()
    _, *own = inspect.signature(command, eval_str=True).parameters.values()

    @wraps(command)
    def with_options(**values: Any) -> None:
        command(Chosen(**{each.name: values.pop(each.name) for each in shared}), **values)

    return declare(with_options, (*shared, *own))


def one_by_one(
    actors: Sequence[Actor],
    episodes: int,
    search: Callable[[Actor, Callable[[int, float], None]], T],
    line: Callable[[T], str],
    show: Callable[[list[T]], None],
) -> None:
    """Search each actor with a bar on a terminal, and show all results; after ctrl-C the results so far, exit code 130.

    Of several actors, one that cannot be searched is left out with a line on stderr, and the exit code is 2. Each takes
    at most so many `episodes`. `search` gets an actor and a function for its progress, `line` is a result in short.
    """
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    results, interrupted, refused = list[T](), False, False
    with bar_on(console, transient=True) as bar:
        counted = bar.add_task("", total=episodes)
        try:
            for place, actor in enumerate(actors, 1):
                bar.reset(counted, total=episodes, description=escape(actor.name))
                try:
                    results.append(search(actor, lambda count, _: bar.update(counted, completed=count)))
                    text = line(results[-1])
                except Unsearchable as error:
                    if len(actors) == 1:
                        raise
                    refused, text = True, f"error: {one_line(error)}"
                if len(actors) > 1:
                    console.print(Text(f"[{place}/{len(actors)}] {text}"))
        except KeyboardInterrupt:
            interrupted = True
    if results:
        show(results)
    if interrupted:
        typer.echo(f"interrupted: {len(results)} of {len(actors)} were searched", err=True)
        raise typer.Exit(130)
    if refused:
        raise typer.Exit(2)


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
    (.npz, .csv) and its picture are written. Several cells give a table. The exit code is 0 whatever is found,
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
    if one.held:
        counts += f" ({one.held} only because the last sample stays after an early end)"
    interval = f"[{one.interval.low:.4f}, {one.interval.high:.4f}]"
    line = f"{one.actor.name}: satisfied from {counts}; "
    line += f"with confidence {plain(one.claim.confidence)} {what} is in {interval}"
    if one.claim.at_least is None:
        return line
    return f"{line}; that it is at least {plain(one.claim.at_least)} is {one.verdict}"
