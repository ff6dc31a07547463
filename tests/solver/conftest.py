"""An empty working folder for each test, a problem that most of them pose, and made-up environments."""

from __future__ import annotations

from pathlib import Path

import pytest

FORMULA = "G[0,20] abs(theta) <= 0.15"
POINT = "zz_made:Point-v0"

ENVIRONMENTS = '''
"""Made-up environments."""
import time
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.wrappers import RescaleAction, TransformReward

class Quitter(gymnasium.Env):
    """Ends at its first step."""
    observation_space, action_space = Box(-1, 1, (2,)), Discrete(2)
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.uniform(-1, 1, 2).astype(np.float32), {}
    def step(self, action):
        return np.zeros(2, np.float32), 0.0, True, False, {}

class Point(gymnasium.Env):
    """A point and its goal, as a Dict. The height never changes."""
    observation_space = Dict({"place": Box(-2, 2, (2,)), "goal": Box(-1, 1, (1,)), "height": Box(0, 1, (1,))})
    action_space = Box(-1, 1, (1,))
    def _seen(self):
        return {"place": self.p.copy(), "goal": self.g, "height": np.full(1, 0.5, np.float32)}
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.p = self.np_random.uniform(-1, 1, 2).astype(np.float32)
        self.g = self.np_random.uniform(-1, 1, 1).astype(np.float32)
        return self._seen(), self._told()
    def step(self, action):
        self.p[0] = np.clip(self.p[0] + 0.1 * action[0], -2, 2)
        return self._seen(), 0.0, False, False, self._told()
    def _told(self):
        far = abs(float(self.p[0] - self.g[0]))
        return {"far": far, "reached": far < 0, "steady": 3.0, "name": "point"}

class Unseeded(Point):
    """Takes no seed."""
    def reset(self):
        return super().reset()

class Failing(Point):
    """Its motor fails after a while."""
    taken = 0
    def step(self, action):
        Failing.taken += 1
        if Failing.taken > 700:  # the first look at it has 600 steps
            raise RuntimeError("motor is off")
        return super().step(action)

class Forgetful(Point):
    """Ignores its seeds."""
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=None)

class Sluggish(Point):
    """A step takes 20 ms."""
    taken = 0
    def step(self, action):
        Sluggish.taken += 1
        time.sleep(0.02)
        return super().step(action)

class Word(gymnasium.Space):
    """No numbers."""
    def sample(self, mask=None, probability=None):
        return "go"
    def contains(self, x):
        return isinstance(x, str)

class Talker(Point):
    """Says a word."""
    observation_space = Dict({"place": Box(-2, 2, (1,)), "word": Word()})
    def _seen(self):
        return {"place": self.p[:1].copy(), "word": "go"}

def layered(render_mode=None):
    """Gymnasium's own, under layers: one has a function that each copy makes anew."""
    own = gymnasium.make("Pendulum-v1", max_episode_steps=-1, render_mode=render_mode)
    return RescaleAction(TransformReward(own, lambda reward: -reward), -1, 1)

class Timed(Point):
    """May say the seconds of a step."""
    def __init__(self, dt=None, fps=None):
        self.dt, self.metadata = dt, {"render_modes": [], "render_fps": fps}

class Moved(Point):
    """Takes arguments of any kind."""
    def __init__(self, by=0, render_mode=None):
        self.by = by

gymnasium.register("Timed-v0", Timed, max_episode_steps=30)
gymnasium.register("Moved-v0", Moved, max_episode_steps=30)
gymnasium.register("Layered-v0", layered, max_episode_steps=30)
gymnasium.register("Talker-v0", Talker, max_episode_steps=30)
gymnasium.register("Quitter-v0", Quitter, max_episode_steps=30)
gymnasium.register("Unseeded-v0", Unseeded, max_episode_steps=30)
gymnasium.register("Failing-v0", Failing, max_episode_steps=30)
gymnasium.register("Forgetful-v0", Forgetful, max_episode_steps=30)
gymnasium.register("Sluggish-v0", Sluggish, max_episode_steps=30)
gymnasium.register("Point-v0", Point, max_episode_steps=30)
'''


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments in a module of the working directory."""
    (tmp_path / "zz_made.py").write_text(ENVIRONMENTS)
    monkeypatch.syspath_prepend(str(tmp_path))
