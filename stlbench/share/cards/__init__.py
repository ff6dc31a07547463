"""The card of a data set, under the headings of Hugging Face's hub, filled from what is recorded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from string import Template

CARD = "README.md"
"""The file name under which the hub finds a card."""


def card(words: Mapping[str, object]) -> str:
    """The text of a card. Raises `KeyError` where a word of the template is missing."""
    return Template((Path(__file__).parent / "data.md").read_text(encoding="utf-8")).substitute(words)
