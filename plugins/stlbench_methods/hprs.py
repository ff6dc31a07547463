"""hprs: hierarchical potential-based reward shaping (Berducci, Aguilar, Nickovic, Grosu, arXiv 2110.02792)."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth, Unsuitable
from stlbench.stl import Term
from stlbench_methods.formula_parts import bounded_range, truths


class Hprs(RewardMethod):
    """1 at each sample of the target, and potentials in which safety comes before the target.

    G psi is safety, F psi and F G psi are targets; their intervals are not looked at, as the source is untimed. The
    reward of a transition is 1[target(s')] + gamma Phi(s') - Phi(s), Phi = Phi_S + Phi_T, with

    - Phi_S = sum_i 1[safe_i],
    - Phi_T = prod_i 1[safe_i] n(target), n = clip(1 - h / h_min, 0, 1), h the robustness of the target and h_min its
      least over the box of the signals: for x >= c that is the source's (x - x_min) / (c - x_min).

    The source's third potential, of comfort, is 0: no term of a formula is a wish. The last transition has no shaping.

    An extension: several targets are taken in the order of their deadlines. The one of now counts, and for each that is
    done Phi_T has 1 more where all is safe. F psi is done at a sample of psi, F[a,c1] G[c2,b] psi after b - c2 + 1
    samples of it in a row. The number that are done, and how long the one of now has held, are the method's memory.

    Args:
        later: what G[a,b] psi with a > 0 is. `safety`, as every G. `target`: it is read as F G psi, which is to hold
            for b - a + 1 samples.
        variant: `paper`, as above. `auto-shaping`, as that program has it: Phi_T = 0, since its product begins with 0,
            and the last transition is shaped, as a time limit is no end there.
        violation: what a sample is that is not safe. `stays`: all goes on. `ends`: all is over, as the environments of
            the source end an episode there; the transition to it has no shaping, and nothing is paid after it.
        gamma: 1 in the sources.

    Raises:
        Unsuitable: the formula is outside the fragment of eq. 2, or has no target.
    """

    def __init__(
        self,
        specification: Specification,
        *,
        later: Literal["safety", "target"] = "safety",
        variant: Literal["paper", "auto-shaping"] = "paper",
        violation: Literal["stays", "ends"] = "stays",
        gamma: Annotated[float, Field(gt=0, le=1)] = 1.0,
    ) -> None:
        super().__init__(specification)
        self._safety, self._targets = _divided(specification.terms, later)
        self._safe = [specification.holds(term.psi) for term in self._safety]
        self._at = [specification.holds(term.psi) for term in self._targets]
        self._near = [specification.margin(term.psi) for term in self._targets]
        self._least = [bounded_range(specification, term.psi, term.formula)[0] for term in self._targets]
        self._needed = np.array([term.length for term in self._targets])
        self._gamma, self._shaped = gamma, variant == "auto-shaping"
        self._weight = float(variant == "paper")
        self.input_size = 2 if len(self._targets) > 1 else 0
        self.can_end = violation == "ends"
        self.memory_size = self.input_size + int(self.can_end)
        self.extension = f"intervals are not looked at{'; several targets' if self.input_size else ''}"
        self.floor = -(len(self._safety) + self._weight * len(self._targets))
        self.scale = 1.0 - self.floor  # at most the target and the whole potential are paid at once

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The memory (N, m): no target is done before the first sample, which may reach one and violates nothing."""
        counted = self._progress(truths(self._at, signals[None]), np.zeros((len(signals), self.input_size)))[1]
        return np.concatenate([counted, np.zeros((len(signals), self.memory_size - self.input_size))], axis=1)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        at, safe = truths(self._at, samples), truths(self._safe, samples)
        done, after = self._progress(at[:, 1:], memory[:, : self.input_size])
        potential = self._potential(samples, safe, done)
        shaping = self._gamma * potential[1:] - potential[:-1]
        if not self._shaped:
            shaping[t + np.arange(len(shaping))[:, None] == self.specification.steps - 1] = 0.0
        reached = np.take_along_axis(at[:, 1:], done[None, :-1], axis=0)[0]
        if not self.can_end:
            return reached + shaping, after
        over = np.logical_or.accumulate(np.concatenate([self.over(memory)[None], ~safe[:, 1:].all(axis=0)]))
        rewards = np.where(over[:-1], 0.0, reached + np.where(over[1:], 0.0, shaping))
        return rewards, np.column_stack([after, over[-1]])

    def over(self, memory: Array) -> Truth:
        over: Truth = memory[:, -1] > 0
        return over

    def inputs(self, memory: Array) -> Array:
        """The share of the targets that is done, and that of the samples that the target of now needs: in [0, 1]."""
        if not self.input_size:
            return memory[:, :0]
        done = memory[:, 0].astype(np.int64)
        return np.stack([done / (len(self._targets) - 1), memory[:, 1] / self._needed[done]], axis=1)

    def describe(self) -> Mapping[str, Any]:
        named = {"safety": self._safety, "targets": self._targets}
        return {kind: [str(term.formula) for term in terms] for kind, terms in named.items()}

    def _potential(self, samples: Array, safe: Truth, done: Integers) -> Array:
        """Phi at the samples, with so many targets `done` (h + 1, N); `safe` (terms, h + 1, N) is of safety."""
        near = np.stack([_nearness(h(samples), low) for h, low in zip(self._near, self._least, strict=True)])
        now = np.take_along_axis(near, done[None], axis=0)[0]
        potential: Array = safe.sum(axis=0) + self._weight * safe.all(axis=0) * (done + now)
        return potential

    def _progress(self, at: Truth, memory: Array) -> tuple[Integers, Array]:
        """The current target before and after each sample, (h + 1, N), the memory; `at` (targets, h, N) are truths."""
        _, held, rows = at.shape
        now = np.zeros((held + 1, rows), dtype=np.int64)
        if not self.input_size:
            return now, memory
        last, row, count = len(self._targets) - 1, np.arange(rows), memory[:, 1]
        now[0] = memory[:, 0]
        for i in range(held):
            needed = self._needed[now[i]]
            count = np.where(at[now[i], i, row], np.minimum(count + 1, needed), 0)
            over = (count == needed) & (now[i] < last)
            now[i + 1], count = now[i] + over, np.where(over, 0, count)
        return now, np.stack([now[-1].astype(np.float64), count], axis=1)


def _divided(terms: Sequence[Term], later: str) -> tuple[list[Term], list[Term]]:
    """Safety, and the targets in the order of their deadlines."""
    safety = [term for term in terms if term.kind == "G" and (later == "safety" or term.a == 0)]
    targets = sorted((term for term in terms if term not in safety), key=lambda term: term.end)
    if not targets:
        late = any(term.a > 0 for term in terms)
        hint = "; hprs[later=target] takes G[a,b] with a > 0 for one" if late else ""
        raise Unsuitable(f"hprs: it needs a target, F or F G, and the formula has terms G alone{hint}")
    return safety, targets


def _nearness(h: Array, least: float) -> Array:
    """n: 1 if the robustness is not negative, 0 if it is the least of the box."""
    return np.clip(1 - h / least, 0.0, 1.0) if least < 0 else np.ones_like(h)
