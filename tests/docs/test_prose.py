"""Pages are spelled right, easy to read, linked to what is there, and not too many.

How easy is Flesch's reading ease of their prose (R. Flesch, A New Readability Yardstick, 1948).
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml

APART = re.compile(
    r"^---\n.*?^---$|^```.*?^```$|<!--.*?-->|^\s*\|.*?$|^#+ .*?$|\$\$.*?\$\$|\$[^$\n]+\$"
    r"|!\[[^]]*\]\([^)]*\)(\{[^}]*\})?|^::: .*?$|</?\w[^>]*>|https?://\S+",
    re.MULTILINE | re.DOTALL,
)
"""What is no prose: front matter, code, comments, tables, headings, mathematics, pictures, tags, addresses."""
LINK = re.compile(r"\[([^]]*)\](\([^)]*\)|\[[^]]*\])(\{[^}]*\})?")
SPAN = re.compile(r"`[^`]*`")


def prose(text: str) -> str:
    """The running text of a page of Markdown. A piece of code counts as one short word, as readers skip it."""
    plain = LINK.sub(r"\1", SPAN.sub("code", APART.sub("\n\n", text)))
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


ROOT = Path(__file__).parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")])
PROSE = [path for path in PAGES if sum(map(len, sentences(path.read_text(encoding="utf-8")))) >= 60]
OTHERS = [*ROOT.glob("skills/**/*.md"), *ROOT.glob("plugins/example/*.md"), ROOT / "paper" / "paper.md"]
CODE = ("stlbench", "plugins", "tasks", "studies", "examples", "Makefile", "pyproject.toml", "CITATION.cff")
NAMES = "te,meger,fro,trough,reacher"
"""Words and names that codespell takes for mistakes."""
EASE = 60
"""The least Flesch reading ease of a page: 60 to 70 is plain English."""
WORDS = 33_100
"""The most that all pages, README.md and CONTRIBUTING.md have together, but for the tables that scripts write."""
WRITTEN = re.compile(r"<!-- --8<-- \[start:.*?\[end:", re.DOTALL)


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_reading_ease_is_as_flesch_has_it() -> None:
    """Eight words of ten syllables in two sentences: 206.835 - 1.015 * 4 - 84.6 * 1.25."""
    text = "A robot must reach. It stays in regions."
    assert [len(each) for each in sentences(text)] == [4, 4]
    assert sum(map(syllables, re.findall(r"\w+", text))) == 10
    assert reading_ease(text) == pytest.approx(206.835 - 1.015 * 4 - 84.6 * 10 / 8)
    assert reading_ease("# Heading\n\n```console\n$ x\n```\n" + text + "\n\n| a | table |\n") == reading_ease(text)


@pytest.mark.slow
@pytest.mark.parametrize("path", [*PROSE, *OTHERS], ids=named)
def test_a_page_is_easy_to_read(path: Path) -> None:
    assert reading_ease(path.read_text(encoding="utf-8")) >= EASE


@pytest.mark.slow
def test_words_are_spelled_right() -> None:
    """By codespell, which knows common mistakes, and by the words of the house, which spells as the British do."""
    if find_spec("codespell_lib") is None:
        pytest.skip("codespell is not installed")
    house = ["-D", "-", "-D", str(ROOT / "tests/docs/house.txt")]
    zoo = ["--skip", "*/zoo/*,*.npz,*.json,*/__pycache__/*"]
    code = [str(ROOT / name) for name in CODE]
    for more, files in ((house, map(str, [*PAGES, *OTHERS])), (zoo, code)):
        command = [sys.executable, "-m", "codespell_lib", "-L", NAMES, *more, *files]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.stdout, done.returncode) == ("", 0)


@pytest.mark.parametrize("path", [path for path in [*PAGES, *OTHERS] if (ROOT / "docs") not in path.parents], ids=named)
def test_links_outside_of_the_site_lead_somewhere(path: Path) -> None:
    """`mkdocs build --strict` checks those of the site."""
    text = re.sub(r"^```.*?^```$|`[^`]*`", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        file, _, anchor = target.partition("#")
        if not re.match(r"[a-z]+:", target):
            there = path.parent / file if file else path
            assert there.exists(), target
            if anchor:
                assert anchor in anchors(there.read_text(encoding="utf-8")), target


def anchors(text: str) -> set[str]:
    """Of the headings of a page, as mkdocs and GitHub make them."""
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", head).strip().lower()) for head in heads}


def test_each_page_of_explanation_answers_the_question_that_is_its_title() -> None:
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]  # above it are tags of mkdocs
    sections = {title: pages for entry in yaml.safe_load(nav) for title, pages in entry.items()}
    titles = [title for page in sections["Explanation"] for title in page]
    assert [title for title in titles if not title.startswith(("What", "How", "Why"))] == []
    paths = [*paths_in(list(sections.values()))]
    assert len(paths) == len(set(paths))


def paths_in(entries: list[Any]) -> Iterator[str]:
    """The pages of a part of the navigation, whatever groups it has."""
    for entry in entries:
        if isinstance(entry, str):
            yield entry
        else:
            yield from paths_in(entry if isinstance(entry, list) else list(entry.values()))


def test_there_is_not_more_to_read_than_a_reader_can_be_asked_to() -> None:
    counted = [path for path in PAGES if path.name in ("README.md", "CONTRIBUTING.md") or path.parent != ROOT]
    assert sum(len(WRITTEN.sub("", path.read_text(encoding="utf-8")).split()) for path in counted) <= WORDS
