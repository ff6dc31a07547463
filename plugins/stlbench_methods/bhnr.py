"""bhnr: the robustness of the newest samples alone (Balakrishnan, Deshmukh, IROS 2019)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth
from stlbench_methods.formula_parts import Margins, Sharpness, Truths, Values, scaled
from stlbench_methods.progress import Known, Outer, Window, certain, outer_windows

Reading: TypeAlias = Literal["classic", "lse", "gilpin", "agm", "gmsr", "filtering", "filtering-sum"]
_SHORT = 2  # a block of this many samples, or fewer, is paid nothing


class Bhnr(RewardMethod):
    """The formula's value on the last samples, as if they were all there is (bounded horizon nominal robustness).

    The source is for formulas without absolute times. Here an outer F[a,b] phi or G[a,b] phi counts at the steps which
    it observes. It is then F phi or G phi of the last samples, without those before its first step. Windows inside phi
    are cut at the newest sample. The reward is the and/or of those that count, and 0 if none does.

    The policy sees the margins, or truths, of the last samples.

    Args:
        mode: `sliding` pays the value of the last `window` samples at every step. `block` divides an episode into
            blocks of so many samples. In the source each transition of a block is paid the block's value, in
            hindsight; here their sum is paid at the block's last transition, and 0 before it. An operator that observes
            one sample counts in that sample's block. Blocks of 2 samples or fewer are worth 0.
        window: samples. The source has blocks of 15, `auto-shaping` the last 10, `reward_shaping` a twentieth of the
            episode.
        semantics: `classic` is the robustness; for `lse`, `gilpin`, `agm` and `gmsr` see `stlbench.stl.semantics`.
            `filtering` takes truths, 1 and 0, for margins, and a mean for F; `filtering-sum` a sum, as the source's
            program.
        sharpness: of `lse` and `gilpin`.

    Raises:
        Unsuitable: an operator looks back, or a part of the formula has no bounds.
    """

    def __init__(
        self,
        specification: Specification,
        *,
        mode: Literal["sliding", "block"] = "sliding",
        window: Annotated[int, Field(ge=1)] = 10,
        semantics: Reading = "classic",
        sharpness: Sharpness = 10.0,
    ) -> None:
        super().__init__(specification)
        values = _values(specification, semantics, sharpness)
        outer, self._join = outer_windows(specification.formula, values.semantics)
        self._window, self._blocks = window, mode == "block"
        self._parts = [NewestSamples(each, specification, values, window, self._blocks) for each in outer]
        self.memory_size = sum(part.size for part in self._parts)
        ends = [np.array(part.ends) for part in self._parts]
        # Each part may count alone, so the bounds are those of the parts and of the whole.
        low, high = np.stack([*ends, self._join([certain(each) for each in ends]).value], axis=1)
        most = window if self._blocks else 1
        self.floor = min(0.0, float(low.min())) * most
        self.scale = max(float(high.max()) * most, -self.floor)

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        return np.concatenate([part.begin(signals) for part in self._parts], axis=1)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        paths = [part.path(samples[1:], own) for part, own in self._split(memory)]
        rewards = np.stack([self._paid(paths, i, t + i) for i in range(1, len(samples))])
        return rewards, np.concatenate([path[:, -self._window :].reshape(len(t), -1) for path in paths], axis=1)

    def inputs(self, memory: Array) -> Array:
        return np.concatenate([part.inputs(own) for part, own in self._split(memory)], axis=1)

    def _split(self, memory: Array) -> Iterator[tuple[NewestSamples, Array]]:
        cuts = np.cumsum([part.size for part in self._parts])[:-1]
        return zip(self._parts, np.split(memory, cuts, axis=1), strict=True)

    def _paid(self, paths: list[Array], i: int, t: Integers) -> Array:
        """The pay at the i-th new sample, at steps t (N,)."""
        begin = np.maximum((t - 1) // self._window * self._window + 1 if self._blocks else t - self._window + 1, 0)
        newest = [path[:, i : i + self._window] for path in paths]
        known = [part.known(leaves, t, begin) for part, leaves in zip(self._parts, newest, strict=True)]
        value = self._join(known).value
        if not self._blocks:
            return value
        count = t - begin + 1
        over = (count == self._window) | (t == self.specification.steps)
        return np.where(over & (count > _SHORT), count * value, 0.0)


def _values(specification: Specification, semantics: Reading, sharpness: float) -> Values:
    if semantics == "filtering" or semantics == "filtering-sum":
        least = stl.Least()
        eventually = stl.Mean() if semantics == "filtering" else stl.Total()
        return Truths(specification, stl.Semantics(least, least.mirrored(), eventually, divided=False))
    return Margins(specification, stl.semantics(semantics, sharpness))


class NewestSamples(Window):
    """The value of F phi or G phi on some of the last `count` samples, whose leaves are the memory (N, size).

    It counts at the steps which it observes. In blocks an operator of one step counts up to the end of its block.
    """

    def __init__(self, outer: Outer, specification: Specification, values: Values, count: int, blocks: bool) -> None:
        super().__init__(outer, specification, values)
        self._count, self.size = count, count * len(self.phi.leaves)
        self._end = self.last + self.ahead
        self._until = -(-self._end // count) * count if blocks and self.first == self._end else self._end
        few, many = self.ends_of(1), self.ends_of(count)
        self.ends = float(min(few[0], many[0])), float(max(few[1], many[1]))

    def begin(self, signals: Array) -> Array:
        return np.tile(self.phi.read(signals), self._count)

    def path(self, samples: Array, memory: Array) -> Array:
        """The leaves of the memory and of h more samples (h, N, k), in order of time: (N, count + h, J)."""
        known = memory.reshape(len(memory), self._count, -1)
        return np.concatenate([known, self.phi.read(samples).transpose(1, 0, 2)], axis=1)

    def known(self, leaves: Array, t: Integers, begin: Integers) -> Known:
        """The value of the samples at steps `begin` (N,) to t (N,), given the leaves of the last (N, count, J)."""
        values = self.phi.clipped(leaves, self.phi_ends)
        steps = t[:, None] - np.arange(self._count)[::-1]
        read: Truth = (steps >= np.maximum(begin, self.first)[:, None]) & (steps <= self._end)
        lifted = np.where(read[..., None], self.fold.lift(values), self.fold.empty)
        counts: Truth = (t >= self.first) & (t <= self._until) & (begin <= t)
        value = self.fold.read(self.fold.merged(lifted))
        return Known(np.where(counts, value, 0.0), counts)

    def inputs(self, memory: Array) -> Array:
        return scaled(memory, *np.tile(self.bounds, self._count))
