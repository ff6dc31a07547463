"""Names of entries of Gymnasium's observations, checked against the environments."""

from __future__ import annotations

import gymnasium
import pytest
from gymnasium.spaces import Box, Dict

from stlbench import stl
from stlbench.task.gym_sketch import _ALIKE, _OF, _entries, names_of


@pytest.mark.parametrize("name", sorted({*_OF, *_ALIKE}))
def test_each_listed_environment_gets_a_name_for_each_entry(name: str) -> None:
    newest = max(
        (spec for spec in gymnasium.registry.values() if spec.name == name and not spec.namespace),
        key=lambda spec: spec.version or 0,
    )
    try:
        env = gymnasium.make(newest.id)
    except gymnasium.error.DependencyNotInstalled as missing:
        pytest.skip(str(missing))
    count = env.observation_space.shape[0]
    names = names_of(newest.id, count)
    assert names is not None
    assert len(set(names)) == count


@pytest.mark.parametrize("identifier", ["Ant-v5", "Humanoid-v5", "Hopper-v5", "HalfCheetah-v5", "Walker2d-v5"])
def test_joints_stand_in_the_order_of_the_mujoco_model(identifier: str) -> None:
    """An entry that is moved alone in the simulator moves in the observation under its joint's name."""
    pytest.importorskip("mujoco")
    env = gymnasium.make(identifier).unwrapped
    env.reset(seed=0)
    names = names_of(identifier, env.observation_space.shape[0])
    assert names is not None
    model, position = env.model, env.data.qpos.copy()
    joints = [model.joint(place) for place in range(model.njnt)]
    hinges = [joint for joint in joints if joint.name not in {"root", "rootx", "rootz", "rooty"}]
    for joint in hinges:
        moved, speeds = position.copy(), env.data.qvel.copy() * 0
        moved[joint.qposadr[0]] += 0.01
        speeds[joint.dofadr[0]] = 0.5
        env.set_state(position, speeds * 0)
        before = env._get_obs().copy()
        env.set_state(moved, speeds)
        differ = [name for name, a, b in zip(names, before, env._get_obs(), strict=True) if a != b][:2]
        assert differ[1] == f"v_{differ[0]}"
        assert differ[0].startswith("left_") == ("left" in joint.name)
        assert differ[0].removeprefix("left_") in joint.name.replace("left_", "")


def test_the_entries_of_a_draft_have_names_that_formulas_can_have() -> None:
    pair, one = Box(-1, 1, (2,)), Box(-1, 1, (1,))
    space = Dict({"a": pair, "a1": one, "1st": pair, "min": one, "pi": one, "²": one, "x y": one, "F": one, "": one})
    names, ends = _entries(space, "Made-v0")
    assert names == {
        "a": ["a0", "a1"],
        "a1": ["a1_"],
        "1st": ["o_1st0", "o_1st1"],
        "min": ["o_min"],
        "pi": ["o_pi"],
        "²": ["_"],
        "x y": ["x_y"],
        "F": ["F"],
        "": ["o_"],
    }
    assert all([*stl.signals(stl.parse(f"G[0,3] abs({name}) <= 0.5"))] == [name] for name in ends)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(0.99999, 1.0, (0.99999, 1.0)), (-4.8000002, 4.8000002, (-4.8, 4.8)), (0.0, 1e38, (0.0, None))],
)
def test_the_ends_of_a_draft_are_round_unless_they_are_equal_then(low: float, high: float, expected: object) -> None:
    assert _entries(Box(low, high, (1,), "float64"), "Made-v0")[1] == {"o": expected}
