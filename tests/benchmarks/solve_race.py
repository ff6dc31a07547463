"""One training of the race of `stlbench solve` against Stable-Baselines3, in a process of its own.

    python -m benchmarks.solve_race TASK PEER SEED LIMIT     trains PPO, SAC, TD3 or DQN
    python -m benchmarks.solve_race TASK solve FOLDER        checks the policies that `stlbench solve` trained

Each prints a line of JSON. The time of a peer is its CPU time, imports included and checks left out, until
95 % of the fresh starts are satisfied, or until the limit. `solve` is measured alike, at the end of each training.
"""

from __future__ import annotations

import json
import logging
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task

WANTED = 0.95
FRESH, GLANCE = 100, 20
"""Fresh starts that decide, and those of a glance, which has to succeed before."""
_SEED = 2026
_EVERY, _SHARE = 5.0, 0.05
"""A peer is checked after so many CPU seconds, later after such a share of its CPU time."""
_DISTANCE = "sqrt((x - 10)*(x - 10) + (y - 10)*(y - 10))"


@dataclass(frozen=True)
class Entry:
    """A requirement, for `solve` and for the program of a user of Stable-Baselines3 and rtamt."""

    environment: str
    formula: str | None
    """None for the task's own."""
    names: tuple[str, ...]
    """Signals of the formula."""
    decisions: int
    parts: tuple[str, ...]
    """The conditions whose robustness rtamt computes at each step."""
    peers: tuple[str, ...] = ("PPO", "SAC", "TD3")
    signal: str | None = None
    """An option of `solve`."""
    read: Callable[[Any, Any], Any] = lambda observation, info: info["signals"]
    """The samples that a step added."""

    @property
    def is_task(self) -> bool:
        """Whether it is a task of stlbench, whose starts are states."""
        return self.formula is None

    @property
    def requirement(self) -> stl.Formula:
        """What the referee scores, in steps."""
        return load_task(self.environment).formula if self.formula is None else stl.parse(self.formula)

    @property
    def words(self) -> list[str]:
        """What a user types after `stlbench solve`."""
        formula = [] if self.formula is None else [self.formula]
        return [self.environment, *formula, *(["--signal", self.signal] if self.signal else [])]


def _chain(first: str, second: str, within: int) -> tuple[str, str]:
    """A chain looked at from its end, as rtamt computes it at each step; and its first part, which is never less, as
    the observation has to show whether it was met."""
    return f"once[0,{2 * within}](({second}) and once[0,{within}]({first}))", f"once[0,{2 * within}]({first})"


ENTRIES = {
    "pendulum": Entry(
        "Pendulum-v1",
        "G[100,200] abs(theta) <= 0.2",
        ("theta",),
        200,
        ("abs(theta) <= 0.2",),
        signal="theta=atan2(y, x)",
        read=lambda observation, info: math.atan2(observation[1], observation[0]),
    ),
    "cartpole": Entry(
        "CartPole-v1",
        "G[0,200] (abs(theta) <= 0.1 & abs(x) <= 1)",
        ("x", "theta"),
        200,
        ("(abs(theta) <= 0.1) and (abs(x) <= 1)",),
        peers=("PPO", "DQN"),
        read=lambda observation, info: observation[[0, 2]],
    ),
    "mountain-car": Entry(
        "MountainCarContinuous-v0",
        "F[0,200] position >= 0.45",
        ("position",),
        200,
        ("once[0,200](position >= 0.45)",),
        read=lambda observation, info: observation[0],
    ),
    "cartpole-chain": Entry(
        "CartPole-v1",
        "F[0,150] (x >= 0.3 & F[0,150] x <= -0.3)",
        ("x",),
        300,
        _chain("x >= 0.3", "x <= -0.3", 150),
        peers=("PPO", "DQN"),
        read=lambda observation, info: observation[0],
    ),
    "pendulum-chain": Entry(
        "Pendulum-v1",
        "F[0,80] (abs(theta) <= 0.3 & F[0,80] abs(omega) >= 6)",
        ("theta", "omega"),
        160,
        _chain("abs(theta) <= 0.3", "abs(omega) >= 6", 80),
        signal="theta=atan2(y, x)",
        read=lambda observation, info: (math.atan2(observation[1], observation[0]), observation[2]),
    ),
    "mountain-car-chain": Entry(
        "MountainCar-v0",
        "F[0,80] (position <= -0.8 & F[0,80] position >= 0.3)",
        ("position",),
        160,
        _chain("position <= -0.8", "position >= 0.3", 80),
        peers=("PPO", "DQN"),
        read=lambda observation, info: observation[0],
    ),
    "reach-stay": Entry("reach-stay", None, ("x", "y"), 80, (f"{_DISTANCE} <= 1",), peers=("PPO", "DQN")),
    "patrol": Entry(
        "patrol",
        None,
        ("x", "y"),
        200,
        tuple(f"once[0,99]((abs(x - 4) <= 0.5) and (abs(y - {y}) <= 0.5))" for y in (4, 2)),
    ),
    "hopper": Entry(
        "Hopper-v5",
        "G[0,200] (z >= 0.7 & abs(angle) <= 0.2) & F[100,200] vx >= 1",
        ("z", "angle", "vx"),
        200,
        ("(z >= 0.7) and (abs(angle) <= 0.2) and (vx >= 1)",),
        read=lambda observation, info: observation[[0, 1, 5]],
    ),
}


def starts(entry: Entry, count: int, stream: int = 0) -> Array:
    """Where episodes begin that no training has seen: states (count, n), or seeds (count, 1) for `reset`."""
    generator = np.random.default_rng((_SEED, stream))
    if entry.is_task:
        return load_task(entry.environment).starts.of_training(generator, count)
    return generator.integers(10**6, 2**30, (count, 1)).astype(np.float64)


def satisfied(entry: Entry, traces: Array) -> float:
    """The share of traces (N, T + 1, k) that satisfy; after NaN the last sample stays."""
    for t in range(1, traces.shape[1]):
        ended = np.isnan(traces[:, t]).any(axis=1)
        traces[ended, t] = traces[ended, t - 1]
    return float(np.mean(stl.robustness(entry.requirement, traces, entry.names) > 0))


def made(entry: Entry) -> Any:
    """The environment as the peer trains on it."""
    from benchmarks.peers_rtamt import OnlineRobustness

    if entry.is_task:
        import stlbench.gym  # noqa: F401 - registers the tasks

        env = gymnasium.make(f"stlbench/{entry.environment}-v0", method="sparse")  # its reward is not used
    else:
        env = gymnasium.make(entry.environment, max_episode_steps=entry.decisions)
    return OnlineRobustness(env, entry.parts, entry.names, entry.read, entry.decisions)


class Referee:
    """Lets a policy act from fresh starts."""

    def __init__(self, entry: Entry) -> None:
        self._entry = entry
        self._glance, self._fresh = ([made(entry) for _ in range(count)] for count in (GLANCE, FRESH))

    def share(self, policy: Any) -> float:
        """Of starts that are satisfied, by the glance if that is too little."""
        at_once = self._share(policy, self._glance, 1)
        return self._share(policy, self._fresh, 0) if at_once >= WANTED else at_once

    def _share(self, policy: Any, envs: list[Any], stream: int) -> float:
        begun = starts(self._entry, len(envs), stream)
        options = (
            [{"options": {"state": state}} for state in begun]
            if self._entry.is_task
            else [{"seed": int(seed)} for (seed,) in begun]
        )
        seen = np.stack([env.reset(**each)[0] for env, each in zip(envs, options, strict=True)])
        running = list(range(len(envs)))
        while running:
            actions, _ = policy.predict(seen[running], deterministic=True)
            for row, action in zip(tuple(running), actions, strict=True):
                seen[row], _, terminated, truncated, _ = envs[row].step(action)
                if terminated or truncated:
                    running.remove(row)
        length = stl.horizon(self._entry.requirement) + 1
        traces = np.full((len(envs), length, len(self._entry.names)), np.nan)
        for trace, env in zip(traces, envs, strict=True):
            samples = env.trace[:length]
            trace[: len(samples)] = samples
        return satisfied(self._entry, traces)


def train(entry: Entry, algorithm: str, seed: int, limit: float) -> dict[str, Any]:
    """Train a peer until the referee is content, or for `limit` CPU seconds."""
    from stable_baselines3.common.callbacks import BaseCallback

    from benchmarks.peers_rtamt import model

    apart, last, best, shares = 0.0, time.process_time(), 0.0, list[tuple[float, int, float]]()

    class Check(BaseCallback):
        def _on_step(self) -> bool:
            nonlocal apart, last, best
            began = time.process_time()
            cpu = began - apart
            if began - last < max(_EVERY, _SHARE * cpu) and cpu < limit:
                return True
            share = referee.share(self.model)
            best = max(best, share)
            shares.append((round(cpu, 1), self.num_timesteps, share))
            print(f"{algorithm} {shares[-1]}", file=sys.stderr, flush=True)
            last = time.process_time()
            apart += last - began
            return share < WANTED and cpu < limit

    env = made(entry)
    began = time.process_time()
    referee = Referee(entry)
    apart += time.process_time() - began
    model(algorithm, env, seed).learn(10**9, callback=Check())
    cpu, steps, share = shares[-1]
    return {"cpu": cpu, "reached": share >= WANTED, "share": share, "best": best, "decisions": steps, "checks": shares}


def solved(entry: Entry, folder: Path) -> dict[str, Any]:
    """What the policies in a folder of `stlbench solve` are worth from the fresh starts: the delivered one, and each.

    `trained` maps a training's key to its share.
    """
    from stlbench.records import results_folder
    from stlbench.records.result import Result
    from stlbench.simulation.referee import record
    from stlbench.solver.solution import FINAL, RACE, Solution
    from stlbench.study.policies import load_policy

    def share(cells: Path, result: Result) -> float:
        task, method, policy = load_policy(cells, result)
        traces = record(task, method, policy, starts(entry, FRESH)).traces
        names = list(task.signals)
        kept = [names.index(name) for name in entry.names]
        return satisfied(entry, traces[:, : stl.horizon(entry.requirement) + 1, kept])

    certificate = Solution.load(folder, run_code=True).certificate
    shares = {
        result.key: share(folder / name, result)
        for name in (RACE, FINAL)
        if (folder / name).is_dir()
        for result in results_folder.read(folder / name)
        if result.measurement is not None
    }
    facts = {key: certificate[key] for key in ("cell", "low", "probability")}
    return {"share": shares[certificate["key"]], "trained": shares, **facts}


def main(task: str, *words: str) -> None:
    """Print the line of a peer's training, or of a folder of `stlbench solve`."""
    logging.getLogger().setLevel(logging.ERROR)  # rtamt warns at every formula
    entry = ENTRIES[task]
    if words[0] == "solve":
        print(json.dumps(solved(entry, Path(words[1]))))
    else:
        print(json.dumps(train(entry, words[0], int(words[1]), float(words[2]))))


if __name__ == "__main__":
    main(*sys.argv[1:])
