"""tau-mdp: the state is the last tau samples (Aksaray, Jones, Kong, Schwager, Belta, CDC 2016)."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Unsuitable
from stlbench_methods.formula_parts import EXTENSION, bounded_range, from_first_read, refuse_past


class TauMdp(RewardMethod):
    """The policy sees the last tau samples, tau = horizon(phi) + 1, and is paid for the robustness of phi on them.

    The formula is read as Phi = F[0,Te] phi or G[0,Te] phi, from the task's nested form if it has one. A formula
    of another form, such as a conjunction of absolute intervals, is all phi, and tau is its whole horizon: that is
    the intractability that Saxena et al. describe. Phi may read nothing before a later sample, as G[300,310] psi. The
    history then has the samples that it reads, 11 here, and earns 0 until it lies in steps 300 and later.

    The reward of a history z, rho in units of rho_max, is -exp(-beta rho(z, phi)) for G and exp(beta rho(z, phi))
    for F. Its sum approximates beta times the minimum or maximum over time (log-sum-exp). In the probability form the
    indicator of phi stands in place of rho.

    Args:
        form: `robustness` or `probability`.
        beta: sharpness of the approximation; rho_max / beta is the robustness that matters.
        every: the policy sees every so many-th sample of the history, counted back from the newest; the reward is for
            all of them. A variant for tasks that hold actions: with `hold` as its value, one sample for each decision.

    Raises:
        Unsuitable: no sample satisfies phi with positive robustness, so rho_max is no unit; or rho_max is so small
            beside rho_min, or `beta` so large, that the reward overflows.
    """

    def __init__(
        self,
        specification: Specification,
        *,
        form: Literal["robustness", "probability"] = "robustness",
        beta: Annotated[float, Field(gt=0)] = 1.0,
        every: Annotated[int, Field(gt=0)] = 1,
    ) -> None:
        super().__init__(specification)
        formula = specification.formula if specification.nested is None else specification.nested
        refuse_past(formula)
        self.outer, phi = _outer(formula)
        if phi is formula:
            self.extension = EXTENSION
        first, self.phi = from_first_read(phi) if phi is not formula else (0, phi)
        self.tau = stl.horizon(self.phi) + 1
        self.memory_size = self.tau * len(specification.signals)
        self._paid_from = first + self.tau - 1 if first else 0
        self._sign = 1.0 if self.outer == "F" else -1.0
        low, high = _range(stl.negations_inside(self.phi), specification)
        if form == "robustness" and high <= 0:
            raise Unsuitable(f"tau-mdp: {self.phi} cannot be satisfied robustly, its rho_max is {high:.4g}")
        compiled = stl.holds_trace if form == "probability" else stl.margin_trace
        self._value = compiled(self.phi, specification.signals)
        self._beta = self._sign * (beta if form == "probability" else beta / high)
        extremes = (0.0, 1.0) if form == "probability" else (low, high)
        with np.errstate(over="ignore", invalid="ignore"):
            ends = [float(np.exp(self._beta * value)) for value in extremes]
        if not all(map(math.isfinite, ends)):
            raise Unsuitable(f"tau-mdp: from robustness {low:.4g} to {high:.4g} of {self.phi}, its exp overflows")
        self.scale = max(ends)
        least = self._sign * ends[0]
        self.floor = min(0.0, least) if first else least  # the first samples pay 0
        self._shown = np.arange(self.tau)[::-every][::-1]  # backwards, so that the newest sample is always among them
        self._middle = (np.array(specification.high) + specification.low) / 2
        self.input_size = len(self._shown) * len(self._middle)
        self._half = (np.array(specification.high) - specification.low) / 2

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        return np.tile(signals, self.tau)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """The histories in the memory have their oldest sample first."""
        rows = len(memory)
        history = memory.reshape(rows, self.tau, -1)
        path = np.concatenate([history[:, 1:], samples[1:].transpose(1, 0, 2)], axis=1)  # (N, tau - 1 + h, k)
        rewards = self._sign * np.exp(self._beta * self._value(path)).T
        if self._paid_from:
            rewards[t + np.arange(1, len(samples))[:, None] < self._paid_from] = 0.0
        return rewards, path[:, -self.tau :].reshape(rows, -1)

    def inputs(self, memory: Array) -> Array:
        history = memory.reshape(len(memory), self.tau, -1)
        shown = history if len(self._shown) == self.tau else history[:, self._shown]
        return ((shown - self._middle) / self._half).reshape(len(memory), -1)

    def describe(self) -> Mapping[str, Any]:
        return {"outer operator": self.outer, "phi": str(self.phi), "tau": self.tau}


def _outer(formula: stl.Formula) -> tuple[Literal["F", "G"], stl.Formula]:
    if isinstance(formula, stl.Eventually) and formula.a == 0:
        return "F", formula.arg
    if isinstance(formula, stl.Always) and formula.a == 0:
        return "G", formula.arg
    return "G", formula


def _range(formula: stl.Formula, specification: Specification) -> tuple[float, float]:
    """Bounds of the robustness of a formula, with negations inside, whose samples may be anywhere in the box."""
    if not stl.is_temporal(formula):
        return bounded_range(specification, formula, specification.formula)
    match formula:
        case stl.Always(_, _, arg) | stl.Eventually(_, _, arg):
            return _range(arg, specification)
        case stl.Until(0, _, _, right) | stl.Release(0, _, _, right):  # the left operand need not hold at all
            return _range(right, specification)
        case stl.Until(_, _, left, right) | stl.Release(_, _, left, right):
            parts: tuple[stl.Formula, ...] = (left, right)
        case stl.And(parts) | stl.Or(parts):
            pass
    lows, highs = zip(*(_range(part, specification) for part in parts), strict=True)
    return (max(lows), max(highs)) if isinstance(formula, stl.Or | stl.Release) else (min(lows), min(highs))
