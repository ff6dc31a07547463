"""Certificates: an interval for the probability that a random start satisfies the formula, with its confidence."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stlbench.errors import UsageError
from stlbench.search.actor import Actor, Played, Unsearchable, space_of
from stlbench.simulation.verdicts import judge, without_end
from stlbench.statistics.intervals import Interval, share_interval, share_sequence
from stlbench.study.cell import derive_seed
from stlbench.task.task import Task

STARTS = 1000  # default number of starts without a rule to stop
MOST = 100_000  # starts after which a sequential test stops undecided
_LARGEST = 10**9  # starts: more take years
_FIRST = 64  # starts of the first batch of a sequential test; each further batch doubles the total

Verdict = Literal["shown", "refuted", "undecided"]


@dataclass(frozen=True)
class Claim:
    """The question, and the confidence of the answer.

    Without `at_least` and `width` the number of starts is fixed, and the interval is that of Clopper and Pearson. Else
    the test looks after every batch, and its interval is a confidence sequence, valid at any time (`share_sequence`).
    """

    confidence: float = 0.99
    starts: int | None = None  # random starts, at most; None for `STARTS`, or `MOST` with a rule to stop
    at_least: float | None = None
    """A probability in (0, 1): stop when satisfaction is shown to be at least this probable, or less."""
    width: float | None = None  # in (0, 1): stop when the interval is at most this wide
    seed: int = 0

    @property
    def most(self) -> int:
        """The most starts that are drawn."""
        return (MOST if self.sequential else STARTS) if self.starts is None else self.starts

    @property
    def text(self) -> str | None:
        """The claim in words; None if the number of starts is fixed."""
        if self.at_least is not None:
            return f"at least {plain(self.at_least)}"
        return None if self.width is None else f"known to {plain(self.width)}"

    @property
    def sequential(self) -> bool:
        return self.at_least is not None or self.width is not None


@dataclass(frozen=True)
class Certificate:
    """The probability of satisfaction is in the interval with the claim's confidence.

    An episode with an early end counts as satisfied only if every continuation satisfies.
    """

    actor: Actor
    claim: Claim
    starts: int
    satisfied: int
    open: int  # episodes that ended early with an open verdict: some continuations satisfy
    interval: Interval
    cpu_seconds: float
    held: int = 0  # of the satisfied episodes, those that are so only because the last sample stays after an early end

    @property
    def violated(self) -> int:
        """Episodes that every continuation violates."""
        return self.starts - self.satisfied - self.open

    @property
    def facts(self) -> dict[str, str | float | int | None]:
        """As JSON has it."""
        return {
            "certified": self.actor.name,
            "confidence": self.claim.confidence,
            "starts": self.starts,
            "satisfied": self.satisfied,
            "violated": self.violated,
            "open": self.open,
            "held": self.held,
            "probability": self.satisfied / self.starts,
            "low": self.interval.low,
            "high": self.interval.high,
            "at_least": self.claim.at_least,
            "verdict": self.verdict,
            "seed": self.claim.seed,
            "cpu_seconds": self.cpu_seconds,
        }

    @property
    def verdict(self) -> Verdict | None:
        """The verdict on `at_least`; None without it."""
        claimed = self.claim.at_least
        if claimed is None:
            return None
        return "shown" if self.interval.low >= claimed else "refuted" if self.interval.high < claimed else "undecided"


def plain(number: float) -> str:
    """A number with all its digits: 0.999999999999 is not 1."""
    return repr(number).removesuffix(".0")


def check(claim: Claim) -> None:
    shares = {"confidence": claim.confidence, "probability": claim.at_least, "width": claim.width}
    for name, value in shares.items():
        if value is not None and not (isinstance(value, int | float) and 0 < value < 1):
            raise UsageError(f"a {name} is between 0 and 1, got {plain(value)}")
    if claim.at_least is not None and claim.width is not None:
        raise UsageError("a test stops by a probability that is claimed, or by the interval's width, not by both")
    if claim.most < 1:
        raise UsageError(f"a certificate needs at least one start, got {claim.starts}")
    if claim.most > _LARGEST:
        raise UsageError(f"a certificate takes at most {_LARGEST:,} starts, got {claim.starts}")


def certify(
    actor: Actor, claim: Claim | None = None, progress: Callable[[int, int], None] = lambda starts, satisfied: None
) -> Certificate:
    """Let the actor act from random starts, which its training, its selection and the report have not seen.

    `progress` is called after each batch with the starts and how many of them satisfied. Raises `UsageError` where the
    claim makes no sense, and `Unsearchable` where the task has a single start or the actor fails.
    """
    claim = claim or Claim()
    check(claim)
    space = space_of(actor.task)
    if space.single:
        raise Unsearchable(f"task {actor.task.name} has a single start; `stlbench falsify` says whether it satisfies")
    began, most = time.process_time(), claim.most
    generator = np.random.default_rng(derive_seed("certify", actor.task.choice.name, claim.seed))
    starts = satisfied = open_ = held = 0
    interval = Interval(0.0, 1.0)
    while starts < most and not (claim.sequential and _decided(claim, interval)):
        count = min(max(_FIRST, starts), most - starts, actor.rows)
        played = actor.play(space.draw(generator, count))
        satisfied += int(played.satisfied.sum())
        open_ += int((played.possible & ~played.satisfied).sum())
        held += _held(actor.task, played)
        starts += count
        interval = share_sequence(satisfied, starts, claim.confidence)  # it holds however often somebody looks
        progress(starts, satisfied)
    if not claim.sequential:  # nobody looked before the end, so the narrower exact interval holds
        interval = share_interval(satisfied, starts, claim.confidence) or interval
    return Certificate(actor, claim, starts, satisfied, open_, interval, time.process_time() - began, held)


def _held(task: Task, played: Played) -> int:
    """The satisfied episodes whose verdict would be open if the last sample did not stay after an early end."""
    early = played.satisfied & (played.lasted < task.file.steps)
    traces = without_end(played.traces[early], played.lasted[early])
    return int((~judge(task.formula, traces, task.specification, "interval").satisfied[:, 0]).sum())


def _decided(claim: Claim, interval: Interval) -> bool:
    if claim.width is not None:
        return interval.high - interval.low <= claim.width
    return claim.at_least is not None and not interval.low < claim.at_least <= interval.high
