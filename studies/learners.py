"""Learners beside each other: CPU seconds until a policy satisfies from 95 % of the starts for selection.

python studies/learners.py TASK SEED [LEARNER ...]    measure those without a row, each in a process of its own

All train on the task's derived form of the track `auto` by the reward `raw`, with the recipe of their class. `sbx-td3`
and `sbx-sac` are the same algorithms in JAX, by SBX (pip install sbx-rl). A short training before compiles all code.
Checks do not count. Set OMP_NUM_THREADS=1, and pin the process to one core. Rows are in results/learners.csv.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from recorded import markdown
from row_by_row import add, rows

from stlbench.contract import Agent, Environment, Policy, StatePolicy, Training
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.referee import Referee
from stlbench.study.trial import Clock
from stlbench.task import build_agent, build_method, load_task
from stlbench.tracks.auto import automatic, recipe
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.sb3 import SB3SAC, SB3TD3, SB3Agent
from stlbench_agents.training import box_of

ROWS = Path(__file__).parents[1] / "results" / "learners.csv"
COLUMNS = ("task", "learner", "seed", "cpu", "reached", "best", "steps", "first")
LEARNERS = (
    "td3",
    "td3[gradient_steps=2]",
    "td3[action_penalty=0.02]",
    "td3[action_penalty=0.02,gradient_steps=2]",
    "td3[layer_norm=true]",
    "td3[copies=32,gradient_steps=8,layer_norm=true]",
    "td3[copies=32,gradient_steps=8]",
    "td3[net_arch=256+256]",
    "td3[batch_size=512,gradient_steps=2]",
    "sb3-td3",
    "sb3-sac",
    "sb3-ppo",
    "sbx-td3",
    "sbx-sac",
)
WANTED, LIMIT, LOOKS = 0.95, 300.0, 250
"""The share of the starts, the CPU seconds of a learner, and its checks in a million steps."""
STEPS, WARM = 1_000_000, 4000


class _Jax(SB3Agent):
    """An algorithm of SBX, whose actor is a plain network, with the options of SB3's."""

    def algorithm(self) -> Any:
        import sbx

        return getattr(sbx, self.algorithm_name)

    def exported(self, model: Any, environment: Environment) -> Policy:
        """The actor's layers; SAC's last is that of the spread, which a deterministic policy leaves out."""
        import jax

        found = jax.device_get(model.policy.actor_state.params)["params"]
        layers = [(np.array(found[f"Dense_{i}"]["kernel"]), np.array(found[f"Dense_{i}"]["bias"])) for i in range(3)]
        return ActorPolicy(layers, box_of(environment.actions), "relu", squashed=True)


@dataclass(frozen=True, kw_only=True)
class JaxTD3(_Jax, SB3TD3):
    """TD3 of SBX."""


@dataclass(frozen=True, kw_only=True)
class JaxSAC(_Jax, SB3SAC):
    """SAC of SBX."""


def measured(name: str, learner: str, seed: int) -> dict[str, Any]:
    """Train until the policy satisfies from enough starts, or the time is over."""
    own = {"sbx-td3": (JaxTD3, "sb3-td3"), "sbx-sac": (JaxSAC, "sb3-sac")}
    kind, named = own.get(learner, (None, learner))
    task = automatic(load_task(name), named.partition("[")[0])
    shares = list[tuple[float, float, int]]()
    method = build_method(task, "raw")
    agent: Agent = build_agent(task, named) if kind is None else kind(**_numbers(recipe(named, task)))
    referee = Referee(task, method)

    def report(policy: Policy | StatePolicy, steps: int) -> bool:
        clock.pause()
        share, _ = referee.select(policy)
        shares.append((clock.cpu, share, steps))
        clock.go_on()
        return share >= WANTED or shares[-1][0] >= LIMIT

    make: Callable[[int], Environment] = lambda count: BatchEnvironment(task, method, count, seed=seed)  # noqa: E731
    agent.train(Training(make, WARM, seed, lambda policy, steps: None, 1))
    clock = Clock()
    agent.train(Training(make, STEPS, seed, report, LOOKS))
    cpu, share, steps = shares[-1]
    first = next((f"{at:.0f}" for at, each, _ in shares if each > 0), "")
    best = max(each for _, each, _ in shares)
    reached = share >= WANTED
    return {
        "task": name, "learner": learner, "seed": seed, "cpu": f"{cpu:.1f}", "reached": reached,
        "best": f"{best:.3f}", "steps": steps, "first": first,
    }  # fmt: skip


def _numbers(found: dict[str, Any]) -> dict[str, Any]:
    return found | {"net_arch": tuple(found["net_arch"])}


def page() -> str:
    """A row for each learner, a column for each task: CPU seconds to the share that is wanted."""
    found = rows(ROWS)
    tasks = list(dict.fromkeys(row["task"] for row in found))
    there = {row["learner"] for row in found}
    body = [
        [f"`{learner}`", *(_told(found, task, learner) for task in tasks)] for learner in LEARNERS if learner in there
    ]
    return markdown(["learner", *(f"`{task}`" for task in tasks)], body)


def _told(found: list[dict[str, str]], task: str, learner: str) -> str:
    """ "72", or with the best share "> 300 (50 %)"; "72; 2 of 3" has the median of three, of which two reached it."""
    mine = [row for row in found if (row["task"], row["learner"]) == (task, learner)]
    if not mine:
        return ""
    learned = [row["reached"] == "True" for row in mine]
    seconds = median(float(row["cpu"]) if done else inf for row, done in zip(mine, learned, strict=True))
    best = 100 * max(float(row["best"]) for row in mine)
    text = f"{seconds:.0f}" if seconds < inf else f"> {LIMIT:.0f} ({best:.0f} %)"
    return text if all(learned) or len(mine) == 1 else f"{text}; {sum(learned)} of {len(mine)}"


def main(name: str, seed: int, learners: list[str]) -> None:
    """Measure what has no row."""
    done = {(row["task"], row["learner"], int(row["seed"])) for row in rows(ROWS)}
    for learner in learners or list(LEARNERS):
        if (name, learner, seed) not in done:
            command = [sys.executable, __file__, "--one", name, learner, str(seed)]
            subprocess.run(command, check=True)  # noqa: S603


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        add(ROWS, COLUMNS, [measured(sys.argv[2], sys.argv[3], int(sys.argv[4]))])
    else:
        main(sys.argv[1], int(sys.argv[2]), sys.argv[3:])
