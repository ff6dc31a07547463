"""A made-up distribution with one of each kind of plugin: cells of it take milliseconds and run in this process."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from stlbench.cli import app
from stlbench.records.result_files import write
from stlbench.report.figures import trace_figures
from stlbench.report.figures.files import Drawing
from stlbench.search import outputs
from stlbench.study import film

ENTRIES = """
[stlbench.methods]
toy-raw = toy_plugins.methods:Raw
toy-large = toy_plugins.methods:Large
toy-wrong = toy_plugins.methods:Wrong
toy-broken = toy_plugins.missing:Nothing
[stlbench.tasks]
toy-line = toy_plugins.line.system:Line
[stlbench.agents]
toy-agent = toy_plugins.agents:Still
[stlbench.executors]
toy-here = toy_plugins.executors:Here
"""

TASK = """
title: Stay on a line
source: made up
formula: G[0,4] (x <= 1)
sampling_time: 0.5
steps: 4
signals:
  x: {low: -2, high: 3, unit: m}
actions:
  v: {low: -1, high: 1, count: 3}
initial:
  box: {x: [-1, 0.9]}
starts: 8
protocols:
  end: {title: at the end, formula: "F[4,4] x <= 1", starts: 8}
agents:
  toy-agent: {action: 1}
budgets:
  quick: {steps: 8, seeds: 2, deadline: 60, checkpoints: 2, random_starts: 0}
"""

SYSTEM = '''
from stlbench.contract import System

class Line(System):
    """x' = x + dt v."""
    state = ("x",)
    def step(self, state, action): return state + self.dt * action
    def signals(self, state): return state
    def features(self, state, t): return state
'''

METHODS = '''
import numpy as np
from stlbench.contract import Intractable, RewardMethod

class Raw(RewardMethod):
    """One minus x."""
    def __init__(self, specification, *, weight: float = 1.0):
        super().__init__(specification)
        self.weight = weight
    def along(self, samples, action, t, memory):
        return self.weight * (1 - samples[1:, :, 0]), memory
    def describe(self): return {"weight": self.weight}

class Large(Raw):
    """Never fits."""
    def __init__(self, specification):
        raise Intractable("needs 6003 inputs, limit 512")

class Wrong(Raw):
    """Raises."""
    def along(self, samples, action, t, memory):
        raise ValueError("no [such] luck")
'''

AGENTS = '''
import numpy as np
from stlbench.contract import Agent, Policy

interrupt_after = None

class Always(Policy):
    def __init__(self, action): self.action = action
    def act(self, observation): return np.full(len(observation), self.action)
    def arrays(self): return {"action": np.array(self.action)}

class Still(Agent):
    """Learns nothing: its policy takes one action."""
    def __init__(self, *, action: int = 0): self.action = action
    @classmethod
    def restore(cls, arrays, actions): return Always(int(arrays["action"]))
    def train(self, training):
        global interrupt_after
        if interrupt_after is not None:
            interrupt_after -= 1
            if interrupt_after < 0:
                raise KeyboardInterrupt
        environment = training.make(2)
        environment.reset()
        for _ in range(training.steps // 2):
            environment.step(np.array([self.action, self.action]))
        policy = Always(self.action)
        training.report(policy, training.steps)
        return policy
'''

EXECUTORS = '''
from stlbench.contract import Executor, Outcome

class Here(Executor):
    """In this process."""
    def __init__(self, *, jobs: int = 1): super().__init__(jobs=jobs)
    def run(self, function, items, deadlines):
        for index, item in enumerate(items):
            try:
                yield Outcome(index, "done", function(item))
            except Exception as error:
                yield Outcome(index, "raised", reason=f"{type(error).__name__}: {error}")
'''


@pytest.fixture
def drawn() -> None:
    """Let commands draw figures."""


@pytest.fixture(autouse=True)
def undrawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write empty files as figures and films, unless a test asks for `drawn`: to draw takes most of the time."""
    if "drawn" not in request.fixturenames:
        monkeypatch.setattr(Drawing, "write", lambda drawing, folder: _placeholders(None, folder, drawing.name))
        for module in (outputs, film, trace_figures):
            monkeypatch.setattr(module, "save", _placeholders)
        monkeypatch.setattr(film, "write", lambda *arguments: write(arguments[4], b"") and "")


def _placeholders(figure: object, folder: Path, name: str) -> list[Path]:
    return [write(folder / f"{name}.{end}", b"") for end in ("png", "svg", "pdf")]


@pytest.fixture
def toy(site: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the distribution `toy-plugins`. Its methods are asked, and its results looked at, in this process."""
    monkeypatch.setattr("stlbench.study.plugin_guard.EXECUTOR", "toy-here")
    monkeypatch.setattr("stlbench.study.credibility.APART", False)
    files = {"__init__": "", "line/__init__": "", "line/system": SYSTEM, "methods": METHODS, "agents": AGENTS}
    files = {f"toy_plugins/{name}.py": text for name, text in (files | {"executors": EXECUTORS}).items()}
    return site("toy-plugins", ENTRIES, files | {"toy_plugins/line/task.yaml": TASK})


@pytest.fixture
def steer(toy: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Any, Any], Any]], None]:
    """Give toy-line a controller: an action from the state and the step."""

    def install(controller: Callable[[Any, Any], Any]) -> None:
        system = importlib.import_module("toy_plugins.line.system").Line
        monkeypatch.setattr(system, "controller", lambda self, state, t: controller(state, t))

    return install


@pytest.fixture
def down(steer: Callable[[Callable[[Any, Any], Any]], None]) -> list[int]:
    """Give toy-line a controller that always goes down, so that robustness is 1 - x_0; at which steps it was asked."""
    asked = list[int]()

    def controller(state: Any, t: Any) -> Any:
        asked.append(int(t[0]))
        return 0 * state - 1

    steer(controller)
    return asked


@pytest.fixture
def say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Say a command, its words as arguments, in an empty folder."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)

    def invoke(*words: object, stdin: str | None = None) -> Result:
        found = CliRunner().invoke(app, [str(word) for word in words], input=stdin)
        if found.exception and not isinstance(found.exception, SystemExit):
            raise found.exception
        return found

    return invoke


TOY = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--executor", "toy-here")


@pytest.fixture
def once(say: Callable[..., Result], toy: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., None]:
    """Say a command once for all tests of a process; the others get a copy of the files that it wrote."""

    def said(*words: str) -> None:
        kept = tmp_path_factory.getbasetemp() / "once" / " ".join(words).replace("/", ":")
        if kept.is_dir():
            shutil.copytree(kept, Path.cwd(), dirs_exist_ok=True)
        else:
            done = say(*words)
            assert done.exit_code == 0, done.output
            shutil.copytree(Path.cwd(), kept)

    return said


@pytest.fixture
def ran(once: Callable[..., None]) -> None:
    """A folder `results` with two finished cells, the seeds 0 and 1 of toy-raw."""
    once(*TOY, "--methods", "toy-raw")
