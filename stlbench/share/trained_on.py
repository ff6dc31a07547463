"""What a file of Stable-Baselines3 says of the observations that its policy was trained on."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stlbench.errors import UsageError
from stlbench.records.observation import KEY, Observation

_NUMBER = re.compile(r"[-+]?(?:inf|nan|\d+\.?\d*(?:e[-+]?\d+)?)")
_ROUNDING = 1e-6


def check_observation(path: Path, data: Mapping[str, Any], shown: Observation, declared: bool) -> None:
    """Refuse a policy that was trained on other observations than it would be shown.

    The spaces of `stlbench.wrap` and `stlbench.gym` carry a record. Those of others have ends at most: a number that
    is shown from -1 to 1 and was up to 8 in training is another number.

    Args:
        path: of the file, for messages.
        data: what SB3 writes beside its pickles: attribute -> plain value or text.
        shown: what it would be shown.
        declared: whether the user said that this is what it was trained on; then only the record counts.

    Raises:
        UsageError: the record, an end, or a normalization says otherwise.
    """
    space = mapping(data.get("observation_space"))
    if KEY in space:
        Observation.of_facts(str(path), space[KEY]).check(str(path), shown)
    if declared:
        return
    hint = "if it was trained on just what is shown, say --on observation"
    if data.get("_last_original_obs") is not None:
        rule = "it was trained inside VecNormalize, whose statistics are not in the file"
        raise UsageError(f"{path}: {rule}; score it by a module:function that normalizes; {hint}")
    most = [max(map(abs, pair)) for pair in zip(_ends(space.get("low")), _ends(space.get("high")), strict=False)]
    for place, end in enumerate(most if len(most) == shown.total else []):
        if shown.within(place) and 1 + _ROUNDING < end < math.inf:
            rule = f"in training, number {place} of the observation was up to {end:g}, and here it is from -1 to 1"
            raise UsageError(f"{path}: {rule}, of {shown}; {hint}")


def mapping(value: object) -> Mapping[str, Any]:
    """A value where it is a mapping, else an empty one: what a file has may be anything."""
    return value if isinstance(value, Mapping) else {}


def _ends(text: object) -> list[float]:
    """The numbers of an array, as NumPy writes it; those of a long one are not all there."""
    return [] if "..." in str(text) else [float(each) for each in _NUMBER.findall(str(text))]
