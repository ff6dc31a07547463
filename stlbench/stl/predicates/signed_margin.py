"""One number that says both how robustly a formula holds and whether it does.

Robustness and verdict can disagree at robustness 0 alone: `x >= 0` holds at x = 0, `x > 0` does not. A signed margin
is never 0: the smallest normal float stands for it, with the sign of the verdict. Minimum, maximum and negation keep
signs, so a formula holds iff its signed value is > 0, in every combination, and the bounds of a monitor and its
verdict come from one pass. The robustness is the signed value, or 0 within `SIDE` of 0, which is exact but for margins
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
