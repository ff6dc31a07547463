"""What of a file changes a result: everything that runs, and no words."""

from __future__ import annotations

import pytest

from stlbench.registry.effective_source import effective_digest

SOURCE = '''"""A module."""

from .other import thing

text = "a # b"
long = """c

# d
"""


class One:
    """Its docstring."""

    size: int = 3
    """Of an attribute."""

    def step(self, x):
        """Words."""
        return x + 1  # as it is
'''


@pytest.fixture
def meaning(tmp_path):
    def of(text, name="one.py"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return effective_digest(path, "pack.one" if name.endswith(".py") else "")

    return of


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("A module.", "The module, in\n# several\nlines."),
        ('"""A module."""\n', ""),
        ("# as it is", "# as it was"),
        ("  # as it is", ""),
        ("class One:", "# before\n\n\nclass One:  # after"),
        ('        """Words."""\n', ""),
        ('    """Of an attribute."""\n', ""),
        ("Its docstring.", "Words: # ' no"),
        ("text =", '__version__ = "1.2"\ntext ='),
        ("\n", "\r\n"),
    ],
)
def test_words_change_nothing(meaning, old, new):
    assert old in SOURCE
    before = meaning(SOURCE)
    assert meaning(SOURCE.replace(old, new)) == before


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("x + 1", "x + 2"),
        ("a # b", "a # c"),
        ("# d", "# e"),
        ("c\n\n#", "c\n#"),
        ("size: int = 3", "size: int = 4"),
        ("return x", "x = 3; return x"),
        (".other", ".another"),
    ],
)
def test_what_runs_counts(meaning, old, new):
    assert old in SOURCE
    before = meaning(SOURCE)
    assert meaning(SOURCE.replace(old, new)).digest != before.digest


def test_imports_are_found_by_their_full_names(meaning):
    assert meaning(SOURCE).imports == ("pack.other", "pack.other.thing")


def test_a_docstring_beside_other_statements_on_its_line(meaning):
    assert meaning('def f(): "words"; return 1\n').digest != meaning('def f(): "words"; return 2\n').digest
    assert meaning('"ä"; x = 1\n').digest == meaning('"öü"; x = 1\n').digest


@pytest.mark.parametrize("text", ["def\n", 'f"{x["#"]}"\n', "x = 1\0", b"\xff\xfe#"])
def test_of_what_cannot_be_read_every_byte_counts(meaning, text):
    raw = text if isinstance(text, bytes) else text.encode()
    assert meaning(raw).digest != meaning(raw + b"# more").digest


def test_of_a_task_file_the_words_do_not_count(meaning):
    before = meaning("title: a\nnotes: b\nsteps: 3\nhold: [1, 2]\n", "task.yaml")
    assert meaning("steps: 3\nhold: [1, 2]  # two\nsource: c\n", "task.yaml") == before
    assert meaning("steps: 3\nhold: [2, 1]\n", "task.yaml") != before
    assert meaning("- a\n", "task.yaml") != meaning("- b\n", "task.yaml")
    assert meaning("a: [", "task.yaml") != meaning("a: {", "task.yaml")


def test_of_other_files_every_byte_counts(meaning):
    assert meaning("# a", "table.csv") != meaning("# b", "table.csv")
