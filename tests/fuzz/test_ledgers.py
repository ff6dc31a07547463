"""Damaged ledgers, and files of lines, in folders of results."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

import pytest
from fuzz.answers import answer, fuzz, sizes
from fuzz.inputs import damaged

from stlbench.errors import UsageError
from stlbench.records.ledger import LEDGER
from stlbench.records.result_files import LINES
from stlbench.report import groups_of

RUN = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--methods", "toy-raw,toy-large,toy-wrong", "--seeds", 4)
HERE = ("--executor", "toy-here")


def read_all(folder: Path) -> None:
    """What a report reads."""
    with suppress(UsageError):
        groups_of(folder)


@pytest.fixture
def good(brief):
    """A folder of twelve cells, of which some are unsuitable and some raised, with both kinds of files."""
    assert brief(*RUN, *HERE, "--results", "good").exit_code == 0
    assert brief("export", "good", "--format", "jsonl").exit_code == 0
    return Path("good")


@pytest.mark.filterwarnings("ignore::stlbench.records.rows.LedgerWarning")
@sizes(12, 1_000)
def test_what_reads_a_ledger_reads_it_or_says_what_is_damaged(say, good, examples):
    (good / LINES).unlink()

    def check(data: bytes) -> None:
        shutil.rmtree("bad", ignore_errors=True)
        shutil.copytree(good, "bad")
        (Path("bad") / LEDGER).write_bytes(data)
        read_all(Path("bad"))
        answer(say("show", "cell", "toy-line/toy-raw/toy-agent/1", "bad"))
        answer(say("export", "bad", "--format", "jsonl"))
        assert say("verify", "bad").exit_code in (0, 1, 2)
        answer(say("results", "merge", "new", "bad"))
        shutil.rmtree("new", ignore_errors=True)

    fuzz(examples, damaged((good / LEDGER).read_bytes(), 3), check)


@pytest.mark.filterwarnings("ignore::stlbench.records.rows.LedgerWarning")
@sizes(8, 500)
def test_what_writes_a_ledger_goes_on_or_refuses_it(brief, good, examples):
    def check(data: bytes) -> None:
        shutil.rmtree("bad", ignore_errors=True)
        shutil.copytree(good, "bad")
        (Path("bad") / LEDGER).write_bytes(data)
        answer(brief("results", "remove", "bad", "toy-line/toy-wrong/*", "--yes"))
        answer(brief(*RUN, *HERE, "--results", "bad"))
        answer(brief(*RUN, *HERE, "--results", "bad", "--retry", "failed"))
        answer(brief("verify", "bad", "--repair"))

    fuzz(examples, damaged((good / LEDGER).read_bytes(), 3), check)


@sizes(15, 1_500)
def test_lines_are_read_or_refused_with_their_place(say, good, examples):
    def check(data: bytes) -> None:
        shutil.rmtree("bad", ignore_errors=True)
        Path("bad").mkdir()
        (Path("bad") / LINES).write_bytes(data)
        read_all(Path("bad"))
        answer(say("show", "cell", "toy-line/toy-raw/toy-agent/1", "bad"))

    fuzz(examples, damaged((good / LINES).read_bytes(), 3), check)
