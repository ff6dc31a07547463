"""The online violation and satisfaction causation distances by their published recursion, word for word and slow.

`up(phi, tau)` says how far the newest sample b is from causing a violation of phi at step tau, `low` the same of its
satisfaction; `upper`, `lower` bound the robustness of phi at tau over all continuations of the samples up to b. For the
newest sample alone an atom has a distance. Values are arrays, one number per trace.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stlbench import stl
from stlbench.contract import Array


@dataclass(frozen=True)
class Recursion:
    """Distances after the samples 0..b of traces (N, T + 1, k)."""

    traces: Array
    names: tuple[str, ...]
    b: int

    def up(self, phi: stl.Formula, tau: int) -> Array:
        match phi:
            case stl.Not(arg):
                return -self.low(arg, tau)
            case stl.And((p, q)):
                return np.minimum(self.up(p, tau), self.up(q, tau))
            case stl.Or((p, q)):
                one = np.maximum(self.up(p, tau), self.upper(q, tau))
                return np.minimum(one, np.maximum(self.upper(p, tau), self.up(q, tau)))
            case stl.Always(a, b, p):
                return self._least([self.up(p, t) for t in self._seen(tau, a, b)])
            case stl.Eventually(a, b, p):
                least = self._least([self.up(p, t) for t in self._seen(tau, a, b)])
                return np.maximum(least, self.upper(phi, tau))
            case _:
                return self._margin(phi, tau) if tau == self.b else self._all(math.inf)

    def low(self, phi: stl.Formula, tau: int) -> Array:
        match phi:
            case stl.Not(arg):
                return -self.up(arg, tau)
            case stl.Or((p, q)):
                return np.maximum(self.low(p, tau), self.low(q, tau))
            case stl.And((p, q)):
                one = np.minimum(self.low(p, tau), self.lower(q, tau))
                return np.maximum(one, np.minimum(self.lower(p, tau), self.low(q, tau)))
            case stl.Eventually(a, b, p):
                return -self._least([-self.low(p, t) for t in self._seen(tau, a, b)])
            case stl.Always(a, b, p):
                greatest = -self._least([-self.low(p, t) for t in self._seen(tau, a, b)])
                return np.minimum(greatest, self.lower(phi, tau))
            case _:
                return self._margin(phi, tau) if tau == self.b else self._all(-math.inf)

    def upper(self, phi: stl.Formula, tau: int) -> Array:
        match phi:
            case stl.Not(arg):
                return -self.lower(arg, tau)
            case stl.And((p, q)):
                return np.minimum(self.upper(p, tau), self.upper(q, tau))
            case stl.Or((p, q)):
                return np.maximum(self.upper(p, tau), self.upper(q, tau))
            case stl.Always(a, b, p):
                return np.min([self.upper(p, t) for t in range(tau + a, tau + b + 1)], axis=0)
            case stl.Eventually(a, b, p):
                return np.max([self.upper(p, t) for t in range(tau + a, tau + b + 1)], axis=0)
            case _:
                return self._margin(phi, tau) if tau <= self.b else self._all(math.inf)

    def lower(self, phi: stl.Formula, tau: int) -> Array:
        return -self.upper(_opposite(phi), tau)

    def _margin(self, phi: stl.Formula, tau: int) -> Array:
        return stl.margin(phi, self.names)(self.traces[:, tau])

    def _seen(self, tau: int, a: int, b: int) -> range:
        return range(tau + a, min(tau + b, self.b) + 1)

    def _least(self, values: list[Array]) -> Array:
        return np.min([self._all(math.inf), *values], axis=0)

    def _all(self, value: float) -> Array:
        return np.full(len(self.traces), value)


def _opposite(phi: stl.Formula) -> stl.Formula:
    match phi:
        case stl.Not(arg):
            return arg
        case stl.And((p, q)):
            return stl.Or((_opposite(p), _opposite(q)))
        case stl.Or((p, q)):
            return stl.And((_opposite(p), _opposite(q)))
        case stl.Always(a, b, p):
            return stl.Eventually(a, b, _opposite(p))
        case stl.Eventually(a, b, p):
            return stl.Always(a, b, _opposite(p))
        case _:
            assert isinstance(phi, stl.Predicate)
            turned = {"<=": ">", ">=": "<", "<": ">=", ">": "<="}
            return stl.Predicate(turned[phi.op], phi.left, phi.right)
