"""One number that says both how robustly a formula holds and whether it does.

Robustness and verdict can disagree at robustness 0 alone: `x >= 0` holds at x = 0, `x > 0` does not. A sided value
moves a predicate's margin of 0 by the smallest normal float to the side of its verdict. Minimum, maximum and negation
keep sides, so a formula holds iff its sided value is > 0, in every combination, and the bounds of a monitor and its
verdict come from one pass. The robustness is the sided value, or 0 within `SIDE` of 0, which is exact but for margins
that no normal float can tell from 0. (The smallest denormal would do too, but training switches denormals off.)
"""

from __future__ import annotations

import sys

from stlbench.stl.language.syntax import Predicate

#: the smallest normal float
SIDE = sys.float_info.min


def zero_side(predicate: Predicate) -> float:
    """What stands for a margin of 0: above 0 where that holds (<=, >=), below where it does not (<, >)."""
    return SIDE if predicate.op in ("<=", ">=") else -SIDE
