"""`stlbench certify`: the probability that a policy satisfies its task's formula, with a confidence that is kept."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    from stlbench.search.certify import Certificate


def certify(
    policies: Policies = None,
    results: RunFolder = Path("results"),
    every: All = False,
    controller: Controller = None,
    budget: Budget = None,
    which: Which = "selected",
    task: TaskName = None,
    method: Method = None,
    on: On = "observation",
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
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the random starts.")] = 0,
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
      stlbench certify hold-disc/funnel/dqn/0 --confidence .99
      stlbench certify hold-disc/funnel/dqn/0 --at-least .95
      stlbench certify --controller robot-nav --until .02
    """
    from stlbench.cli.counter import one_by_one
    from stlbench.search import certify as search

    claim = search.Claim(confidence, starts, at_least, until, seed)
    search.check(claim)
    chosen = Named(policies or [], results, every, controller, budget, which, task, method, on)
    named = subjects(chosen)
    one_by_one(
        named,
        claim.most,
        lambda subject, told: search.certify(subject, claim, told),
        _line,
        lambda found: _show(found, as_json),
    )


def _show(found: list[Certificate], as_json: bool) -> None:
    from stlbench.report import to_screen
    from stlbench.search.tables import certificates

    if as_json:
        print_json([_facts(one) for one in found])
    elif len(found) == 1:
        typer.echo(_line(found[0]))
    else:
        to_screen(certificates(found), console())


def _line(one: Certificate) -> str:
    """One certificate in words."""
    from stlbench.search.certify import plain

    low, high = one.interval
    counts, what = f"{one.satisfied} of {one.starts} random starts", "the probability"
    if one.open:
        counts += f", violated from {one.violated}, open from {one.open} that ended early"
        what = "the probability that every continuation satisfies"
    confidence = plain(one.claim.confidence)
    told = f"{one.subject.name}: satisfied from {counts}; with confidence {confidence} {what} is in "
    told += f"[{low:.4f}, {high:.4f}]"
    if one.claim.at_least is None:
        return told
    return f"{told}; that it is at least {plain(one.claim.at_least)} is {one.verdict}"


def _facts(one: Certificate) -> dict[str, Any]:
    """One certificate as plain values."""
    return {
        "certified": one.subject.name,
        "confidence": one.claim.confidence,
        "starts": one.starts,
        "satisfied": one.satisfied,
        "violated": one.violated,
        "open": one.open,
        "probability": one.satisfied / one.starts,
        "low": one.interval.low,
        "high": one.interval.high,
        "at_least": one.claim.at_least,
        "verdict": one.verdict,
        "seed": one.claim.seed,
        "cpu_seconds": one.cpu_seconds,
    }
