"""funnel: robustness kept above a bound that rises in time (Saxena et al., eq. 5, 11, 12, Table I, Algorithm 1)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from stlbench.contract import Array, Integers, RewardMethod, Specification, Unsuitable
from stlbench.contract.presentation import Band
from stlbench.stl import Term
from stlbench_methods import formula_parts

Variant = Literal["paper", "code"]
Shape = Literal["linear", "clipped", "normalised"]


@dataclass(frozen=True)
class Curve:
    """gamma(t) = (gamma_0 - gamma_inf) exp(-l (t - t0)) + gamma_inf, with gamma(t_star) = rho_max."""

    gamma_0: float
    gamma_inf: float
    rho_max: float
    t0: float
    t_star: float

    @property
    def rate(self) -> float:
        """l = ln((gamma_0 - gamma_inf) / (rho_max - gamma_inf)) / (t_star - t0) a step; infinite for t_star = t0.

        If psi holds everywhere gamma_0 < rho_max, and the funnel would have to widen: the rate is 0 then.
        """
        fall = math.log((self.gamma_0 - self.gamma_inf) / (self.rho_max - self.gamma_inf))
        if fall <= 0:
            return 0.0
        return fall / (self.t_star - self.t0) if self.t_star > self.t0 else math.inf

    def __call__(self, t: Array) -> Array:
        """gamma at times t in steps, t >= t0. An infinite rate gives the limit gamma_inf throughout."""
        if math.isinf(self.rate):
            return np.full(np.shape(t), self.gamma_inf)
        return (self.gamma_0 - self.gamma_inf) * np.exp(-self.rate * (t - self.t0)) + self.gamma_inf


class Funnel(RewardMethod):
    """Robustness inside a funnel: r'(s, t) = rho_psi(s) + gamma(t) - rho_max, the minimum over the active terms.

    Args:
        variant: the funnel of G[0,b], for which Table I gives t* = 0 and so l = 1/0. `paper`: the limit, gamma =
            gamma_inf throughout. `code`: t* in the middle of the interval, as in the authors' program.
        activity: which terms are active at a time: `last-deadline` or `literal`; see `stlbench_methods.formula_parts`.
        shape: `linear`, eq. 12. `clipped`: min(0, r'), what Algorithm 1 says literally. `normalised`:
            -log(1 + (rho_max - rho) / gamma(t)), the distance from rho_max in units of the funnel's width.
        t_star: where in its window, 0 = first step, 1 = last, the lower bound of an F or F G term reaches 0.
        ginf: gamma_inf, in the unit of the predicates, in (0, min(gamma_0, rho_max)); 0.01 is the one value that
            the paper states.

    Raises:
        Unsuitable: the formula is outside the fragment of eq. 2, a term cannot fail, or `ginf` is outside its range.
    """

    preference = MappingProxyType({"other": 1, "recurring": 2})

    def __init__(
        self,
        specification: Specification,
        *,
        variant: Variant = "paper",
        activity: formula_parts.Activity = "last-deadline",
        shape: Shape = "linear",
        t_star: Annotated[float, Field(ge=0, le=1)] = 1.0,
        ginf: Annotated[float, Field(gt=0)] = 0.01,
    ) -> None:
        super().__init__(specification)
        terms = specification.terms
        begins = formula_parts.active_from(terms, activity)
        self.curves = tuple(
            self._curve(term, t0, variant, t_star, ginf) for term, t0 in zip(terms, begins, strict=True)
        )
        self.active = formula_parts.active_table(terms, specification.steps, activity)
        rewards = [self._term_reward(term, curve, shape) for term, curve in zip(terms, self.curves, strict=True)]
        self._least = formula_parts.least_active(rewards, self.active)
        self._clip = shape == "clipped"
        least = formula_parts.least_paid(np.array([self._worst(curve, shape) for curve in self.curves]), self.active)
        self.floor = min(0.0, least) if self._clip else least
        widest = max(curve.gamma_0 for curve in self.curves)
        self.scale = math.log1p(widest / ginf) if shape == "normalised" else widest

    def arrival(self, signals: Array, t: Integers) -> Array:
        rewards = self._least(signals, t)
        return np.minimum(rewards, 0.0) if self._clip else rewards

    def describe(self) -> Mapping[str, Any]:
        terms = self.specification.terms
        return {
            f"{term.kind}[{term.start},{term.end}]": (
                f"gamma_0 {curve.gamma_0:.4g}, gamma_inf {curve.gamma_inf:.4g}, rho_max {curve.rho_max:.4g}, "
                f"t0 {curve.t0:g}, t* {curve.t_star:g}, l {curve.rate:.4g}"
            )
            for term, curve in zip(terms, self.curves, strict=True)
        }

    def band(self) -> Sequence[Band]:
        bands = []
        for term, curve in zip(self.specification.terms, self.curves, strict=True):
            t = np.arange(curve.t0, term.end + 1, dtype=np.float64)
            bands.append(Band(term, int(curve.t0), curve.rho_max - curve(t), np.full(len(t), curve.rho_max)))
        return tuple(bands)

    def _curve(self, term: Term, t0: int, variant: Variant, t_star: float, ginf: float) -> Curve:
        rho_min, rho_max = formula_parts.bounded_range(self.specification, term.psi, term.formula)
        gamma_0 = rho_max - rho_min
        if ginf > min(gamma_0, rho_max) - 1e-6:  # bounds are rounded outwards
            raise Unsuitable(
                f"funnel: ginf = {ginf:g} must be less than min(gamma_0, rho_max) = {min(gamma_0, rho_max):.4g} "
                f"of {term.formula}"
            )
        return Curve(gamma_0, ginf, rho_max, t0, _t_star(term, t0, variant, t_star))

    def _term_reward(self, term: Term, curve: Curve, shape: Shape) -> formula_parts.ValueAt:
        margin = self.specification.margin(term.psi)
        gamma = self._width(curve)
        if shape == "normalised":
            return lambda s, t: -np.log1p((curve.rho_max - margin(s)) / formula_parts.at(gamma, t))
        offset = gamma - curve.rho_max
        return lambda s, t: margin(s) + formula_parts.at(offset, t)

    def _worst(self, curve: Curve, shape: Shape) -> Array:
        """The term's reward if psi is least in the box of the signals, at each sample: (T + 1,)."""
        gamma = self._width(curve)
        return -np.log1p(curve.gamma_0 / gamma) if shape == "normalised" else gamma - curve.gamma_0

    def _width(self, curve: Curve) -> Array:
        """gamma at each sample, (T + 1,): its value at t0 before t0."""
        return curve(np.maximum(np.arange(self.specification.steps + 1), curve.t0))


def _t_star(term: Term, t0: int, variant: Variant, share: float) -> float:
    """The time at which the funnel's lower bound reaches 0 (Table I)."""
    if term.kind == "F":
        return term.a + share * (term.b - term.a)
    if term.kind == "FG":
        return term.a + term.c2 + share * (term.c1 - term.a)
    return (t0 + term.b) / 2 if variant == "code" and term.a == t0 else term.a
