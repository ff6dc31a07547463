"""Names of entries of Gymnasium's observations, checked against the environments."""

from __future__ import annotations

import gymnasium
import pytest

from stlbench.task.gym_sketch import _ALIKE, _OF, names_of


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
