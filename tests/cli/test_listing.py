"""`stlbench list` and `stlbench show task`, on made-up plugins and on environments of Gymnasium."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from stlbench.registry import plugins


def test_methods_have_distribution_and_parameters_and_a_broken_plugin_is_a_warning(say, toy):
    done = say("list", "methods", "--json")
    assert done.exit_code == 0
    assert next(each for each in json.loads(done.stdout) if each["name"] == "toy-raw") == {
        **{"name": "toy-raw", "distribution": "toy-plugins", "version": "1.2", "summary": "One minus x."},
        "parameters": {"weight": {"type": "float", "default": 1.0}},
    }
    done = say("list", "methods")
    assert (done.exit_code, "toy-raw" in done.stdout) == (0, True)
    (line,) = [line for line in done.stderr.splitlines() if "toy-broken" in line]
    assert line.startswith("warning: method 'toy-broken' of toy-plugins 1.2")


def test_a_task_in_full_with_what_each_method_makes_of_it(say, toy):
    done = say("show", "task", "toy-line", "--json")
    found = json.loads(done.stdout)
    assert (found["title"], found["source"]) == ("Stay on a line", "made up")
    assert (found["distribution"], found["version"]) == ("toy-plugins", "1.2")
    assert (found["formula"], found["horizon"], found["sampling_time"]) == ("G[0,4] x <= 1", 4, 0.5)
    assert found["signals"] == {"x": {"low": -2.0, "high": 3.0, "unit": "m"}}
    (term,) = found["terms"]
    assert (term["formula"], term["rho_min"], term["rho_max"]) == ("G[0,4] x <= 1", pytest.approx(-2), pytest.approx(3))
    assert found["actions"]["v"] == {"low": -1.0, "high": 1.0, "unit": "", "count": 3}
    assert (found["controller"], found["robots"], found["training"]) == (None, {}, {"cuts": [], "ends": []})
    assert (found["features"], found["beyond_state"]) == ("engineered", [])
    assert found["own_agent"] == "toy-agent"
    quick = {"steps": 8, "seeds": 2, "deadline": 60.0, "checkpoints": 2, "resumable": False, "random_starts": 0}
    assert found["budgets"]["quick"] == quick
    assert found["protocols"]["end"]["formula"] == "F[4,4] x <= 1"
    assert found["agents"] == {"toy-agent": {"action": 1}}
    raw = found["methods"]["toy-raw"]
    assert (raw["status"], raw["inputs_added"], raw["weight"]) == ("suitable", 0, 1.0)
    assert found["methods"]["toy-large"] == {"status": "intractable", "reason": "needs 6003 inputs, limit 512"}
    assert "toy-broken" not in found["methods"]
    assert "toy-broken" in done.stderr


def test_on_the_track_auto_the_size_of_an_observation_is_told(say, toy):
    """The state, the time, and the margin over its range and at its near size."""
    done = say("show", "task", "toy-line", "--track", "auto")
    assert "\nseen:     4 numbers: " in done.stdout
    assert "the formula's view of margin of x <= 1\n" in done.stdout


ARRIVALS = """
from stlbench.contract import RewardMethod
class One(RewardMethod):
    more = 0
    def arrival(self, signals, t): return signals[..., 0] + self.more * t
class Two(One):
    more = 0.5
"""


def test_methods_that_pay_for_the_same(say, toy, site):
    entries = "[stlbench.methods]\ntoy-one = toy_arrivals:One\ntoy-two = toy_arrivals:Two\n"
    site("toy-arrivals", entries, {"toy_arrivals.py": ARRIVALS})
    found = json.loads(say("show", "task", "toy-line", "--json").stdout)["equal_rewards"]
    assert {"one": "toy-one", "other": "toy-two", "constant": None} in found
    assert all({pair["one"], pair["other"]} == {"toy-one", "toy-two"} for pair in found if "toy" in pair["one"])
    shown = say("show", "task", "toy-line").stdout
    assert "Equal rewards: toy-one is toy-two plus a function of time alone." in shown
    assert "ends early" not in shown
    path = toy / "toy_plugins/line/task.yaml"
    path.write_text(path.read_text() + "training: {ends: [{where: x > 2}]}\n")
    assert "If training episodes end early" in say("show", "task", "toy-line").stdout


def test_what_policies_see(say, toy):
    assert "seen:     features; the task does not say what they add\n" in say("show", "task", "toy-line").stdout
    alone = say("show", "task", "toy-line[without=features]")
    assert "seen:     the state alone, scaled\n" in alone.stdout
    lines = say("show", "task", "robot-nav").stdout.splitlines()
    assert any(line.startswith("seen:     features; beyond the state: which goal counts; distance") for line in lines)


def test_what_its_controller_and_baselines_get_and_what_is_best_known(say, toy, down):
    path = toy / "toy_plugins/line/task.yaml"
    best = {"robustness": 1.05, "how": "a plan", "upper_bound": 1.25, "why": "nobody goes faster"}
    assert "best:" not in say("show", "task", "toy-line").stdout
    path.write_text(f"{path.read_text()}best_known: {json.dumps(best)}\n")
    task = json.loads(say("show", "task", "toy-line", "--json").stdout)
    found, baselines = task["controller"], task["baselines"]
    mean, share, least = (found[name] for name in ("robustness_mean", "satisfaction", "robustness_min"))
    assert (share, 0.1 <= least < mean < 2) == (1, True)  # 1 - x_0 with x_0 in [-1, 0.9], also by standing still
    assert set(baselines) == {"trivial", "zero", "constant", "random"}
    zero, constant = baselines["zero"], baselines["constant"]
    assert (zero["satisfaction"], zero["robustness_mean"]) == (1, pytest.approx(constant["robustness_mean"]))
    assert (baselines["trivial"], task["best_known"]) == (True, best)
    lines = say("show", "task", "toy-line").stdout.splitlines()
    for line in (
        f"by hand:  robustness {mean:.3f}, worst start {least:.3f}, satisfied 100.0 %",
        f"zero:     robustness {zero['robustness_mean']:.3f}, satisfied 100.0 %",
        "trivial:  a constant action solves the task",
        "best:     robustness 1.05 is known, by a plan; at most 1.25, as nobody goes faster",
    ):
        assert line in lines


def test_a_controller_that_fails_is_a_warning(say, steer):
    steer(lambda state, t: 1 / 0)
    done = say("show", "task", "toy-line")
    assert (done.exit_code, "by hand" in done.stdout) == (0, False)
    line = "warning: task toy-line: its controller cannot be scored: ZeroDivisionError: division by zero"
    assert line in done.stderr.splitlines()


TRAINING = """
robots: {left: [v], right: [w]}
training:
  starts: {box: {x: [-0.5, 0.5]}}
  cuts: [2, 3]
  ends: [{where: violation}, {where: x >= 2}]
  exploring: {share: 0.5, kept: 0.25, states: {box: {x: [0, 2]}, where: x <= 1}, length: 2}
"""


@pytest.fixture
def richer(toy):
    """toy-line with two robots, continuous actions, all that training may have, and a second agent before its own."""
    path = toy / "toy_plugins/line/task.yaml"
    text = path.read_text().replace("{low: -1, high: 1, count: 3}", "{low: -1, high: 1}\n  w: {low: 0, high: 2}")
    path.write_text(text.replace("agents:", "agents:\n  z-first: {rate: 0.5}") + TRAINING)


def test_robots_and_training_on_screen(say, richer):
    text = say("show", "task", "toy-line").stdout
    assert "None" not in text
    lines = [" ".join(line.split()) for line in text.splitlines()]
    actions = ["Actions, continuous", "action low high unit", "left v", "right w"]
    training = ["starts x in [-0.5, 0.5]", "cuts 2, 3", "ends where: violation", "where: x >= 2"]
    exploring = ["exploring share: 0.5", "kept: 0.25", "states: x in [0, 2], where x <= 1", "length: 2"]
    assert {*actions, *training, *exploring} <= {*lines}
    first = lines.index("Recipes, the task's own agent first") + 3
    assert lines[first : first + 2] == ["z-first rate: 0.5", "toy-agent action: 1"]


TORN = """
from stlbench.contract import RewardMethod
class Raises(RewardMethod):
    def __init__(self, specification): raise RuntimeError("no\\nluck")
    def arrival(self, signals, t): return signals[..., 0]
class Says(RewardMethod):
    def arrival(self, signals, t): raise IndexError("too far")
    def describe(self): raise KeyError("what")
"""


def test_a_method_of_others_that_raises_breaks_no_command_about_a_task(say, toy, site):
    entries = "[stlbench.methods]\nzz-raises = zz_torn:Raises\nzz-says = zz_torn:Says\n"
    site("zz-torn", entries, {"zz_torn.py": TORN})
    done = say("show", "task", "toy-line", "--json")
    methods = json.loads(done.stdout)["methods"]
    assert methods["zz-raises"] == {"status": "raised", "reason": "RuntimeError: no luck"}
    assert methods["zz-says"] == {"status": "raised", "reason": "KeyError: 'what'"}
    said = "warning: task toy-line: method {} cannot be asked what it pays: {}"
    lines = done.stderr.splitlines()
    assert said.format("zz-raises", "RuntimeError: no luck") in lines
    assert methods["toy-raw"]["status"] == "suitable"
    assert say("show", "task", "toy-line").exit_code == 0
    refused = json.loads(say("advise", "toy-line", "--json").stdout)["do_not_fit"]
    assert {"method": "zz-raises", "status": "raised", "reason": "RuntimeError: no luck"} in refused


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("return state\n", "return 1 / 0\n", "error: task 'toy-line' of toy-plugins 1.2 raised ZeroDivisionError: "),
        ("return state\n", "return None\n", "`stlbench check toy-line` says which rule it breaks"),
    ],
)
def test_a_task_of_others_that_breaks_is_one_line(say, toy, old: str, new: str, said: str) -> None:
    path = toy / "toy_plugins/line/system.py"
    path.write_text(path.read_text().replace(old, new, 1))
    done = say("show", "task", "toy-line", "--track", "auto")
    assert done.exit_code == 2
    assert said in done.stderr.splitlines()[-1]


ROOT = Path(__file__).parents[2]
POLE = """
title: Keep a pole upright in the middle
source: Gymnasium's CartPole-v1
environment:
  id: CartPole-v1
  names: [x, v, theta, omega]
formula: G[0,4] (abs(theta) <= 0.1 & distance <= 1)
sampling_time: 0.02
steps: 4
signals:
  theta: {low: -0.25, high: 0.25, unit: rad}
  distance: {low: 0, high: 2.5, expression: abs(x)}
starts: 2
agents:
  dqn: {}
budgets:
  smoke: {steps: 16, seeds: 1, deadline: 60, checkpoints: 2, random_starts: 0}
"""


@pytest.fixture
def pole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a task whose signals differ in their keys."""
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    folder = tmp_path / "zz-shown-pole"
    folder.mkdir()
    (folder / "task.yaml").write_text(POLE, encoding="utf-8")
    return folder


def test_a_key_that_a_later_signal_has_is_a_column_for_all(say: Callable[..., Result], toy: Path, pole: Path) -> None:
    done = say("show", "task", pole)
    assert done.exit_code == 0
    lines = [line.split() for line in done.stdout.splitlines()]
    first = lines.index(["Signals"]) + 1
    assert lines[first] == ["signal", "low", "high", "unit", "expression"]
    assert lines[first + 2] == ["theta", "-0.25", "0.25", "rad", "-"]
    assert lines[first + 3] == ["distance", "0", "2.5", "abs(x)"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "library", "part"), [("gym-pendulum", "gymnasium", "atan2(y, x)"), ("dm-balance", "shimmy", "cosine")]
)
def test_every_example_is_shown(say: Callable[..., Result], toy: Path, name: str, library: str, part: str) -> None:
    pytest.importorskip(library, reason=f"the example needs {library}")
    shown = say("show", "task", ROOT / "examples" / name)
    assert shown.exit_code == 0
    assert part in shown.stdout
