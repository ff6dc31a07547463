"""Pictures for a film: a policy acts once more, in copies of an environment that render."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stlbench.contract import Array, Policy, RewardMethod
from stlbench.contract.presentation import Pixels
from stlbench.rollout.environment import Simulator
from stlbench.task.task import Task


class Reenactment:
    """Pictures of each copy in the order of time. An environment's state cannot be set, so the episode is repeated."""

    def __init__(self, task: Task, method: RewardMethod, policy: Policy, begun: Array) -> None:
        self._policy, self._simulator = policy, Simulator(task, method, rewarded=False, drawn=True)
        self._simulator.reset(begun)
        self._samples = [self._simulator.signals[:, None].copy()]

    def __call__(self, sample: int) -> Sequence[Pixels]:
        """The pictures at the last decision before a sample, which may not decrease; `RuntimeError` without any."""
        simulator = self._simulator
        while simulator.t[0] + simulator.hold <= sample:
            self._samples.append(simulator.advance(self._policy.act(simulator.observe())).samples)
        pictures = simulator.world.frames()
        if pictures is None:
            raise RuntimeError("the simulation has no picture of itself")
        return pictures

    def repeats(self, traces: Array) -> bool:
        """Whether the samples up to now are those of traces (n, T + 1, k); after an early end these may be NaN."""
        lived = np.concatenate(self._samples, axis=1)
        recorded = traces[:, : lived.shape[1]]
        return bool(np.allclose(np.where(np.isnan(recorded), lived, recorded), lived))
