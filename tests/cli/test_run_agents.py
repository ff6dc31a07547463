"""`stlbench run` with an agent that a task has no recipe for, and with one that cannot train here."""

from __future__ import annotations

from pathlib import Path

import pytest

AGENTS = '''
from dataclasses import dataclass
from stlbench.contract import Unsuitable
from toy_plugins.agents import Still

@dataclass(frozen=True, kw_only=True)
class Fields(Still):
    """Its parameters are fields."""
    action: int = 2
    """which it takes"""

class Picky(Still):
    """Not on this machine."""
    def __init__(self, *, library: str = "numbers"):
        raise Unsuitable(f"it needs {library}:\\n pip install 'toy'")

class Clumsy(Still):
    """Its constructor is wrong."""
    def __init__(self):
        raise KeyError("x")

class Late(Still):
    """Finds out in training."""
    def train(self, training): raise Unsuitable("the actions are a grid")
'''
ENTRIES = """
[stlbench.agents]
toy-fields = more_agents:Fields
toy-picky = more_agents:Picky
toy-clumsy = more_agents:Clumsy
toy-late = more_agents:Late
"""


@pytest.fixture
def run(say, toy, site):
    """Say `run` on toy-line with these agents."""
    site("more-agents", ENTRIES, {"more_agents.py": AGENTS})
    words = ("run", "--tasks", "toy-line", "--methods", "toy-raw", "--executor", "toy-here", "--seeds", "1")
    return lambda agents, *more: say(*words, "--agents", agents, *more)


def test_without_a_recipe_it_trains_with_its_defaults_and_says_so(run):
    done = run("toy-fields,toy-agent")
    assert done.exit_code == 0
    note = "task toy-line has no recipe for agent toy-fields, which trains with its defaults"
    assert done.stderr.count("no recipe") == done.stderr.count(note) == 1
    assert "no recipe" not in run("toy-fields,toy-agent").stderr  # nothing was left to run
    assert run("toy-fields[action=1]").exit_code == 0


@pytest.mark.parametrize(
    ("agent", "message"),
    [
        ("toy-picky[library=abc]", "error: agent toy-picky[library=abc]: it needs abc: pip install 'toy'\n"),
        ("toy-clumsy", "error: agent toy-clumsy: KeyError: 'x'\n"),
    ],
)
def test_an_agent_that_cannot_train_here_is_one_line_and_nothing_runs(run, agent, message):
    done = run(f"toy-agent,{agent}")
    assert (done.exit_code, done.stderr) == (2, message)
    assert not Path("results/cells.csv").exists()


def test_an_agent_that_finds_out_in_training_has_a_row_with_the_reason(run):
    done = run("toy-late,toy-agent")
    assert done.exit_code == 0
    assert "toy-line/toy-raw/toy-late/0 unsuitable: the actions are a grid" in done.stderr


def test_a_run_in_which_no_cell_fits_is_one_line_and_2(run):
    done = run("toy-late")
    said = "error: no cell fits, so nothing was trained: toy-line/toy-raw/toy-late/0: the actions are a grid"
    assert (done.exit_code, done.stderr.splitlines()[-1]) == (2, said)
    again = run("toy-late", "--methods", "toy-raw,toy-large")  # one cell of these is intractable, which is a finding
    assert again.exit_code == 0
