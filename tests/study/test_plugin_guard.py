"""Plugins of others are asked in processes of their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from helpers.line_task import SYSTEM, text

from stlbench.errors import UsageError
from stlbench.records.identity import Setting
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.report.figures.margins import bands_of
from stlbench.report.figures.regions import UNKNOWN, scale_of_task
from stlbench.simulation.faults import Unanswered, ask_here
from stlbench.study import plugin_guard
from stlbench.tracks.references import at_random, by_hand, payment, references

METHODS = """
import os, signal, time
from stlbench.contract import RewardMethod, Unsuitable
class Same(RewardMethod):
    paid_on_arrival = True
    def arrival(self, signals, t):
        self.do()
        return signals[..., 0] + 1
    def band(self): return self.do() or ()
    def do(self): pass
class Hang(Same):
    def do(self): time.sleep(600)
class Exit(Same):
    def do(self): os._exit(0)
class Die(Same):
    def do(self): os.kill(os.getpid(), signal.SIGKILL)
class Raise(Same):
    def do(self): raise ValueError("no\\nluck")
class Eat(Same):
    def do(self): self.kept = [b"x" * 10**7 for _ in range(50)]; time.sleep(600)
class Refuse(Same):
    def __init__(self, specification): raise Unsuitable("not here")
class Text(Same):
    def arrival(self, signals, t): return "much"
class Loud(Same):
    def do(self): print("a secret")
"""
QUICK = ("same", "exit", "die", "raise", "eat", "refuse", "text", "loud")
NAMES = (*QUICK, "hang")
ENTRIES = "[stlbench.methods]\n" + "\n".join(f"zz-{name} = zz_asked:{name.capitalize()}" for name in NAMES)
SHORT = 2.0
"""Seconds for what never answers."""


@pytest.fixture
def bad(site: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    site("zz-asked", ENTRIES, {"zz_asked.py": METHODS})
    monkeypatch.setattr(plugin_guard, "EXECUTOR", "local[memory=400M]")


def test_each_costs_its_own_answer_alone_and_the_report_says_why(bad: None, capfd: pytest.CaptureFixture[str]) -> None:
    methods = ["raw", *(f"zz-{name}" for name in QUICK)]
    settings = [Setting(Choice("hold-disc"), Choice(method), Choice("dqn"), "quick") for method in methods]
    with pytest.warns(plugins.PluginWarning) as told:
        found = references(settings, plugin_guard.ask)["hold-disc"]
    said = {str(each.message).split(": ")[1].split(" ")[1]: str(each.message).split("pays: ")[1] for each in told}
    assert said.pop("zz-eat").startswith("it took ")
    assert "its rewards should be numbers of shape (200, 256), got <U4 of shape ()" in said.pop("zz-text")
    assert said == {
        "zz-exit": "the process ended with exit code 0",
        "zz-die": "killed by signal 9 (SIGKILL)",
        "zz-raise": "ValueError: no luck",
    }
    assert found.by_hand is not None
    assert "secret" not in "".join(capfd.readouterr())


def test_what_hangs_is_waited_for_once(bad: None) -> None:
    question = payment(Choice("hold-disc"), "shared", "zz-hang")
    assert plugin_guard.ask([question], SHORT) == [Unanswered(f"no result after {SHORT:g} s")]
    assert plugin_guard.ask([question]) == [Unanswered(f"no result after {SHORT:g} s")]


def test_what_others_pay_is_the_same_as_in_this_process(bad: None) -> None:
    pairs = ((track, name) for track in ("shared", "plain") for name in ("raw", "zz-same"))
    questions = [payment(Choice("hold-disc"), *pair) for pair in pairs]
    assert [str(answer) for answer in plugin_guard.ask(questions)] == [str(answer) for answer in ask_here(questions)]
    assert plugin_guard.ask([payment(Choice("hold-disc"), "shared", "there-is-none")]) == [None]


def test_bounds_that_cannot_be_asked_for_are_none_and_a_warning(bad: None) -> None:
    names = [Choice(f"zz-{name}") for name in ("same", "raise", "refuse", "exit")]
    with pytest.warns(plugins.PluginWarning) as told:
        found = bands_of(Choice("hold-disc"), [*names, Choice("funnel"), Choice("there-is-none")], plugin_guard.ask)
    assert [len(bands) for bands in found.values()] == [0, 0, 0, 0, 1, 0]
    assert [str(each.message) for each in told] == [
        "task hold-disc: method zz-raise cannot be asked for its bounds: ValueError: no luck",
        "task hold-disc: method zz-exit cannot be asked for its bounds: the process ended with exit code 0",
    ]


# ------------------------------------------------------------------------------------------------------- tasks

LATER = {
    "good": "def controller(self, state, t): return -state",
    "idle": "def controller(self, state, t): import time; time.sleep(600)",
    "gone": "def controller(self, state, t): import os; os._exit(0)",
    "torn": "def __init__(self, dt): raise RuntimeError('no\\nluck')",
    "left": "def __init__(self, dt): import os; os._exit(3)",
}


@pytest.fixture
def tasks(site: Callable[..., Path]) -> None:
    files = {"zz_tasks/__init__.py": ""}
    for name, line in LATER.items():
        files[f"zz_tasks/{name}/__init__.py"] = ""
        files[f"zz_tasks/{name}/system.py"] = f"{SYSTEM}    {line}\n"
        files[f"zz_tasks/{name}/task.yaml"] = text()
    entries = "\n".join(f"zz-{name} = zz_tasks.{name}.system:Line" for name in LATER)
    site("zz-tasks", f"[stlbench.tasks]\n{entries}", files)


def test_tasks_of_others_are_scored_in_processes_of_their_own(tasks: None) -> None:
    names = ("good", "gone", "torn", "left")
    settings = [Setting(Choice(f"zz-{name}"), Choice("raw"), Choice("dqn"), "smoke") for name in names]
    with pytest.warns(plugins.PluginWarning) as told:
        found = references(settings, plugin_guard.ask)
    known = [(name, each.by_hand is not None, each.at_random is not None) for name, each in found.items()]
    assert known == [("zz-good", True, True), ("zz-gone", False, True)]
    assert [str(each.message) for each in told] == [
        "task zz-torn: it cannot be loaded: RuntimeError: no luck",
        "task zz-left: it cannot be loaded: the process ended with exit code 3",
        "task zz-gone: its controller cannot be scored: the process ended with exit code 0",
    ]
    assert scale_of_task(Choice("zz-good"), plugin_guard.load_guarded).unit == "m"
    assert scale_of_task(Choice("zz-left"), plugin_guard.load_guarded).unit == UNKNOWN


@pytest.mark.slow
def test_a_controller_that_hangs_is_waited_for_no_longer_than_said(tasks: None) -> None:
    hangs, good = by_hand(Choice("zz-idle")), at_random(Choice("zz-idle"))
    assert plugin_guard.ask([hangs], SHORT) == [Unanswered(f"no result after {SHORT:g} s")]
    (score,) = plugin_guard.ask([good])
    assert not isinstance(score, Unanswered)


def test_a_task_that_cannot_be_loaded_is_refused_with_its_name(tasks: None) -> None:
    with pytest.raises(UsageError, match=r"^task zz-left: it cannot be loaded: the process ended with exit code 3$"):
        plugin_guard.load_guarded("zz-left")
    assert plugin_guard.load_guarded("zz-good[hold=2]").file.hold == 2
    with pytest.raises(UsageError, match="no task 'there-is-none'"):
        plugin_guard.load_guarded("there-is-none")


@dataclass(frozen=True)
class Outside:
    """A question about a function that is no plugin."""

    plugins = (("functions", "x:y"),)
    failed = "the film"

    def answer(self) -> int:
        raise MemoryError


def test_one_answer_on_which_all_depends_is_refused_with_what_was_asked() -> None:
    with pytest.raises(UsageError, match=r"^the film: MemoryError$"):
        plugin_guard.ask_one(Outside())
