"""machine: a reward machine whose clock is the time (Toro Icarte et al., JAIR 2022, arXiv 2010.03950)."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth
from stlbench_methods.formula_parts import truths


class Machine(RewardMethod):
    """Each term waits, holds, and is done or failed; 1 is paid when all are done, -1 when one has failed.

    A term of eq. 2 asks for a run of samples of psi within steps start..end: F[a,b] psi for 1 within a..b, G[a,b] psi
    for all of a..b, F[a,c1] G[c2,b] psi for b - c2 + 1 within a + c2..c1 + b. Its number is the length of the run that
    ends at the present sample. It is done when the run is complete, and has failed as soon as too few samples are left:
    exactly when no continuation can satisfy it. The machine is over when all terms are done or one has failed, and
    nothing is paid after that; its verdict is the formula's.

    An episode of training may begin later. Each run that began before then has the least length that can still be
    completed. A term that could not begin any more is done.

    Args:
        shaping: `none`. `phases`: beside it Phi(s') - Phi(s), Phi minus the share of the phases that are left. A term
            that waits has two, to hold and to be done; one that holds has one. Phi is 0 when all is over, so that over
            an episode it sums up to the same for all policies.
        counterfactuals: the number of times that a transition is also learned from other lengths of the runs (CRM of
            the source). They are those that the present sample does not rule out, each as likely.

    Raises:
        Unsuitable: the formula is outside the fragment of eq. 2.
    """

    can_end = True
    floor = -1.0

    def __init__(
        self,
        specification: Specification,
        *,
        shaping: Literal["none", "phases"] = "none",
        counterfactuals: Annotated[int, Field(ge=0)] = 1,
    ) -> None:
        super().__init__(specification)
        terms = specification.terms
        self._holds = [specification.holds(term.psi) for term in terms]
        self._starts, self._ends = np.array([(term.start, term.end) for term in terms]).T.copy()
        self._lengths = np.array([term.length for term in terms])
        self.memory_size = len(terms)
        self.counterfactuals = counterfactuals
        phases = int(np.minimum(self._lengths, 2).sum())  # a term of one sample never holds without being done
        self._weight = 1 / phases if shaping == "phases" else 0.0
        self.scale = 2.0 if shaping == "phases" else 1.0

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        before = np.clip(self._lengths - (self._ends - t[:, None] + 1), 0, self._lengths).astype(np.float64)
        return self._run(signals[None], t, before)[1]

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        return self._run(samples[1:], t + 1, memory)

    def inputs(self, memory: Array) -> Array:
        share: Array = memory / self._lengths
        return share

    def over(self, memory: Array) -> Truth:
        over: Truth = (memory == self._lengths).all(axis=1) | (memory < 0).any(axis=1)
        return over

    def counterfactual(self, signals: Array, t: Integers, memory: Array, chance: Array) -> Array:
        """Runs of other lengths; a term for which the sample leaves none keeps its own."""
        holds, at = truths(self._holds, signals[None])[:, 0].T, t[:, None]
        since, left = at - self._starts, self._ends - at
        within = (since >= 0) & (left >= 0)
        # lengths low..high of runs that end here; without one, none has begun, or it was completed before
        low = np.where(holds & within, np.maximum(1, self._lengths - left), 0)
        high = np.where(holds & within, np.minimum(self._lengths, since + 1), 0)
        waits = ~within | holds | (self._lengths <= left)
        low, high = np.where(left < 0, self._lengths, low), np.where(left < 0, self._lengths, high)
        first = np.where(waits, np.maximum(high - low + 1, 0), 0)
        completed = within & ~holds & (since >= self._lengths)
        count = first + completed
        drawn = (chance * count).astype(np.int64)
        other = np.where(drawn < first, low + drawn, self._lengths)
        return np.where(count > 0, other, memory)

    def describe(self) -> Mapping[str, Any]:
        each = zip(self.specification.terms, self._lengths.tolist(), strict=True)
        return {str(term.formula): f"{length} in a row within {term.start}..{term.end}" for term, length in each}

    def _run(self, samples: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        from stlbench_methods.updates import run  # imports Numba, which building a method does without

        after = memory.copy()
        held = truths(self._holds, samples)
        return run(held, self._starts, self._ends, self._lengths, t, self._weight, after), after
