"""Quantitative semantics: how the values of parts become that of the whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from stlbench.stl.recorded.folds import Fold, GeometricLeast, Least, RootLeast, SoftLeast, WeightedLeast

#: the semantics that there are, see `semantics`
SemanticsName: TypeAlias = Literal["classic", "lse", "gilpin", "agm", "gmsr"]


@dataclass(frozen=True)
class Semantics:
    """A minimum-like and a maximum-like function.

    Attributes:
        least: for `&` and G.
        greatest: for `|`.
        eventually: for F, and the choice of the step in an until.
        divided: whether it is made for predicates of about [-1, 1]: each predicate is a leaf of its own then.
    """

    least: Fold
    greatest: Fold
    eventually: Fold
    divided: bool


def semantics(name: SemanticsName, sharpness: float = 10.0) -> Semantics:
    """One of the published semantics.

    Args:
        name: `classic`, minimum and maximum; `lse`, log-sum-exp for both (Pant, Abbas, Mangharam, CCTA 2017); `gilpin`,
            log-sum-exp for the minimum and a weighted mean for the maximum (Gilpin, Kurtz, Lin, L-CSS 2020); `agm`,
            arithmetic-geometric mean (Mehdipour, Vasile, Belta 2019); `gmsr`, generalised mean (Uzun, Elango, Garoche,
            Acikmese, arXiv 2405.10996), with its eps = 1e-8 and p = 1.
        sharpness: b of `lse` and `gilpin`, > 0. For n values, the minimum of both is up to log(n) / b too low. The
            maximum of `lse` is up to log(n) / b too high: its sign can be wrong either way. That of `gilpin` is up to
            log(n) / b too low, so its value is never above the robustness: positive means satisfied.
    """
    if not sharpness > 0:
        raise ValueError(f"the sharpness is more than 0, got {sharpness}")
    soft, weighted = SoftLeast(sharpness=sharpness), WeightedLeast(sharpness=sharpness)
    folds: dict[str, tuple[Fold, Fold]] = {
        "classic": (Least(), Least()),
        "lse": (soft, soft),
        "gilpin": (soft, weighted),
        "agm": (GeometricLeast(), GeometricLeast()),
        "gmsr": (RootLeast(), RootLeast()),
    }
    if name not in folds:
        raise ValueError(f"there are the semantics {', '.join(folds)}, not {name!r}")
    least, greatest = folds[name][0], folds[name][1].mirrored()
    return Semantics(least, greatest, greatest, divided=name != "classic")
