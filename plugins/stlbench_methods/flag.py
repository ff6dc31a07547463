"""flag: F-MDP, a flag a term instead of a history (Venkataraman, Aksaray, Seiler, L4DC 2020)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Unsuitable

__all__ = ["Flag"]


class Flag(RewardMethod):
    """One flag a term, updated from the predicate alone; the reward is for the truth of the flags.

    Where the task (or its nested form) reads (F|G)[0,Te] phi, with phi an and/or of F[0,w] psi and G[0,w] psi: integer
    counters over windows of w + 1 samples, sat = and/or of their verdicts, and the reward exp(beta (sat - 1)) for an
    outer F, -exp(-beta sat) for an outer G. Both are in [-1, 1]: exp(beta sat) is scaled by exp(-beta).

    Any other formula of the fragment of eq. 2 has no outer operator and absolute intervals, which that method does
    not treat. The extension: F[a,b] psi has a flag latched once psi held in [a,b]; the flag of G[a,b] psi is 1 until
    psi fails in [a,b]; F[a,c1] G[c2,b] psi counts samples of psi and latches at a full window. Each is paid as above,
    F or G, on its own interval; where intervals overlap, the sum.

    Args:
        beta: 50 in the sources; at that value the reward is 0 or 1 in size.

    Raises:
        Unsuitable: the formula has neither form.
    """

    def __init__(self, specification: Specification, *, beta: Annotated[float, Field(gt=0)] = 50.0) -> None:
        super().__init__(specification)
        nested = specification.nested or specification.formula
        reader = _Nested if _is_nested(nested) else _Absolute
        self._flags: _Flags = reader(nested if reader is _Nested else specification.formula, specification, beta)
        self.memory_size = len(self._flags.full)
        self.scale = self._flags.scale

    def start(self, signals: Array) -> Array:
        """The flags after the first sample, (N, m); they were 0 before it (1 for the absolute G)."""
        zero = np.zeros(len(signals), dtype=np.int64)
        return self._flags.update(signals, zero, np.tile(self._flags.initial, (len(signals), 1)))

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        """The reward (N,) for the flags that include s_{t+1}, and those flags (N, m)."""
        flags = self._flags.update(next_signals, t + 1, memory)
        return self._flags.reward(flags, t + 1), flags

    def inputs(self, memory: Array) -> Array:
        """Each flag over its full value: in [0, 1]."""
        return memory / self._flags.full

    def describe(self) -> Mapping[str, Any]:
        """Which form was taken, and each flag's full count."""
        return {"form": self._flags.form, "flags": [int(value) for value in self._flags.full]}


class _Flags(ABC):
    """A set of flags: `initial` and `full` values (m,), their update by a sample, and the reward of their values."""

    form: str
    initial: Array
    full: Array
    scale: float = 1.0

    @abstractmethod
    def update(self, signals: Array, t: Integers, flags: Array) -> Array: ...

    @abstractmethod
    def reward(self, flags: Array, t: Integers) -> Array: ...


def _count_eventually(flag: Array, holds: NDArray[np.bool_], full: float) -> Array:
    """Full at a sample where psi holds, one less at each other: positive iff psi held among the last `full`."""
    return np.where(holds, full, np.maximum(flag - 1, 0))


def _count_always(flag: Array, holds: NDArray[np.bool_], full: float) -> Array:
    """One more at each sample where psi holds, 0 at any other: full iff psi held at each of the last `full`."""
    return np.where(holds, np.minimum(flag + 1, full), 0)


class _Nested(_Flags):
    """(F|G)[0,Te] phi, as in the source."""

    form = "outer operator over windows"

    def __init__(self, formula: stl.Formula, specification: Specification, beta: float) -> None:
        assert isinstance(formula, stl.Always | stl.Eventually)
        self._outer_f, self._beta, self._phi = isinstance(formula, stl.Eventually), beta, formula.arg
        self._inner = _windows(formula.arg)
        self._holds = [specification.holds(window.arg) for window in self._inner]
        self.full = np.array([window.b + 1.0 for window in self._inner])
        self.initial = np.zeros_like(self.full)

    def update(self, signals: Array, t: Integers, flags: Array) -> Array:
        after = np.empty_like(flags)
        for i, (window, holds) in enumerate(zip(self._inner, self._holds, strict=True)):
            count = _count_eventually if isinstance(window, stl.Eventually) else _count_always
            after[:, i] = count(flags[:, i], holds(signals), self.full[i])
        return after

    def reward(self, flags: Array, t: Integers) -> Array:
        verdicts = {
            id(window): (flags[:, i] > 0 if isinstance(window, stl.Eventually) else flags[:, i] == self.full[i])
            for i, window in enumerate(self._inner)
        }
        return _paid(_truth(self._phi, verdicts).astype(np.float64), self._outer_f, self._beta)


@dataclass(frozen=True)
class _Part:
    """One term of the extension and the columns of its flags."""

    term: stl.Term
    column: int


class _Absolute(_Flags):
    """A conjunction of terms with absolute intervals: the extension to eq. 2."""

    form = "absolute intervals (extension)"

    def __init__(self, formula: stl.Formula, specification: Specification, beta: float) -> None:
        self._beta, initial, full = beta, list[float](), list[float]()
        self._parts: list[_Part] = []
        for term in specification.terms:
            self._parts.append(_Part(term, len(full)))
            initial += {"F": [0.0], "G": [1.0], "FG": [0.0, 0.0]}[term.kind]
            full += [1.0] if term.kind != "FG" else [1.0, term.b - term.c2 + 1.0]
        self._holds = [specification.holds(part.term.psi) for part in self._parts]
        self.initial, self.full = np.array(initial), np.array(full)
        self.scale = float(self._active(np.arange(specification.steps + 1)).sum(axis=1).max())

    def _active(self, t: Integers) -> NDArray[np.bool_]:
        return np.stack([(part.term.start <= t) & (t <= part.term.end) for part in self._parts], axis=1)

    def update(self, signals: Array, t: Integers, flags: Array) -> Array:
        after = flags.copy()
        active = self._active(t)
        for i, (part, holds) in enumerate(zip(self._parts, self._holds, strict=True)):
            now, true, at = active[:, i], holds(signals), part.column
            if part.term.kind == "G":
                after[:, at] = np.where(now & ~true, 0, flags[:, at])
            elif part.term.kind == "F":
                after[:, at] = np.where(now & true, 1, flags[:, at])
            else:
                after[:, at + 1] = np.where(now, _count_always(flags[:, at + 1], true, self.full[at + 1]), 0)
                after[:, at] = np.where(after[:, at + 1] == self.full[at + 1], 1, flags[:, at])
        return after

    def reward(self, flags: Array, t: Integers) -> Array:
        columns = [part.column for part in self._parts]
        outer_f = np.array([part.term.kind != "G" for part in self._parts])
        return np.where(self._active(t), _paid(flags[:, columns], outer_f, self._beta), 0).sum(axis=1)


def _paid(sat: Array, outer_f: bool | NDArray[np.bool_], beta: float) -> Array:
    """exp(beta (sat - 1)) for F, -exp(-beta sat) for G."""
    return np.where(outer_f, np.exp(beta * (sat - 1)), -np.exp(-beta * sat))


def _is_nested(formula: stl.Formula) -> bool:
    if not (isinstance(formula, stl.Always | stl.Eventually) and formula.a == 0):
        return False
    try:
        windows = _windows(formula.arg)
        return not any(stl.is_temporal(window.arg) for window in windows)
    except Unsuitable:
        return False


def _windows(phi: stl.Formula) -> list[stl.Always | stl.Eventually]:
    """The F[0,w] psi and G[0,w] psi that `phi` is an and/or of."""
    match phi:
        case stl.And() | stl.Or():
            return [window for arg in phi.args for window in _windows(arg)]
        case (stl.Always() | stl.Eventually()) if phi.a == 0:
            return [phi]
        case _:
            raise Unsuitable(f"flag: expected F[0,w] or G[0,w] of a predicate, got {phi}")


def _truth(phi: stl.Formula, verdicts: Mapping[int, NDArray[np.bool_]]) -> NDArray[np.bool_]:
    match phi:
        case stl.And():
            return np.logical_and.reduce([_truth(arg, verdicts) for arg in phi.args])
        case stl.Or():
            return np.logical_or.reduce([_truth(arg, verdicts) for arg in phi.args])
        case _:
            return verdicts[id(phi)]
