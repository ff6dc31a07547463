"""Faults of plugins through a real run, in processes: each is a row with its reason, and the next run goes on."""

from __future__ import annotations

import json
import os
import re
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

METHODS = '''
import os
import time
from pathlib import Path
from stlbench.contract import Intractable, Unsuitable
from toy_plugins.methods import Raw


class Mute(Exception):
    def __str__(self):
        raise KeyError("no text")


class Mutes(Raw):
    """Raises what has no text."""
    def along(self, *arguments): raise Mute


class Bytes(Raw):
    """Looks for a file whose name is no UTF-8."""
    def along(self, *arguments): Path(os.fsdecode(b"caf\\xe9")).read_text()


class Escapes(Raw):
    """Raises escape codes, in the traceback too."""
    def along(self, *arguments): raise ValueError("\\x1b[2Jgone\\x07\\x00" + 1000 * "x" + "\\r\\nnext")


class Refuses(Raw):
    """Does not fit, and says so in a strange way."""
    def __init__(self, specification): raise Intractable(Mute())


class Unfit(Raw):
    """The same, in colours."""
    def __init__(self, specification): raise Unsuitable("\\x1b[31mred \\udcff")


class Extended(Raw):
    """Fits, by an extension with a strange name."""
    extension = "\\x1b[31m\\udcff" + 1000 * "x"


class Eats(Raw):
    """Keeps more and more."""
    kept = []
    def along(self, *arguments):
        while len(self.kept) < 20:
            self.kept.append(bytearray(b"x") * 2**26)
        time.sleep(60)


class Typed(Raw):
    """An extension that is no text."""
    extension = {"a": object}
'''

LEAKS = '''
import os, subprocess, sys, threading, time
import numpy as np
from toy_plugins.methods import Raw

np.seterr(all="raise")


class Leaks(Raw):
    """Changes all that it can reach, and is gone."""
    def along(self, *arguments):
        from stlbench.simulation import referee
        os.chdir("/")
        os.umask(0o777)
        os.environ["HOME"] = "/nowhere"
        np.mean = lambda *_, **__: 99.0
        time.perf_counter = lambda: -2187.0
        referee.score = lambda *_: None
        threading.Thread(target=time.sleep, args=(600,)).start()
        subprocess.Popen(["sleep", "600"])
        print("it \\x1b[31m leaks")
        print("and says so", file=sys.stderr)
        os._exit(0)
'''

NAMES = ["mutes", "bytes", "escapes", "refuses", "unfit", "extended", "typed", "eats"]
ENTRIES = "[stlbench.methods]\nbad-leaks = bad_plugins.leaks:Leaks\n" + "".join(
    f"bad-{name} = bad_plugins.methods:{name.capitalize()}\n" for name in NAMES
)

SAID = {
    "mutes": ("raised", "Mute: (its text cannot be had, it raises KeyError)"),
    "bytes": ("raised", "FileNotFoundError: [Errno 2] No such file or directory: 'caf\\udce9'"),
    "escapes": ("raised", "ValueError: \\x1b[2Jgone\\x07\\x00xxx"),
    "refuses": ("intractable", "(its text cannot be had, it raises KeyError)"),
    "unfit": ("unsuitable", "\\x1b[31mred \\udcff"),
    "extended": ("done", ""),
    "typed": ("raised", "PluginError: method 'bad-typed' of bad-plugins 1.2 (bad_plugins.methods:Typed): its ext"),
}


@pytest.fixture
def bad(site, toy):
    files = {"__init__": "", "methods": METHODS, "leaks": LEAKS}
    return site("bad-plugins", ENTRIES, {f"bad_plugins/{name}.py": text for name, text in files.items()})


def endings():
    """Method -> how its cell ended, and why."""
    with sqlite3.connect("results/ledger.sqlite") as ledger:
        return {name: row for name, *row in ledger.execute("SELECT method, status, reason FROM cells")}


def test_texts_that_nothing_can_show_are_rows_and_the_next_run_goes_on(bad, say):
    words = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--seeds", 1)
    words += ("--methods", ",".join(f"bad-{name}" for name in SAID) + ",toy-raw")
    done = say(*words)
    assert done.exit_code == 1
    rows = endings()
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


BRIBES = '''
from stlbench.records.result import Score
from stlbench.simulation import referee
from toy_plugins.methods import Raw

def score(task, traces, formula=None, lasted=None):
    return Score((99.0,) * len(traces), (True,) * len(traces), {})

referee.score = score

class Bribes(Raw):
    """Lets the referee say what it likes, wherever it is imported."""
'''


@pytest.mark.slow  # tests/study/test_credibility.py looks at such results in its own process
def test_a_method_that_changes_the_referee_has_no_score(site, toy, tmp_path, monkeypatch):
    """The harness itself imports the method, to check its parameters. So another process looks at the result."""
    monkeypatch.chdir(tmp_path)
    site("bad-judge", "[stlbench.methods]\nbad-judge = bad_judge:Bribes\n", {"bad_judge.py": BRIBES})
    words = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--seeds", "1", "--methods", "bad-judge,toy-raw")
    environment = os.environ | {"PYTHONPATH": str(toy)}
    command = [sys.executable, "-c", "from stlbench.cli import main; main()", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1, done.stderr
    rows = endings()
    assert rows["bad-judge"][0] == "raised"
    said = "it says robustness 99, satisfied 100 %; by the recorded traces and the formula of toy-line it is "
    assert rows["bad-judge"][1].startswith(f"its result is not credible: {said}")
    assert rows["toy-raw"] == ["done", ""]
    assert [path.name[:16] for path in Path("results/traces").iterdir()] == ["toy-line_toy-raw"]


def measured(folder):
    with sqlite3.connect(f"{folder}/ledger.sqlite") as ledger:
        rows = ledger.execute("SELECT result FROM cells WHERE method = 'toy-raw' ORDER BY seed").fetchall()
    return [
        {name: json.loads(row)["measurement"][name] for name in ("selected", "final", "env_steps")} for (row,) in rows
    ]


def test_what_a_method_does_to_its_process_is_not_in_the_results_of_another(bad, say):
    words = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--seeds", 2, "--jobs", 1)
    say(*words, "--methods", "toy-raw", "--results", "alone")
    done = say(*words, "--methods", "bad-leaks,toy-raw")
    assert "toy-line/bad-leaks/toy-agent/1 killed: the process ended with exit code 0" in done.stderr
    assert measured("results") == measured("alone")
    assert len(list(Path("results/traces").iterdir())) == 2
    shown = say("show", "cell", "toy-line/bad-leaks/toy-agent/0").stdout
    (log,) = Path("results/logs").glob("toy-line_bad-leaks_toy-agent_0_*.log")
    assert re.search(rf"log: +{log}\n", shown)
    assert shown.endswith("the end of its log:\nit \\x1b[31m leaks\nand says so\n")
    assert json.loads(say("show", "cell", "toy-line/bad-leaks/toy-agent/0", "--json").stdout)["log"] == str(log)
    say("results", "remove", "results", "toy-line/bad-leaks/*", "--yes")
    assert not list(Path("results/logs").iterdir())


@pytest.mark.slow
def test_a_cell_that_takes_too_much_memory_is_killed_and_its_reason_says_so(bad, say):
    words = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--seeds", 1, "--methods", "toy-raw,bad-eats")
    done = say(*words, "--memory", "600M")
    assert done.exit_code == 1
    assert re.search(r"toy-line/bad-eats/toy-agent/0 killed: it took .* of memory, its limit is 600 MiB", done.stderr)
    assert "toy-line/toy-raw/toy-agent/0 done" in done.stderr


FORKS = """
import os
from toy_plugins.methods import Raw

class Forks(Raw):
    \"\"\"A child of it leaves by an exception, and comes back to where the cell was called.\"\"\"
    def along(self, *arguments):
        child = os.fork()
        if child == 0:
            raise SystemExit(0)
        os.waitpid(child, 0)
        return super().along(*arguments)
"""


def test_a_forked_child_does_not_answer_for_its_cell(site, toy, say):
    site("bad-plugins", "[stlbench.methods]\nbad-forks = bad_forks:Forks\n", {"bad_forks.py": FORKS})
    done = say("run", "--tasks", "toy-line", "--agents", "toy-agent", "--seeds", 1, "--methods", "bad-forks")
    assert "toy-line/bad-forks/toy-agent/0 done: robustness" in done.stderr
    assert done.exit_code == 0
