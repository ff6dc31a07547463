"""`stlbench certify`: the probability that a policy satisfies its task's formula, with a stated confidence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from stlbench.cli.actors import Chosen, one_by_one, takes_actors
from stlbench.cli.common import Json, show
from stlbench.cli.options import Seed, TaskFolders

if TYPE_CHECKING:
    from stlbench.report import Table
    from stlbench.search.certify import Certificate


@takes_actors
def certify(
    chosen: Chosen,
    confidence: Annotated[float, typer.Option(metavar="C", help="With which the answer is right.")] = 0.99,
    starts: Annotated[
        int | None,
        typer.Option(metavar="N", help="Random starts.", show_default="1000; with a rule to stop 100,000 at most"),
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
    from stlbench.search import certify as search

    claim = search.Claim(confidence, starts, at_least, until, seed)
    search.check(claim)
    one_by_one(
        chosen.load(),
        claim.most,
        lambda actor, progress: search.certify(actor, claim, progress),
        _line,
        lambda certificates: show(as_json, [one.facts for one in certificates], _text(certificates)),
    )


def _text(certificates: list[Certificate]) -> Iterator[str | Table]:
    from stlbench.search.outputs import certificates as table

    yield _line(certificates[0]) if len(certificates) == 1 else table(certificates)


def _line(one: Certificate) -> str:
    from stlbench.search.certify import plain

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
