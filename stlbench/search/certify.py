"""Certificates: the probability that a random start satisfies the formula, with a confidence that is kept."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stlbench.errors import UsageError
from stlbench.report.statistics.intervals import Interval, share_interval, share_sequence
from stlbench.search.space import space_of
from stlbench.search.subject import Subject, Unsearchable
from stlbench.study.cell import derive_seed

STARTS = 1000
"""Starts of a certificate of a fixed number."""
MOST = 100_000
"""Starts after which a sequential test gives up."""
_FIRST = 64
"""Starts of the first batch of a sequential test; each further batch has as many as all before it."""

Verdict = Literal["shown", "refuted", "undecided"]


@dataclass(frozen=True)
class Claim:
    """What is asked, and how sure the answer has to be.

    Without `at_least` and `width` the number of starts is fixed, and the interval is that of Clopper and Pearson. With
    one of them the test looks after every batch and stops as early as it can; its interval is a confidence sequence,
    which is valid at any time (`report.statistics.sequence`).
    """

    confidence: float = 0.99
    starts: int | None = None
    """How many random starts, or how many at most; None for `STARTS`, or `MOST`."""
    at_least: float | None = None
    """A probability in (0, 1): stop when it is shown that that of satisfaction is at least this, or that it is less."""
    width: float | None = None
    """In (0, 1): stop when the interval is no wider."""
    seed: int = 0

    @property
    def most(self) -> int:
        """Starts that are drawn at most."""
        return (MOST if self.sequential else STARTS) if self.starts is None else self.starts

    @property
    def sequential(self) -> bool:
        """Whether the test may stop early."""
        return self.at_least is not None or self.width is not None


@dataclass(frozen=True)
class Certificate:
    """With the claim's confidence, the probability of satisfaction is in the interval.

    Satisfied is what every continuation satisfies; so an open verdict, after an early end, is none.
    """

    subject: Subject
    claim: Claim
    starts: int
    satisfied: int
    open: int
    """Episodes that ended early and that some continuations satisfy."""
    interval: Interval
    cpu_seconds: float

    @property
    def violated(self) -> int:
        """By every continuation."""
        return self.starts - self.satisfied - self.open

    @property
    def verdict(self) -> Verdict | None:
        """On `at_least`; None where that was not asked."""
        claimed = self.claim.at_least
        if claimed is None:
            return None
        return "shown" if self.interval.low >= claimed else "refuted" if self.interval.high < claimed else "undecided"


def plain(number: float) -> str:
    """A number with all of its digits: 0.999999999999 is not 1."""
    return repr(number).removesuffix(".0")


def check(claim: Claim) -> None:
    """Raises `UsageError` where a claim makes no sense."""
    named = {"confidence": claim.confidence, "probability": claim.at_least, "width": claim.width}
    for name, value in named.items():
        if value is not None and not 0 < value < 1:
            raise UsageError(f"a {name} is between 0 and 1, got {plain(value)}")
    if claim.at_least is not None and claim.width is not None:
        raise UsageError("a test stops by a probability that is claimed, or by the interval's width, not by both")
    if claim.most < 1:
        raise UsageError(f"a certificate needs at least one start, got {claim.starts}")


def certify(
    subject: Subject, claim: Claim | None = None, told: Callable[[int, int], None] = lambda starts, satisfied: None
) -> Certificate:
    """Let the subject act from random starts, which neither its training nor its selection nor the report has seen.

    Args:
        subject: what acts.
        claim: what is asked.
        told: is called after each batch with the starts and how many of them satisfied.

    Raises:
        UsageError: a claim that makes no sense.
        Unsearchable: a task with a single start, what acts fails, or a robustness has no value.
    """
    claim = claim or Claim()
    check(claim)
    space = space_of(subject.task)
    if space.single:
        raise Unsearchable(f"task {subject.task.name} has a single start; `stlbench falsify` says whether it satisfies")
    began, most = time.process_time(), claim.most
    generator = np.random.default_rng(_seed(subject, claim))
    starts = satisfied = open_ = 0
    interval = Interval(0.0, 1.0)
    while starts < most and not (claim.sequential and _decided(claim, interval)):
        count = min(max(_FIRST, starts), most - starts, subject.rows)
        played = subject.play(space.draw(generator, count))
        satisfied += int(played.satisfied.sum())
        open_ += int((played.possible & ~played.satisfied).sum())
        starts += count
        interval = share_sequence(satisfied, starts, claim.confidence)
        told(starts, satisfied)
    if not claim.sequential:
        interval = share_interval(satisfied, starts, claim.confidence) or interval
    return Certificate(subject, claim, starts, satisfied, open_, interval, time.process_time() - began)


def _seed(subject: Subject, claim: Claim) -> int:
    """Apart from those of training and of the report; the starts of selection are not random."""
    return derive_seed("certify", subject.task.choice.name, claim.seed)


def _decided(claim: Claim, interval: Interval) -> bool:
    if claim.width is not None:
        return interval.high - interval.low <= claim.width
    return claim.at_least is not None and not interval.low < claim.at_least <= interval.high
