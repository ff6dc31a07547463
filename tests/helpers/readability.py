"""How easy a page is to read: Flesch's reading ease of its prose (R. Flesch, A New Readability Yardstick, 1948)."""

from __future__ import annotations

import re
from itertools import pairwise

APART = re.compile(
    r"^---\n.*?^---$|^```.*?^```$|<!--.*?-->|^\s*\|.*?$|^#+ .*?$|\$\$.*?\$\$|\$[^$\n]+\$"
    r"|!\[[^]]*\]\([^)]*\)(\{[^}]*\})?|^::: .*?$|</?\w[^>]*>|https?://\S+",
    re.MULTILINE | re.DOTALL,
)
"""What is no prose: front matter, code, comments, tables, headings, mathematics, pictures, tags, addresses."""
LINK = re.compile(r"\[([^]]*)\](\([^)]*\)|\[[^]]*\])(\{[^}]*\})?")
CODE = re.compile(r"`[^`]*`")


def prose(text: str) -> str:
    """The running text of a page of Markdown. A piece of code counts as one short word, as readers skip it."""
    plain = LINK.sub(r"\1", CODE.sub("code", APART.sub("\n\n", text)))
    return re.sub(r"^\s*([-*]|\d+\.)\s+", "\n\n", plain, flags=re.MULTILINE)


def sentences(text: str) -> list[list[str]]:
    """The words of each sentence. A paragraph and an item of a list end one too."""
    parts = re.split(r"\n\s*\n|(?<=[.!?:;])\s+", prose(text))
    return [words for part in parts if len(words := re.findall(r"[A-Za-z][A-Za-z'-]*", part)) > 1]


def syllables(word: str) -> int:
    """About how many: groups of vowels, without a silent e at the end."""
    letters = word.lower().removesuffix("'s")
    vowels = [letter in "aeiouy" for letter in letters]
    groups = sum(now and not before for before, now in pairwise([False, *vowels]))
    silent = letters.endswith(("e", "es", "ed")) and not letters.endswith(("le", "les", "ted", "ded", "ses", "ces"))
    return max(1, groups - silent)


def reading_ease(text: str) -> float:
    """206.835 less 1.015 words per sentence, less 84.6 syllables per word. 60 is plain English, 30 hard."""
    found = sentences(text)
    words = [word for each in found for word in each]
    return 206.835 - 1.015 * len(words) / len(found) - 84.6 * sum(map(syllables, words)) / len(words)
