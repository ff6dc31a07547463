"""The cart-pole of the DeepMind control suite, sec. IV of the paper; and tasks whose extra is not installed."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from helpers.mujoco_task import rollout

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.task import load_task

TASK = load_task("cartpole")


def test_robustness_by_hand() -> None:
    """At 0.5 and -0.6, leaning 0.03 and turning by -0.2: the formula's least margin and the rewarded form's."""
    trace = np.zeros((1, 1001, 3))
    trace[0, :501, 0], trace[0, 501:, 0] = 0.5, -0.6
    trace[0, :, 1:] = 0.03, -0.2
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0.07)  # of 0.2, 0.1, 0.07, 0.3
    assert stl.robustness(TASK.specification.formula, trace, TASK.signals) == pytest.approx(0.05)  # half of 0.1
    trace[0, 450, 2] = 0.7
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(-0.2)
    assert stl.robustness(TASK.specification.formula, trace, TASK.signals) == pytest.approx(-0.04)


def test_rewards_of_all_conjuncts_are_of_one_size() -> None:
    """From -1.05, at the far end of the rail, to 0.1; theta and omega reach -0.7 each."""
    for term in TASK.specification.terms:
        assert TASK.specification.range(term.psi) == pytest.approx((-1.05, 0.1))


def test_steps_are_those_of_the_suite_bit_for_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    from dm_control import suite

    environment = suite.load("cartpole", "balance", task_kwargs={"random": 3})
    environment.reset()
    data = environment.physics.data
    start = TASK.system.initial_states(np.concatenate([data.qpos, data.qvel])[None])[0]
    actions = np.random.default_rng(0).uniform(-1, 1, (200, 1))
    ours = rollout(TASK, start, actions)
    for action, state in zip(actions, ours, strict=True):
        environment.step(action)
        assert np.array_equal(state[:4], np.concatenate([data.qpos, data.qvel]))
    assert abs(ours[:, 1]).max() > math.pi / 2  # the pole has fallen: not just the start of an episode


def test_states_and_signals() -> None:
    state = TASK.system.initial_states(np.array([[0.1, 0.2, -0.3, 0.4], [0, 2 * math.pi - 0.3, 0, 0]]))
    assert state[0, :4].tolist() == [0.1, 0.2, -0.3, 0.4]
    assert TASK.system.signals(state) == pytest.approx(np.array([[0.1, 0.2, 0.4], [0, -0.3, 0]]))


@pytest.mark.parametrize("missing", ["mujoco", "dm_control"])
def test_without_the_extra_one_line_says_what_to_install(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    said = r"it needs the extra mujoco: pip install \"stlbench-rl\[mujoco\]\""
    with pytest.raises((UsageError, ImportError), match=said):
        load_task("cartpole")


def test_tasks_can_be_listed_without_the_extra() -> None:
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from stlbench.registry import plugins; loaded, problems = plugins.loadable('tasks')\n"
        "assert {'cartpole', 'ball-in-cup', 'fetch-reach'} <= loaded.keys(), problems"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
