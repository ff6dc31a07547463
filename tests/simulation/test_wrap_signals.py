"""Signals from observations and infos, and what is said of those that are none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete

from stlbench.errors import UsageError
from stlbench.simulation.gymnasium.scoring import Reader
from stlbench.task.gym_spaces import Expressions, entries_of

LINE = Box(-1, 1, (2,), np.float32)
BOTH = Dict({"arm": LINE, "gripper": Discrete(2), "camera": Box(0, 255, (8, 8, 3), np.uint8)})


def test_entries_of_a_dict_come_key_by_key() -> None:
    entries = entries_of(BOTH, {"gripper": ["open"], "arm": ["x", "y"]})
    one = {"arm": np.array([3.0, 4.0]), "gripper": 1, "camera": None}
    assert (entries.names, entries.read(one, 1).tolist()) == (("open", "x", "y"), [[1.0, 3.0, 4.0]])
    many = {"arm": np.array([[3.0, 4.0], [5.0, 6.0]]), "gripper": np.array([1, 0]), "camera": None}
    assert entries.read(many, 2).tolist() == [[1.0, 3.0, 4.0], [0.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("space", "names", "message"),
    [
        (LINE, ("x",), "names: 1 for the observation, which has 2 entries"),
        (LINE, ("x", "x"), "names: 'x' stands for two entries"),
        (LINE, "xy", "names: expected a list of names, got the text 'xy'"),
        (LINE, {"arm": ("x", "y")}, "names: the observation is no Dict"),
        (BOTH, ("x", "y"), r"names: the observation is a Dict; give a mapping, \{key: names of its entries\}"),
        (BOTH, {"arms": ("x", "y")}, "names: the observation has no 'arms'; did you mean 'arm'"),
        (BOTH, {"arm": ("x", "y", "z")}, "names: 3 for 'arm', which has 2 entries"),
    ],
)
def test_names_that_do_not_fit(space: Any, names: Any, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        entries_of(space, names)


def over_the_line(texts: dict[str, str]) -> Reader:
    return Reader(Expressions(texts, entries_of(LINE, ("x", "y"))), tuple(texts), LINE)


def test_expressions_over_observation_and_info() -> None:
    reader = over_the_line({"angle": "atan2(y, x)", "height": "z - 0.5"})
    found = reader.one(np.array([0.0, 2.0]), {"z": np.float32(1.5)}, 0)
    np.testing.assert_allclose(found, [[np.pi / 2, 1.0]])
    infos = {"z": np.array([1.5, 0.5]), "_z": np.array([True, True])}
    found = reader.many(np.array([[0.0, 2.0], [-1.0, 0.0]]), infos, np.array([3, 4]))
    np.testing.assert_allclose(found, [[np.pi / 2, 1.0], [np.pi, 0.0]])
    infos["_z"][1] = False
    with pytest.raises(UsageError, match="no 'z' at step 4 of copy 1: the observation has x, y, the info nothing"):
        reader.many(np.zeros((2, 2)), infos, np.array([3, 4]))


def test_entries_without_names_are_said_to_need_them() -> None:
    rule = r"name all entries of the observation by names=\('x', 'y'\)"
    with pytest.raises(UsageError, match=rf"^signals\.d: {rule}; line 1, column 9: expected"):
        Expressions({"d": "norm(obs[0], obs[1])"}, entries_of(LINE, None))
    reader = Reader(Expressions({"d": "obs_0"}, entries_of(LINE, None)), ("d",), LINE)
    with pytest.raises(
        UsageError, match=f"no 'obs_0' at step 0: the observation has no names, the info nothing; {rule}$"
    ):
        reader.one(np.zeros(2), {}, 0)


@pytest.mark.parametrize(
    ("text", "info", "message"),
    [
        ("w", {"z": 1}, "signals: no 'w' at step 3: the observation has x, y, the info z"),
        ("z", {"z": "far"}, "signals: 'z' of the info is no number at step 3, but 'far'"),
        ("z", {"z": np.zeros(2)}, r"signals: 'z' of the info is no number at step 3, but array\(\[0., 0.\]\)"),
        ("sqrt(x)", {}, "signals: s is nan at step 3"),
        ("y / (x + 1)", {}, "signals: s is nan at step 3"),
    ],
)
def test_expressions_without_a_value(text: str, info: dict[str, Any], message: str) -> None:
    reader = over_the_line({"s": text})
    with pytest.raises(UsageError, match=message):
        reader.one(np.array([-1.0, 0.0]), info, 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x <= 1", "signals.s: line 1, column 1: expected an arithmetic expression but found a formula"),
        ("__import__('os')", "signals.s: line 1"),
        (3, "^signals.s: expected an expression as text, such as 'x - y', got 3$"),
        (lambda observation, info: 0.0, "^signals.s: expected an expression .*, got a function; one"),
        ("x / 0", "signals: .*divides by 0"),
    ],
)
def test_expressions_that_are_none(text: Any, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Expressions({"s": text}, entries_of(LINE, ("x", "y")))


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        ({"a": 1}, "signals: the function returned a at step 3; ranges has a, b"),
        ({"a": 1, "b": 2, "c": 3}, "signals: the function returned a, b, c at step 3; ranges has a, b"),
        ((1, 2), r"signals: expected name -> number at step 3, got \(1, 2\)"),
        ({"a": 1, "b": "far"}, "signals: the function returned no numbers at step 3"),
        ({"a": 1, "b": np.nan}, "signals: b is nan at step 3"),
        ({"a": -np.inf, "b": 1}, "signals: a is -inf at step 3"),
    ],
)
def test_a_function_that_returns_something_else(returned: Any, message: str) -> None:
    reader = Reader(lambda observation, info: returned, ("a", "b"), LINE)
    with pytest.raises(UsageError, match=message):
        reader.one(np.zeros(2), {}, 3)


def test_a_function_may_return_signals_in_any_order() -> None:
    reader = Reader(lambda observation, info: {"b": 2, "a": observation[0]}, ("a", "b"), LINE)
    assert reader.one(np.array([1.0, 0.0]), {}, 0).tolist() == [[1.0, 2.0]]
