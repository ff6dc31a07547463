"""verdict: the truth of each term of the formula, and nothing before it is known."""

from typing import Literal

import numpy as np

from stlbench.contract import Array, Integers, RewardMethod, Specification, Unsuitable


class Verdict(RewardMethod):
    """1/n for each of the formula's n terms that is satisfied, 0 for one that is not, paid when its interval ends.

    The memory has one flag per term: for G 1 until psi fails in the interval, for F 0 until psi holds in it.

    Args:
        pay: `deadline`, each term at the end of its own interval, or `end`, all of them at the end of the episode.

    Raises:
        Unsuitable: the formula is outside the fragment of eq. 2, or has a term F G, for which a flag is not enough.
    """

    def __init__(self, specification: Specification, *, pay: Literal["deadline", "end"] = "deadline") -> None:
        super().__init__(specification)
        terms = specification.terms
        if nested := [term for term in terms if term.kind == "FG"]:
            raise Unsuitable(f"verdict: expected terms F[a,b] psi and G[a,b] psi, got {nested[0].formula}")
        self.memory_size = len(terms)
        self._holds = [specification.holds(term.psi) for term in terms]
        self._always = np.array([term.kind == "G" for term in terms])
        self._begin, self._end = np.array([(term.start, term.end) for term in terms]).T
        self._due = self._end if pay == "deadline" else np.full(len(terms), specification.steps)

    @property
    def floor(self) -> float:
        """No flag is worth less than nothing."""
        return 0.0

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The flags after the first sample, (N, n)."""
        fresh = np.tile(self._always.astype(float), (len(signals), 1))
        return self._updated(fresh, signals, t)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """The rewards (h, N) for the flags that are due, in [0, 1], and the flags at the last sample, (N, n)."""
        rewards = np.empty((len(samples) - 1, len(t)))
        for i in range(1, len(samples)):
            memory = self._updated(memory, samples[i], t + i)
            rewards[i - 1] = (memory * (self._due == (t + i)[:, None])).mean(axis=1)
        return rewards, memory

    def inputs(self, memory: Array) -> Array:
        """The flags as -1 and 1."""
        return 2 * memory - 1

    def _updated(self, flags: Array, signals: Array, t: Integers) -> Array:
        now = (self._begin <= t[:, None]) & (t[:, None] <= self._end)
        true = np.stack([holds(signals) for holds in self._holds], axis=1)
        return np.where(now, np.where(self._always, flags * true, np.maximum(flags, true)), flags)
