"""Pictures of the tasks as Gymnasium environments."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from helpers.line_task import text

import stlbench.gym
from stlbench.gym import StlEnv, StlVectorEnv


class TestRender:
    """`rgb_array` where the task's system draws itself; else a warning and None, as Gymnasium does."""

    @pytest.mark.parametrize("mode", ["rgb_array", "human"])
    def test_a_task_without_a_picture_falls_back(self, mode: str) -> None:
        with pytest.warns(UserWarning, match=f"task hold-disc renders nothing.*in place of '{mode}'"):
            env = StlEnv("hold-disc", "funnel", render_mode=mode)
        assert (env.render_mode, env.metadata["render_modes"]) == (None, [])
        env.reset(seed=0)
        assert env.render() is None

    def test_a_task_with_a_picture_of_the_current_state(self, drawn: StlEnv) -> None:
        assert (drawn.render_mode, drawn.metadata) == ("rgb_array", {"render_modes": ["rgb_array"], "render_fps": 2})
        drawn.reset(options={"state": [3]})
        picture = drawn.render()
        assert picture is not None
        assert (picture.shape, picture.dtype, picture[0, 0, 0]) == ((4, 6, 3), np.uint8, 3)

    def test_through_make_gymnasiums_own_checks_are_content(self, drawn: StlEnv) -> None:
        with warnings.catch_warnings(action="error"):
            env = gymnasium.make("stlbench/zz-drawn-v0", method="raw", render_mode="rgb_array")
            env.reset(seed=0)
            for _ in range(3):
                env.step(env.action_space.sample())
            env.render()
        with pytest.warns(UserWarning, match="renders rgb_array alone; render_mode is None, in place of 'ansi'"):
            assert gymnasium.make("stlbench/zz-drawn-v0", method="raw", render_mode="ansi").render_mode is None

    def test_an_environment_draws_itself(self, tmp_path: Path) -> None:
        pytest.importorskip("pygame", reason="Gymnasium draws a cart-pole with pygame")
        (tmp_path / "pole").mkdir()
        (tmp_path / "pole" / "task.yaml").write_text(
            "{title: a, source: b, environment: {id: CartPole-v1, names: [x, v, theta, omega]}, formula: G x <= 1,"
            " sampling_time: 0.02, steps: 20, signals: {x: {low: -3, high: 3}}, agents: {dqn: {}},"
            " budgets: {smoke: {steps: 40}}}"
        )
        env = StlEnv(f"{tmp_path}/pole", "raw", render_mode="rgb_array")
        env.reset(seed=0)
        before = env.render()
        for _ in range(6):
            env.step(np.int64(1))
        after = env.render()
        assert before is not None
        assert before.shape == (400, 600, 3)
        assert after is not None
        assert not np.array_equal(before, after)
        assert StlEnv(f"{tmp_path}/pole", "raw").render() is None

    def test_copies_in_lock_step_have_a_picture_each(self, drawn: StlEnv) -> None:
        envs = StlVectorEnv(2, "zz-drawn", "raw", render_mode="rgb_array")
        envs.reset(options={"state": [[1], [2]]})
        pictures = envs.render()
        assert pictures is not None
        assert [picture[0, 0, 0] for picture in pictures] == [1, 2]
        assert StlVectorEnv(2, "zz-drawn", "raw").render() is None

    def test_stable_baselines_makes_either(self, drawn: StlEnv) -> None:
        """It always asks for pictures, by `gymnasium.make(..., render_mode="rgb_array")`."""
        from stable_baselines3.common.env_util import make_vec_env

        with pytest.warns(UserWarning, match="task hold-disc renders nothing"):
            plain = make_vec_env("stlbench/hold-disc-v0", 2, seed=0, env_kwargs={"method": "funnel"})
        assert (plain.render_mode, plain.reset().shape) == (None, (2, 5))
        copies = make_vec_env("stlbench/zz-drawn-v0", 2, seed=0, env_kwargs={"method": "raw"})
        copies.reset()
        assert [image is not None and image.shape for image in copies.get_images()] == [(4, 6, 3)] * 2

    @pytest.fixture
    def drawn(self, site: Callable[..., Path]) -> Iterator[StlEnv]:
        """The task on a line, whose picture is as bright as x is large."""
        system = (
            "import numpy as np\nfrom helpers.line_task import Line\n"
            "class Drawn(Line):\n"
            "    def frame(self, state): return np.full((4, 6, 3), state[0], dtype=np.uint8)\n"
        )
        files = {"zz_drawn/__init__.py": "", "zz_drawn/system.py": system, "zz_drawn/task.yaml": text()}
        site("zz-drawn", "[stlbench.tasks]\nzz-drawn = zz_drawn.system:Drawn\n", files)
        stlbench.gym.register_all()
        yield StlEnv("zz-drawn", "raw", render_mode="rgb_array")
        del gymnasium.registry["stlbench/zz-drawn-v0"]
