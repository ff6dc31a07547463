"""The values that a row may have, where it is read from a file that may be a stranger's."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated

from pydantic import AfterValidator, Field, ValidationError

from stlbench.errors import PAGE, in_words, one_line

MOST = 2**53
"""Greater whole numbers are not exact as floats."""
Whole = Annotated[int, Field(strict=True, ge=0, lt=MOST)]
Count = Annotated[int, Field(strict=True, ge=1, lt=MOST)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Amount = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
"""A number of seconds, say."""
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Robustness = Annotated[float, Field(strict=True, ge=-math.inf)]
"""Any number, also an infinite one, but NaN."""
Verdict = Annotated[bool, Field(strict=True)]
Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
"""A SHA-256."""


@lru_cache(maxsize=1024)  # a ledger says the same few of many cells
def safe_line(text: str) -> str:
    """Text for people as one line that is safe for any file and any terminal."""
    return one_line(text, PAGE)


Line = Annotated[str, AfterValidator(safe_line)]


def _is_name(text: str) -> str:
    if not text or one_line(text) != text:
        raise ValueError("should be one line of characters that can be shown")
    return text


Name = Annotated[str, AfterValidator(_is_name)]
"""Text by which something is found again, which is refused where it is not safe."""


def first_problem(error: ValidationError, *above: str) -> str:
    """The place of the first wrong value, and the rule that it breaks: "curve.0.steps: should be at least 0".

    The checked value may itself be a part: the names `above` lead to it.
    """
    first = error.errors(include_url=False, include_input=False)[0]
    place = ".".join(map(str, (*above, *first["loc"])))
    return one_line(": ".join(filter(None, (place, in_words(first["msg"])))))
