"""What the observation space in a file of Stable-Baselines3 says that the policy was trained on."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stlbench.errors import UsageError
from stlbench.observation import KEY, Observation

__all__ = ["check_space"]

_NUMBER = re.compile(r"[-+]?(?:inf|nan|\d+\.?\d*(?:e[-+]?\d+)?)")
_ROUNDING = 1e-6


def check_space(path: Path, space: Mapping[str, Any], shown: Observation, declared: bool) -> None:
    """Refuse a policy that was trained on other observations than it would be shown.

    The spaces of `stlbench.wrap` and `stlbench.gym` carry a record. Those of others have ends at most: a number that
    is shown from -1 to 1 and was up to 8 in training is another number.

    Args:
        path: of the file, for messages.
        space: as SB3 writes it beside its pickle: attribute -> plain value or text.
        shown: what it would be shown.
        declared: whether the user said that this is what it was trained on; then ends say nothing.

    Raises:
        UsageError: the record, or an end, says otherwise.
    """
    if KEY in space:
        Observation.of_facts(str(path), space[KEY]).check(str(path), shown)
        return
    if declared:
        return
    most = [max(map(abs, pair)) for pair in zip(_ends(space.get("low")), _ends(space.get("high")), strict=False)]
    for place, end in enumerate(most if len(most) == shown.total else []):
        if shown.within(place) and 1 + _ROUNDING < end < math.inf:
            rule = f"which here is from -1 to 1: {shown}"
            hint = "if it was trained on just that, say --on observation"
            raise UsageError(
                f"{path}: in training, number {place} of the observation was up to {end:g}, {rule}; {hint}"
            )


def _ends(text: object) -> list[float]:
    """The numbers of an array, as NumPy writes it; those of a long one are not all there."""
    return [] if "..." in str(text) else [float(each) for each in _NUMBER.findall(str(text))]
