"""Pictures of the MuJoCo tasks, where this machine can draw them, and what is said where it cannot."""

from __future__ import annotations

import builtins
from typing import Any

import numpy as np
import pytest

from stlbench.contract import Array
from stlbench.contract.presentation import Pixels
from stlbench.task import load_task, starts
from stlbench.task.task import Task

pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
OTHERS = ("ball-in-cup", "fetch-reach")


def first_states(task: Task, count: int = 2) -> Array:
    return task.system.initial_states(starts.grid(task.file.initial, count))


def picture(task: Task, state: Array) -> Pixels:
    try:
        found = task.system.frame(state)
    except RuntimeError as error:
        pytest.skip(str(error))
    assert found is not None
    return found


@pytest.mark.parametrize("name", ["cartpole", *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS)])
def test_a_picture_shows_something_and_depends_on_the_state_alone(name: str) -> None:
    task = load_task(name)
    first, second = first_states(task)
    shown = picture(task, first)
    assert (shown.shape, shown.dtype) == ((360, 480, 3), np.uint8)
    assert shown.std() > 10
    assert not np.array_equal(picture(task, second), shown)
    assert np.array_equal(picture(task, first), shown)


def test_up_is_up() -> None:
    """The pole is the one thing in the picture that is more red than blue."""
    task = load_task("cartpole")

    def row_of_pole(angle: float) -> float:
        shown = picture(task, task.system.initial_states(np.array([[0.0, angle, 0, 0]]))[0]).astype(int)
        return float(np.mean(np.nonzero(shown[..., 0] - shown[..., 2] > 50)[0]))

    assert row_of_pole(0.0) < row_of_pole(np.pi) - 50


def test_drawing_leaves_the_dynamics_alone() -> None:
    task = load_task("cartpole")
    state, action = first_states(task), np.full((2, 1), 0.3)
    before = task.system.step(state, action)
    picture(task, state[1])
    assert np.array_equal(task.system.step(state, action), before)


def test_without_egl_it_says_so_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    task, real = load_task("cartpole"), builtins.__import__

    def missing(name: str, *rest: Any) -> Any:
        if name == "mujoco.egl":
            raise AttributeError("'NoneType' object has no attribute\n'eglQueryString'")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(RuntimeError, match=r"^MuJoCo draws by EGL, which does not work here: 'NoneType' object .*$"):
        task.system.frame(first_states(task)[0])
