"""A policy that acts again before the camera of an environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers.walk_env import Walk
from helpers.walk_task import Made, WalkTask, walk

from stlbench.contract import Array, GymTask, Integers, Policy
from stlbench.registry.choices import Choice
from stlbench.study.policies import Reenactment
from stlbench.task import build_method
from stlbench.task.task import Task


class Right(Policy):
    """Goes right by half a unit a step."""

    def act(self, observation: Array) -> Integers:
        return np.full(len(observation), 2)


def acting(task: Task) -> Reenactment:
    return Reenactment(task, build_method(task, Choice("raw")), Right(), np.array([[0.0], [1.0]]))


def test_pictures_are_those_of_the_last_decision_before_a_sample() -> None:
    """The walk draws x + 100, whole numbers alone; it begins at 0."""
    film = acting(walk(hold=2))
    shown = [[int(picture[0, 0, 0]) for picture in film(sample)] for sample in (0, 1, 2, 3, 8)]
    assert shown == [[100, 100], [100, 100], [101, 101], [101, 101], [104, 104]]


def test_what_went_another_way_than_was_recorded_is_known() -> None:
    film, recorded = acting(walk()), np.tile(np.arange(9)[:, None] / 2, (2, 1, 1))
    film(5)
    assert film.repeats(recorded)
    recorded[1, 7] = 9  # later than what was shown
    assert film.repeats(recorded)
    recorded[1, 4] = 9
    assert not film.repeats(recorded)


def test_after_an_early_end_the_last_picture_stays() -> None:
    film = acting(walk(WalkTask(wall=1.0), terminated="violated"))
    assert [int(film(sample)[0][0, 0, 0]) for sample in (0, 8)] == [100, 101]
    ended = np.tile(np.array([0, 0.5, 1, *[np.nan] * 6])[:, None], (2, 1, 1))
    assert film.repeats(ended)


def having(**attributes: Any) -> Made:
    """A task whose walk has these attributes."""

    def make() -> Walk:
        env = Walk()
        vars(env).update(attributes)
        return env

    return Made(make)


class Torn(Walk):
    def render(self) -> Any:
        raise OSError("no driver\nat all")


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (WalkTask(), ""),
        (
            having(render_mode=None),
            "it was not made with the render mode rgb_array; make() should pass on self.render_mode",
        ),
        (having(metadata={"render_modes": []}), "the environment has no render mode rgb_array"),
        (Made(Torn), "the environment cannot draw itself here: OSError: no driver at all"),
    ],
)
def test_why_an_environment_has_no_pictures(kind: GymTask, said: str) -> None:
    assert walk(kind).source.undrawn == said


def test_a_class_is_told_what_its_copies_are_for() -> None:
    made = []

    class Told(WalkTask):
        def make(self) -> gymnasium.Env[Any, Any]:
            made.append(self.render_mode)
            return Walk()

    acting(walk(Told()))
    assert made == [None, "rgb_array", "rgb_array"]
