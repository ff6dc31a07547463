"""A plain loop of deep Q-learning in PyTorch, written as in CleanRL's dqn.py: a peer without a framework around it."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn
from torch.nn.functional import mse_loss

from stlbench.simulation.environment import BatchEnvironment

__all__ = ["TorchDQN"]


class TorchDQN:
    """One environment, one update of batch 128 a step, target copied every 1000 updates, epsilon 0.05."""

    def __init__(self, environment: BatchEnvironment, rows: int = 65536, batch: int = 128, gamma: float = 0.95) -> None:
        torch.set_num_threads(1)
        self.environment, self.batch, self.gamma = environment, batch, gamma
        self.online, self.target = (_network(environment) for _ in range(2))
        self.target.load_state_dict(self.online.state_dict())
        self.optimizer = torch.optim.Adam(self.online.parameters(), lr=1e-3)
        self.generator = np.random.default_rng(0)
        self.observations, self.arrived = (np.zeros((rows, environment.observation_size), np.float32) for _ in range(2))
        self.actions, self.rewards = np.zeros(rows, np.int64), np.zeros(rows, np.float32)
        self.observation = environment.reset()
        self.count = 0

    def steps(self, count: int) -> None:
        """Train for `count` environment steps more."""
        for _ in range(count):
            self._act()
            self._update()

    def _act(self) -> None:
        if self.generator.random() < 0.05:
            action = self.generator.integers(self.environment.actions.size, size=1)
        else:
            with torch.no_grad():
                action = self.online(torch.as_tensor(self.observation, dtype=torch.float32)).argmax(1).numpy()
        came = self.environment.step(action)
        row = self.count % len(self.actions)
        self.observations[row], self.arrived[row] = self.observation[0], came.arrived[0]
        self.actions[row], self.rewards[row] = action[0], came.reward[0]
        self.observation = came.observation
        self.count += 1

    def _update(self) -> None:
        rows = self.generator.integers(min(self.count, len(self.actions)), size=self.batch)
        with torch.no_grad():
            later = self.target(torch.from_numpy(self.arrived[rows])).max(1).values
            goal = torch.from_numpy(self.rewards[rows]) + self.gamma * later
        values = self.online(torch.from_numpy(self.observations[rows]))
        loss = mse_loss(values.gather(1, torch.from_numpy(self.actions[rows])[:, None]).squeeze(1), goal)
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.online.parameters(), 10.0)
        self.optimizer.step()
        if self.count % 1000 == 0:
            self.target.load_state_dict(self.online.state_dict())


def _network(environment: BatchEnvironment) -> nn.Sequential:
    first, last = nn.Linear(environment.observation_size, 128), nn.Linear(128, environment.actions.size)
    return nn.Sequential(first, nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), last)
