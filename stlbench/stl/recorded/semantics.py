"""Quantitative semantics: how the values of parts become that of the whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from stlbench.stl.recorded.folds import Fold, GeometricLeast, Least, RootLeast, SoftLeast

#: the semantics that there are, see `semantics`
SemanticsName: TypeAlias = Literal["classic", "lse", "agm", "gmsr"]


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
        name: `classic`, minimum and maximum; `lse`, log-sum-exp; `agm`, arithmetic-geometric mean (Mehdipour, Vasile,
            Belta 2019); `gmsr`, generalised mean (Uzun, Elango, Garoche, Acikmese, arXiv 2405.10996), with its
            eps = 1e-8 and p = 1.
        sharpness: b of `lse`, > 0. Its minimum of n values is up to log(n) / b below the true one. So a formula with a
            smaller robustness than that can hold and have a negative value: `lse` is not sign-sound, the others are.
    """
    if not sharpness > 0:
        raise ValueError(f"the sharpness is more than 0, got {sharpness}")
    folds = {"classic": Least(), "lse": SoftLeast(sharpness=sharpness), "agm": GeometricLeast(), "gmsr": RootLeast()}
    if name not in folds:
        raise ValueError(f"there are the semantics {', '.join(folds)}, not {name!r}")
    least: Fold = folds[name]
    greatest = least.mirrored()
    return Semantics(least, greatest, greatest, divided=name != "classic")
