"""The command line as a whole: help, version, errors, completion, and how fast it starts."""

from __future__ import annotations

import subprocess
import sys

import pytest
from helpers.imports import HEAVY, imported
from helpers.refusals import refused
from typer.main import get_command
from typer.testing import CliRunner

from stlbench import __version__
from stlbench.cli import app
from stlbench.cli.output import console

GROUPS = ("Train", "Look", "Policies", "Share", "Develop")


@pytest.mark.parametrize("words", [[], ["show", "task"], *([name] for name in get_command(app).commands)])
def test_help_has_an_example(say, words):
    done = say(*words, "--help")
    assert done.exit_code == 0
    assert "Example" in done.stdout
    assert f"stlbench {' '.join(words)}".strip() + " " in done.stdout.partition("Example")[2]


def test_without_a_command_it_prints_its_help(say):
    done = say()
    assert (done.exit_code, done.stdout.rstrip()) == (0, say("--help").stdout.rstrip())


def test_help_has_every_command_in_one_of_five_groups(say):
    sections = say("--help").stdout.split("\n\n")
    groups = {part.partition(":")[0]: part for part in sections if part.partition(":")[0] in GROUPS}
    assert list(groups) == list(GROUPS)
    listed = [line.split()[0] for part in groups.values() for line in part.splitlines()[1:]]
    assert sorted(listed) == sorted(get_command(app).commands)
    assert "..." not in "".join(groups.values())


def test_python_m_stlbench_is_the_command_line():
    done = subprocess.run([sys.executable, "-m", "stlbench", "--version"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, f"stlbench {__version__}\n")


@pytest.mark.parametrize(("said", "wide"), [("200", 200), ("wide", 120), (None, 120)])
def test_in_a_pipe_tables_are_as_wide_as_columns_says(monkeypatch, said, wide):
    monkeypatch.delenv("COLUMNS", raising=False)
    if said is not None:
        monkeypatch.setenv("COLUMNS", said)
    assert console().width == wide


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["rnu"], "error: No such command 'rnu'. Did you mean 'run'? (see 'stlbench --help')"),
        (["show", "task"], "error: Missing argument 'TASK'. (see 'stlbench show task --help')"),
        (["report", "x" * 300], "File name too long"),
        (["run", "--tasks", "hold-disc", "--results", "x" * 300], "File name too long"),
    ],
)
def test_wrong_words_and_names_are_one_line_on_stderr(say, words, message):
    line = refused(say(*words))
    assert message in line
    assert "Errno" not in line


def test_a_bug_is_not_hidden(monkeypatch, tmp_path):
    monkeypatch.setattr("stlbench.stl.parse", lambda *_, **__: 1 / 0)
    (tmp_path / "trace.csv").write_text("x\n1\n")
    with pytest.raises(ZeroDivisionError):
        app(["monitor", "x > 0", str(tmp_path / "trace.csv")])


def test_starts_without_the_heavy_packages(tmp_path):
    (tmp_path / "trace.csv").write_text("x\n1\n")
    lists = (["list", kind] for kind in ("methods", "tasks", "agents", "executors", "logs"))
    said = ["--help"], ["monitor", "x > 0", "trace.csv", "--json"], *lists, ["show", "method", "flag"]
    packages = imported(*said, folder=tmp_path)
    assert "typer" in packages
    assert not HEAVY & packages


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("stlbench run --tasks toy", ["toy-line"]),
        ("stlbench run --methods raw,toy-r", ["raw,toy-raw"]),
        ("stlbench run --agents dqn,toy", ["dqn,toy-agent"]),
        ("stlbench show task toy", ["toy-line"]),
    ],
)
@pytest.mark.usefixtures("toy")
def test_names(typed: str, offered: list[str]) -> None:
    words = {"COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    ran = CliRunner().invoke(app, [], env={"_STLBENCH_COMPLETE": "complete_bash", **words}, prog_name="stlbench")
    assert ran.stdout.split() == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_for_a_shell(shell: str) -> None:
    ran = CliRunner().invoke(app, [], env={"_STLBENCH_COMPLETE": f"source_{shell}"}, prog_name="stlbench")
    assert f"_STLBENCH_COMPLETE=complete_{shell}" in ran.stdout


def test_tab_in_python_offers_what_is_not_imported_yet() -> None:
    look = "import stlbench; assert {*stlbench.__all__} <= {*dir(stlbench)}; assert 'solve' not in vars(stlbench)"
    subprocess.run([sys.executable, "-c", look], check=True)
