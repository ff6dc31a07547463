"""Methods of others are asked what they pay in processes of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.result import Setting
from stlbench.rollout.standards import Question, ask_here, standards
from stlbench.study import asked

METHODS = """
import os, signal, time
from stlbench.contract import RewardMethod, Unsuitable
class Same(RewardMethod):
    paid_on_arrival = True
    def arrival(self, signals, t):
        self.do()
        return signals[..., 0] + 1
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
"""
NAMES = ("same", "hang", "exit", "die", "raise", "eat", "refuse", "text")
ENTRIES = "[stlbench.methods]\n" + "\n".join(f"zz-{name} = zz_asked:{name.capitalize()}" for name in NAMES)


@pytest.fixture
def bad(site: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    site("zz-asked", ENTRIES, {"zz_asked.py": METHODS})
    monkeypatch.setattr(asked, "EXECUTOR", "local[memory=400M]")
    monkeypatch.setattr(asked, "DEADLINE", 25.0)


def test_each_costs_its_own_answer_alone_and_the_report_says_why(bad: None) -> None:
    methods = ["raw", *(f"zz-{name}" for name in NAMES)]
    with pytest.warns(plugins.PluginWarning) as told:
        found = standards(
            (Setting(Choice("hold-disc"), Choice(method), Choice("dqn"), "quick") for method in methods), asked.ask
        )["hold-disc"]
    said = {str(each.message).split(": ")[1].split(" ")[1]: str(each.message).split("pays: ")[1] for each in told}
    assert said.pop("zz-eat").startswith("it took ")
    assert "its rewards should be numbers of shape (200, 256), got <U4 of shape ()" in said.pop("zz-text")
    assert said == {
        "zz-hang": "no result after 25 s",
        "zz-exit": "the process ended with exit code 0",
        "zz-die": "killed by signal 9 (SIGKILL)",
        "zz-raise": "ValueError: no luck",
    }
    assert found.by_hand is not None


def test_what_others_pay_is_the_same_as_in_this_process(bad: None) -> None:
    questions = [
        Question(Choice("hold-disc"), track, name) for track in ("shared", "plain") for name in ("raw", "zz-same")
    ]
    assert [str(answer) for answer in asked.ask(questions)] == [str(answer) for answer in ask_here(questions)]
    assert asked.ask([Question(Choice("hold-disc"), "shared", "there-is-none")]) == [None]
