"""Faults of plugins through a real run, in processes: each is a row with its reason, and the next run goes on."""

from __future__ import annotations

import sqlite3

import pytest

METHODS = '''
import os
from pathlib import Path
from stlbench.contract import Intractable, Unsuitable
from toy_plugins.methods import Raw


class Mute(Exception):
    def __str__(self):
        raise KeyError("no text")


class Mutes(Raw):
    """Raises what has no text."""
    def step(self, *arguments): raise Mute


class Bytes(Raw):
    """Looks for a file whose name is no UTF-8."""
    def step(self, *arguments): Path(os.fsdecode(b"caf\\xe9")).read_text()


class Escapes(Raw):
    """Raises escape codes, in the traceback too."""
    def step(self, *arguments): raise ValueError("\\x1b[2Jgone\\x07\\x00" + 1000 * "x" + "\\r\\nnext")


class Refuses(Raw):
    """Does not fit, and says so in a strange way."""
    def __init__(self, specification): raise Intractable(Mute())


class Unfit(Raw):
    """The same, in colours."""
    def __init__(self, specification): raise Unsuitable("\\x1b[31mred \\udcff")


class Extended(Raw):
    """Fits, by an extension with a strange name."""
    extension = "\\x1b[31m\\udcff" + 1000 * "x"


class Typed(Raw):
    """An extension that is no text."""
    extension = {"a": object}
'''

ENTRIES = "[stlbench.methods]\n" + "".join(
    f"bad-{name} = bad_plugins.methods:{name.capitalize()}\n"
    for name in ("mutes", "bytes", "escapes", "refuses", "unfit", "extended", "typed")
)

SAID = {
    "mutes": ("raised", "Mute: (its text cannot be had, it raises KeyError)"),
    "bytes": ("raised", "FileNotFoundError: [Errno 2] No such file or directory: 'caf\\udce9'"),
    "escapes": ("raised", "ValueError: \\x1b[2Jgone\\x07\\x00xxx"),
    "refuses": ("intractable", "(its text cannot be had, it raises KeyError)"),
    "unfit": ("unsuitable", "\\x1b[31mred \\udcff"),
    "extended": ("done", ""),
    "typed": ("done", ""),
}


@pytest.fixture
def bad(site, toy):
    return site("bad-plugins", ENTRIES, {"bad_plugins/__init__.py": "", "bad_plugins/methods.py": METHODS})


def test_texts_that_nothing_can_show_are_rows_and_the_next_run_goes_on(bad, say):
    words = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--seeds", 1)
    words += ("--methods", ",".join(f"bad-{name}" for name in SAID) + ",toy-raw")
    done = say(*words)
    assert done.exit_code == 1
    with sqlite3.connect("results/ledger.sqlite") as ledger:
        rows = {name: row for name, *row in ledger.execute("SELECT method, status, reason FROM cells")}
    assert rows.pop("toy-raw") == ["done", ""]
    for name, (status, reason) in SAID.items():
        assert rows[f"bad-{name}"][0] == status
        assert rows[f"bad-{name}"][1].startswith(reason)
        assert len(rows[f"bad-{name}"][1]) < 600
    again = say(*words)
    assert again.stderr == "8 cells, 8 of them done before\n"
    shown = say("show", "cell", "toy-line/bad-escapes/toy-agent/0")
    for text in (done.output, again.output, shown.output, say("report", "results", "--json").output):
        assert "\x1b" not in text
        assert "\x07" not in text
    assert "ValueError: \\x1b[2J" in shown.stdout
