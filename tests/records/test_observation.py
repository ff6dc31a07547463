"""Which numbers a task says that it shows to policies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from helpers.walk_task import WalkTask, walk

from stlbench.errors import UsageError
from stlbench.records.observation import Observation
from stlbench.simulation.baselines import Unpaid
from stlbench.simulation.worlds import observation_of
from stlbench.task import Task, build_method, load_task


def shown(task: Task) -> Observation:
    return observation_of(task, Unpaid(task.specification))


@pytest.mark.parametrize(
    ("entry", "kind", "names"),
    [
        ({"names": ["x", "minus"]}, "vector", ("x", "minus")),
        ({"names": {"place": ["x", "y"]}}, "dict", ("", "x", "y")),
        ({"names": {"place": ["x", "y"], "mirror": ["a"]}}, "dict", ("a", "x", "y")),
        ({}, "vector", ("", "")),
    ],
)
def test_of_an_environment(entry: dict[str, Any], kind: str, names: tuple[str, ...]) -> None:
    given = {"signals": {"doubled": {"low": -10, "high": 10}}, "formula": "G[0,4] doubled <= 1"}
    found = shown(walk(WalkTask(kind=kind), environment=entry, **given))
    assert (found.names, found.reach, found.steps) == (names, (50.0,) * len(names), 8)


def test_of_a_system() -> None:
    whole, bare = (shown(load_task(name)) for name in ("hold-disc", "hold-disc[without=features]"))
    assert whole.names[: len(bare.names)] == bare.names
    more = ("where the centre is, ahead and to the left", "a close-up of the last decimetres")
    assert whole.names[len(bare.names) :] == more


def test_with_the_inputs_of_a_method() -> None:
    task = load_task("hold-disc")
    found = observation_of(task, build_method(task, "flag"), "flag")
    assert (found.inputs, found.method, found.total) == (1, "flag", shown(task).total + 1)
    assert str(found).endswith("; the time from -1 to 1 in 200 steps; 1 input of flag")


POLE = Observation(2, ("angle", "omega"), (0.0, 1.0), (1.0, 4.0), 200, task="pole")


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (POLE, None),
        (replace(POLE, task="other", version="9"), None),
        (replace(POLE, names=("", "")), None),
        (replace(POLE, names=("angle", "v")), "observe omega, which task pole does not show"),
        (replace(POLE, names=("omega", "angle")), "observe the same in another order than task pole shows it"),
        (replace(POLE, reach=(1.0, 8.0)), r"observe \(omega - 1\) / 4; here is \(omega - 1\) / 8"),
        (replace(POLE, middle=(-2.0, 1.0)), r"observe angle; here is angle \+ 2"),
        (replace(POLE, steps=100), "observe the time from -1 to 1 in 200 steps; here is the time from -1 to 1 in 100"),
        (POLE.unscaled, r"observe \(omega - 1\) / 4; here is omega"),
        (replace(POLE, inputs=2, method="flag"), "observe 0 inputs of a method; here are 2"),
        (Observation(3, steps=200), "observe 2 numbers beside the time; here are 3"),
        (Observation(2, steps=200), r"observe angle, \(omega - 1\) / 4; here are 2 features"),
    ],
)
def test_the_first_difference_is_told(other: Observation, message: str | None) -> None:
    assert Observation.of_facts("p", POLE.facts) == POLE
    if message is None:
        POLE.check("p", other)
        return
    with pytest.raises(UsageError, match=f"^p: it was trained on pole to {message}"):
        POLE.check("p", other)


def test_inputs_of_another_method() -> None:
    flag = replace(POLE, inputs=1, method="flag")
    with pytest.raises(UsageError, match="to observe inputs of method flag; say --method 'flag'"):
        flag.check("p", POLE)
    replace(flag, method="").check("p", flag)


@pytest.mark.parametrize("facts", ["{", "[]", '{"size": "many"}', '{"size": 2, "middle": [0], "reach": [1]}', 3])
def test_a_record_that_is_none(facts: object) -> None:
    with pytest.raises(UsageError, match=r"^p: its stlbench_observation is no record: [^\n]*$"):
        Observation.of_facts("p", facts)
