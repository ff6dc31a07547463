"""`stlbench falsify` and `stlbench certify`, on made-up plugins, from the words to the answer."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.refusals import refused
from typer.testing import Result

RUN = ("run", "--tasks", "toy-line", "--methods", "toy-raw", "--executor", "toy-here", "--seeds", "1")
STILL, UP = "toy-line/toy-raw/toy-agent/0", "toy-line/toy-raw/toy-agent[action=2]/0"
"""From x_0 in [-1, 0.9] the robustness is 1 - x_0 of the one, and 1 - x_0 - 2 of the other."""


@pytest.fixture
def cells(say: Callable[..., Result], once: Callable[..., None]) -> Callable[..., Result]:
    """Train both cells; what says commands."""
    once(*RUN, "--agents", "toy-agent,toy-agent[action=2]")
    return say


def test_a_counterexample_with_its_files(cells: Callable[..., Result]) -> None:
    done = cells("falsify", UP, "--least", "--evaluations", 400)
    assert (done.exit_code, done.stderr) == (0, "")
    told, start, robustness, failed, because, *paths = done.stdout.splitlines()
    assert told.startswith(f"{UP}: counterexample, the first in evaluation ")
    assert float(start.partition("x = ")[2]) == pytest.approx(0.9, abs=0.02)
    assert float(robustness.split()[1].rstrip(",")) == pytest.approx(-1.9, abs=0.02)
    assert failed == "failed:     G[0,4] x <= 1"
    assert because.startswith("because:    x <= 1 at step 4 (2 s): margin -1.")
    stem = "results/falsified/counterexample-toy-line-toy-raw-toy-agent[action=2]-0-quick"
    assert paths == [f"{stem}.{end}" for end in ("npz", "csv", "png", "svg", "pdf")]
    judged = cells("monitor", "G[0,4] x <= 1", paths[0], "--json").stdout
    assert json.loads(judged)[0]["robustness"] == pytest.approx(-1.9, abs=0.02)
    assert "violated" in cells("monitor", "G[0,2] x <= 1", paths[1], "--dt", 0.5).stdout


def test_without_a_counterexample_nothing_is_written(cells: Callable[..., Result]) -> None:
    done = cells("falsify", STILL, "--evaluations", 300)
    assert done.stdout.startswith(f"{STILL}: no counterexample (differential-evolution, 300 evaluations, ")
    assert not Path("results/falsified").exists()
    cells("falsify", STILL, "--evaluations", 300, "--least", "--out", "least")
    assert len(list(Path("least").iterdir())) == 5


def test_all_cells_are_a_table(cells: Callable[..., Result]) -> None:
    done = cells("falsify", "--all", "--evaluations", 200, "--optimiser", "random")
    assert "1 of 2 have a counterexample." in done.stdout
    assert "5 files in results/falsified" in done.stdout
    assert [line[:5] for line in done.stderr.splitlines()] == ["[1/2]", "[2/2]"]


def test_the_final_policy_says_so_in_its_name_and_in_its_files(cells: Callable[..., Result]) -> None:
    done = cells("falsify", UP, "--policy", "final", "--evaluations", 300)
    assert done.stdout.startswith(f"{UP}, final: counterexample")
    assert "quick-final.npz" in done.stdout


def test_an_interruption_shows_what_was_found_so_far(cells: Callable[..., Result], monkeypatch: Any) -> None:
    search = importlib.import_module("stlbench.search.falsify")
    falsify, times = search.falsify, iter([False, True])

    def once(*words: Any) -> Any:
        if next(times):
            raise KeyboardInterrupt
        return falsify(*words)

    monkeypatch.setattr(search, "falsify", once)
    done = cells("falsify", UP, STILL, "--evaluations", 100)
    assert done.exit_code == 130
    assert done.stdout.startswith(f"{UP}: counterexample")
    assert done.stderr.endswith("interrupted: 1 of 2 were searched\n")


def test_a_controller_by_hand(say: Callable[..., Result], down: list[int]) -> None:
    (found,) = json.loads(say("falsify", "--controller", "toy-line", "--evaluations", 300, "--json").stdout)
    assert found["searched"] == "toy-line, by hand"
    assert found["robustness"] == pytest.approx(0.1, abs=0.02)


def test_a_policy_from_outside(say: Callable[..., Result], toy: Path) -> None:
    Path("mine.py").write_text("import numpy as np\ndef up(state, t): return np.ones((len(state), 1))\n")
    (found,) = json.loads(say("falsify", "--task", "toy-line", "mine:up", "--on", "state", "--json").stdout)
    assert (found["searched"], found["counterexample"], found["step"]) == ("toy-line, mine:up", True, 4)
    Path("by_number.py").write_text("import numpy as np\ndef last(state, t): return np.ones(len(state), int)\n")
    Path("own.csv").write_text("v\n-1\n1\n")
    named = ("--task", "toy-line", "by_number:last", "--on", "state", "--actions", "own.csv")
    (numbered,) = json.loads(say("falsify", *named, "--json").stdout)
    assert (numbered["counterexample"], numbered["start"]) == (True, found["start"])
    assert "for policies from outside, with --task" in refused(say("falsify", STILL, "--actions", "own.csv"))
    done = say("certify", "--task", "toy-line", "mine:up", "--on", "state", "--starts", 20)
    assert done.stdout.startswith("toy-line, mine:up: satisfied from 0 of 20 random starts")
    assert "recorded traces, which cannot act" in refused(say("falsify", "--task", "toy-line", found["files"][0]))


def test_a_cell_that_cannot_be_used_is_left_out_of_all(cells: Callable[..., Result]) -> None:
    next(Path("results/policies").glob("*action=2*")).unlink()
    done = cells("falsify", "--all", "--evaluations", 100)
    assert done.stdout.startswith(f"{STILL}: no counterexample")
    assert done.stderr.startswith(f"warning: {UP} has no policy at ")
    assert "has no policy at" in refused(cells("falsify", UP))


@pytest.mark.parametrize("command", ["falsify", "certify"])
def test_what_is_no_subject(cells: Callable[..., Result], command: str) -> None:
    for words, said in (
        ((), "error: name a cell, --all "),
        ((UP, "--all"), "do not name others"),
        ((UP, "--on", "state"), "with --task"),
        (("--task", "toy-line"), "--task needs a policy"),
        ((UP, "--task", "toy-line"), "a cell: name it without --task"),
        (("toy-line/toy-raw/toy-agent/7",), "there is no cell"),
        (("--controller", "toy-line"), "has no controller by hand"),
        ((UP, "--budget", "paper"), "has no budget 'paper'"),
        (("--all", "--budget", "paper"), "that can be used and the budget paper"),
    ):
        assert said in refused(cells(command, *words))


def test_bad_rules_are_refused_before_anything_is_loaded(say: Callable[..., Result]) -> None:
    assert "no optimiser 'newton'" in refused(say("falsify", "x", "--optimiser", "newton"))
    assert "at least one evaluation" in refused(say("falsify", "x", "--evaluations", 0))
    assert "a confidence is between 0 and 1" in refused(say("certify", "x", "--confidence", 99))
    assert "not by both" in refused(say("certify", "x", "--at-least", 0.9, "--until", 0.1))


def test_certificates(cells: Callable[..., Result]) -> None:
    done = cells("certify", STILL, "--starts", 300)
    assert done.stdout.startswith(f"{STILL}: satisfied from 300 of 300 random starts; with confidence 0.99 ")
    assert done.stdout.endswith("the probability is in [0.9825, 1.0000]\n")
    claimed = cells("certify", UP, "--at-least", 0.5)
    assert claimed.stdout.endswith("that it is at least 0.5 is refuted\n")
    still, up = json.loads(cells("certify", "--all", "--until", 0.1, "--json").stdout)
    assert (still["high"], up["low"]) == (1, 0)
    assert max(still["high"] - still["low"], up["high"] - up["low"]) <= 0.1
    assert cells("certify", "--all", "--starts", 50).stdout.startswith("Certificates: confidence 0.99")


def stop(*_: Any) -> Any:
    raise SystemExit(3)


def divide(state: Any, *_: Any) -> Any:
    raise ZeroDivisionError("division\nby zero")


@pytest.mark.parametrize("command", ["falsify", "certify"])
@pytest.mark.parametrize(
    ("control", "why"),
    [
        (divide, "ZeroDivisionError: division by zero"),
        (stop, "SystemExit: 3"),
        (lambda state, t: state[:1, 0], "toy-line, by hand: its actions are float64 (1,); expected are (1, 1) for v"),
        (lambda state, t: None if t[0] else -state, "toy-line, by hand: the controller has no action at step 1"),
        (lambda state, t: state * np.nan, "toy-line, by hand: an action has v nan; v is in [-1, 1]"),
    ],
)
def test_a_controller_that_fails_is_one_line(
    say: Callable[..., Result], steer: Callable[[Any], None], command: str, control: Any, why: str
) -> None:
    steer(control)
    said = refused(say(command, "--controller", "toy-line"))
    assert said.endswith(why)
    assert "toy-line, by hand" in said


@pytest.mark.parametrize(
    ("command", "part", "fault", "why"),
    [
        ("falsify", "step", divide, "ZeroDivisionError: division by zero"),
        ("certify", "signals", stop, "SystemExit: 3"),
        ("falsify", "initial_states", stop, "SystemExit: 3"),
    ],
)
def test_a_task_that_fails_now_is_one_line(
    cells: Callable[..., Result], monkeypatch: pytest.MonkeyPatch, command: str, part: str, fault: Any, why: str
) -> None:
    Path("mine.py").write_text("import numpy as np\ndef up(state, t): return np.ones((len(state), 1))\n")
    monkeypatch.setattr(importlib.import_module("toy_plugins.line.system").Line, part, lambda self, *_: fault(_))
    assert refused(cells(command, UP)) == f"error: {UP} cannot be tried: {why}"
    outside = refused(cells(command, "--task", "toy-line", "mine:up", "--on", "state"))
    assert outside == f"error: toy-line, mine:up cannot be tried: {why}"


@pytest.mark.parametrize(("command", "last"), [("falsify", "no counterexample"), ("certify", "satisfied from")])
def test_one_that_fails_costs_the_others_nothing(
    cells: Callable[..., Result], monkeypatch: pytest.MonkeyPatch, command: str, last: str
) -> None:
    agents: Any = importlib.import_module("toy_plugins.agents")
    acts = agents.Always.act
    monkeypatch.setattr(agents.Always, "act", lambda self, seen: divide(seen) if self.action == 2 else acts(self, seen))
    for named in (["--all"], [UP, STILL]):
        done = cells(command, *named, *(["--evaluations", 100] if command == "falsify" else ["--starts", 100]))
        assert done.exit_code == 2
        assert done.stdout.startswith(f"{STILL}: {last}")
        lines = done.stderr.splitlines()
        assert any(f"error: {UP} cannot be tried: ZeroDivisionError: division by zero" in line for line in lines)
        assert [line[:5] for line in lines] == ["[1/2]", "[2/2]"]
    monkeypatch.setattr(agents.Always, "act", divide)
    nothing = cells(command, "--all")
    assert (nothing.exit_code, nothing.stdout, len(nothing.stderr.splitlines())) == (2, "", 2)


POLE = """
title: A pole
source: made up
formula: G[0,30] abs(x) <= 2.5
sampling_time: 0.02
steps: 30
environment: {id: CartPole-v1, names: [x, v, theta, omega], scale: {v: 3, omega: 3}}
terminated: interval
signals: {x: {low: -3, high: 3}}
starts: 4
agents: {dqn: {}}
budgets: {smoke: {steps: 100}}
"""


def test_an_open_verdict_is_told(say: Callable[..., Result]) -> None:
    """The pole falls while the cart is far inside; whether it would have stayed there is open."""
    Path("open-pole").mkdir()
    Path("open-pole/task.yaml").write_text(POLE)
    Path("pushing.py").write_text("import numpy as np\ndef right(seen): return np.ones(len(seen), int)\n")
    named = ("--task", "./open-pole", "pushing:right")
    told, _, robustness, open_, *paths = say("falsify", *named, "--evaluations", 4).stdout.splitlines()
    assert told.startswith("open-pole, pushing:right: no counterexample, verdict open, the first in evaluation 1 (")
    assert robustness.startswith("robustness: at least -0.5, verdict open: the episode ended early")
    assert open_.startswith("open:       ended early, at step ")
    assert len(paths) == 5
    assert all(Path(path).name.startswith("open-") for path in paths)
    (found,) = json.loads(say("falsify", *named, "--evaluations", 4, "--json").stdout)
    assert (found["counterexample"], found["verdict"], found["first"]) == (False, "open", 1)
    told = say("certify", *named, "--starts", 4).stdout
    assert "satisfied from 0 of 4 random starts, violated from 0, open from 4 that ended early; " in told
    assert "the probability that every continuation satisfies is in [0.0000, " in told
    (certified,) = json.loads(say("certify", *named, "--starts", 4, "--json").stdout)
    assert (certified["satisfied"], certified["violated"], certified["open"]) == (0, 0, 4)
