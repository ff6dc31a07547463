"""Texts of strangers in all that is written: none reaches a terminal or a file with characters that it obeys."""

from __future__ import annotations

import csv
import json
import lzma
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import yaml
from cli.conftest import SYSTEM, TASK
from helpers.hostile_results import recorded
from helpers.impossible_rows import IMPOSSIBLE, changed, insert, plain, rich
from helpers.synthetic_results import plan, result

from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result_files import csv_text
from stlbench.report.figures.files import Drawing

EVIL = '=cmd|"/c calc"!A1 \x1b[31m\x07\x9b2J\u202eevil\u2066\u200f\u2028\u0085\ufeffx\r\nsecond line\x00'
"""A formula, colours, a bell, other control characters, marks that turn text, and line breaks."""
UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff]")
LIVE = re.compile(r"[=+\-@\t\r＝＋－＠]\W*[^\W\d]")  # noqa: RUF001


def planted(seed: int) -> object:
    """A row with such a text in each of its fields that may have any."""
    row = plain(rich(seed))
    score = {"robustness": [0.25], "satisfied": [True], "first_failed": {}}
    scores = {("measurement", which, EVIL): score for which in ("selected", "final")}
    texts = {
        ("reason",): EVIL,
        ("details",): EVIL,
        ("provenance",): dict.fromkeys(("machine", "source", "jobs", "code", "time", "numpy", EVIL), EVIL),
        ("measurement", "extension"): EVIL,
        ("measurement", "selected", "formula", "first_failed"): {EVIL: 1},
        ("measurement", "policies", "observation", "names"): [EVIL, EVIL],
        ("measurement", "policies", "observation", "task"): EVIL,
    }
    return changed(row, {**scores, **texts})


@pytest.fixture
def evil(say, toy, monkeypatch) -> Path:
    """A folder of good cells, of three with such texts, one of which raised and one is from outside, and of rows that
    cannot be."""
    monkeypatch.setattr(Drawing, "write", lambda *_: [])
    folder = Path("evil")
    folder.mkdir()
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(recorded("flag", folder))
        ledger.record(plan())
    insert(folder, planted(3), plain(rich(3)))
    raised = plain(result("mine", status="raised"))
    facts = {("reason",): EVIL, ("details",): EVIL, ("provenance",): {EVIL: EVIL}}
    insert(folder, changed(raised, facts), raised)
    outside = plain(replace(result("wide", agent="mine", track="outside"), provenance={"source": "f"}))
    insert(folder, changed(outside, {("provenance",): {"source": EVIL, "sha256": EVIL, "begun_at": EVIL}}), outside)
    for seed, changes in enumerate(IMPOSSIBLE.values(), 100):
        insert(folder, changed(plain(rich(seed)), changes), plain(rich(seed)))
    return folder


COMMANDS = (
    "report evil",
    "report evil --json",
    "report evil --html",
    "export evil",
    "export evil --format jsonl --out lines",
    "compare evil evil",
    "show cell hold-disc/raw/dqn/3 evil",
    "show cell hold-disc/raw/dqn/3 evil --json",
    "show cell hold-disc/mine/dqn/0 evil",
    "verify evil",
    "results merge new evil",
    "report new --explain",
    "bundle evil b.zip",
)
PLANTED = ("cells.csv", "report.md", "report.html", "robustness.tex")
"""Files that show such texts."""


@pytest.mark.filterwarnings("ignore")
def test_no_output_has_what_a_terminal_obeys_or_a_spreadsheet_computes(say, evil):
    """And no command ends by the impossible rows beside them."""
    for command in COMMANDS:
        done = say(*command.split())
        assert done.exit_code in (0, 1, 4), (command, done.output)
        assert not UNSAFE.search(done.stdout + done.stderr), command
    files = [path for end in ("csv", "md", "tex", "html", "jsonl") for path in Path().rglob(f"*.{end}")]
    assert {path.suffix for path in files} == {".csv", ".md", ".tex", ".html", ".jsonl"}
    for path in files:
        text = path.read_text()
        assert not UNSAFE.search(text), path
        assert "second line" in text or path.name not in PLANTED, path
    lines = lzma.decompress(Path("lines/cells.jsonl.xz").read_bytes()).decode()
    assert "second line" in lines
    assert not UNSAFE.search(lines)
    for path in Path().rglob("*.csv"):
        with path.open(newline="") as file:
            cells = [cell for row in csv.reader(file) for cell in row]
        assert not [cell for cell in cells if LIVE.match(cell) or "\n" in cell], path
    table = pd.read_csv(evil / "export" / "robustness.csv")
    assert table.robustness_mean.dtype == table.robustness_min.dtype == float
    assert table.robustness_min.min() == pd.read_csv(evil / "cells.csv").robustness_min.min() == -0.5
    assert "'=cmd" in (evil / "cells.csv").read_text()
    shown = json.loads(say("report", "evil", "--json").stdout)["cells"]
    assert sorted(row["method"] for row in shown) == ["flag", "funnel", "mine", "raw", "wide"]


def test_what_of_a_csv_is_a_formula():
    texts = ["=1+1", "@SUM(A1)", "+a", "-a", "\ta", "\uff1da", "=", "=~", "*", "-", "-0.5", "+1e-3", "a=1"]
    (read,) = csv.reader(csv_text([[*texts, -0.5, None]]).splitlines())
    assert read == [*(f"'{text}" for text in texts[:6]), *texts[6:], "-0.5", ""]


def test_a_task_file_is_read_with_its_characters_escaped(say, toy):
    """Titles, sources, notes, units, values of any kind, and names of protocols and budgets."""
    content = yaml.safe_load(TASK)
    content |= {"title": EVIL, "source": EVIL, "notes": EVIL}
    content["best_known"] = {"robustness": 1.0, "how": EVIL, "upper_bound": 2.0, "why": EVIL}
    content["signals"]["x"]["unit"] = content["actions"]["v"]["unit"] = EVIL
    content["agents"] = {"dqn": {"note": EVIL}}
    content["protocols"] = {"end\x1b\u202e": {"title": EVIL, "formula": "F[4,4] x <= 1", "starts": 8}}
    content["budgets"]["quick\x1b"] = content["budgets"]["quick"]
    folder = Path("unsafe-task")
    folder.mkdir()
    (folder / "task.yaml").write_text(yaml.safe_dump(content))
    (folder / "system.py").write_text(SYSTEM)
    for words in (("show", "task", "./unsafe-task"), ("show", "task", "./unsafe-task", "--json")):
        done = say(*words)
        assert done.exit_code == 0, done.output
        assert not UNSAFE.search(done.stdout + done.stderr)
        assert "second line" in done.stdout
        assert r"quick\x1b" in done.stdout.replace("\\\\", "\\")
    assert json.loads(done.stdout)["title"].startswith('=cmd|"/c calc"!A1 \\x1b[31m')
    content["budgets"] = {"quick\nfast": content["budgets"]["quick"]}
    (folder / "task.yaml").write_text(yaml.safe_dump(content))
    done = say("show", "task", "./unsafe-task")
    assert done.exit_code == 2
    assert "should be one line of characters that can be shown" in done.stderr
    assert not UNSAFE.search(done.stderr)


@pytest.mark.parametrize("key", ["budget", "tasks", "memory", "results", "zz"])
def test_a_study_is_read_with_its_characters_escaped(say, toy, key):
    study = {"tasks": "toy-line", "methods": "toy-raw", "agents": "toy-agent", "executor": "toy-here", key: EVIL[:60]}
    Path("study.yaml").write_text(yaml.safe_dump(study))
    done = say("run", "study.yaml", "--seeds", "1")
    assert not UNSAFE.search(done.stdout + done.stderr)
