"""The trainings, rewards and moves whose bits `pinned_bits` pins, and the parts on which each depends."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from pydantic import TypeAdapter

import stlbench
from stlbench import stl
from stlbench.contract import ActionGrid, Policy, Specification, Unsuitable
from stlbench.errors import UsageError
from stlbench.gym import StlVectorEnv
from stlbench.records.identity import Track
from stlbench.records.result import Measurement
from stlbench.registry import choices, named_tasks, plugins
from stlbench.simulation.referee import race
from stlbench.simulation.verdicts import EarlyEnds, judge, without_end
from stlbench.study.cell import Recipe, Recipes
from stlbench.study.plan import plan_cells
from stlbench.study.trial import Patience, measure
from stlbench.task import build_agent, build_method, load_task
from stlbench.task.file import EarlyEnd
from stlbench.task.view import FormulaView

TASKS = Path(__file__).parent / "pinned_tasks"

STEPS = 30
FORMULAS = (
    "G[8,30] (abs(x - 1) <= 0.6) & F[2,20] (abs(y + 1) <= 0.5)",
    "G[0,20] F[0,10] (x >= 0.5 | y >= 1)",
    "F[0,20] G[0,6] (norm(x, y) <= 1.2)",
    "F[0,30] (x >= 1 & F[0,0] y <= 0.5) & G[0,30] (y >= -3)",
    "G[0,28] (x <= 2.5 & y >= -2.5)",
)
METHODS: Mapping[str, tuple[str, ...]] = {
    "bhnr": (
        *("mode=block", "window=4", "semantics=lse", "semantics=gilpin", "semantics=agm", "semantics=gmsr"),
        *("semantics=filtering", "semantics=filtering-sum", "semantics=lse,sharpness=3"),
    ),
    "causation": ("bonus=0.3",),
    "cfer": ("flags=published", "beta=10"),
    "counters": ("pays=verdict", "counterfactuals=4"),
    "dense": (
        *("mode=difference", "semantics=lse", "semantics=gilpin", "semantics=agm", "semantics=gmsr"),
        "semantics=gmsr,sharpness=3",
    ),
    "flag": ("beta=10",),
    "funnel": ("variant=code", "shape=clipped", "shape=normalised,t_star=0.5,ginf=0.05", "activity=literal"),
    "hprs": ("later=target", "variant=auto-shaping", "violation=ends", "gamma=0.9"),
    "machine": ("shaping=phases", "counterfactuals=0"),
    "raw": ("activity=literal",),
    "sparse": ("pays=failure",),
    "tau-cmdp": ("window=after", "beta=10"),
    "tau-mdp": ("form=probability", "beta=3", "every=2"),
    "tltl": ("semantics=lse", "semantics=gilpin", "semantics=agm", "semantics=gmsr", "semantics=lse,sharpness=3"),
}
"""Parameters of methods, beside their defaults. Each is played on walks, and trained with."""
_SB3 = (
    "net_arch=12+12,copies=4,batch_size=16,learning_rate=0.002,learning_rate_final=0.001,gamma=0.9,buffer_size=256,"
    "gradient_steps=2,n_steps=2,tau=0.1,learning_starts=16"
)
_DQN = (
    "net_arch=12+12,copies=4,batch_size=16,learning_rate=0.002,learning_rate_final=0.001,gamma=0.9,buffer_size=256,"
    "gradient_steps=3,n_steps=1,tau=0.1,averaging=0.9,reward_scale=2,target_update_interval=2,exploration_initial_eps=0.8,"
    "exploration_final_eps=0.2,exploration_fraction=0.5,max_grad_norm=0.5"
)
_DQN_ALL = (_DQN, "head=additive,averaging=0", "double=false", "time_limit=terminal", "bounded=true")
AGENTS: Mapping[str, tuple[str, ...]] = {
    "best-possible": ("resolution=0.7,actions=5",),
    "cma-es": ("candidates=6,most_starts=4,knots=3,spread=0.5",),
    "dqn": _DQN_ALL,
    "dqn-per-robot": _DQN_ALL,
    "planner": ("resolution=0.7,actions=5,gamma=0.8", "memories=4,rounded=2"),
    "sb3-dqn": (
        f"{_SB3},target_update_interval=2,exploration_initial_eps=0.8,exploration_final_eps=0.2,"
        "exploration_fraction=0.5,max_grad_norm=0.5",
    ),
    "sb3-ppo": (
        "net_arch=12+12,copies=4,batch_size=14,learning_rate=0.002,learning_rate_final=0.001,gamma=0.9,n_steps=14,"
        "n_epochs=3,gae_lambda=0.8,clip_range=0.1,ent_coef=0.01",
    ),
    "sb3-sac": (f"{_SB3},ent_coef_initial=0.5",),
    "sb3-td3": (f"{_SB3},policy_delay=3,target_policy_noise=0.3,target_noise_clip=0.2,exploration_noise=0.4",),
    "td3": (
        "net_arch=12+12,copies=4,batch_size=16,learning_rate=0.002,learning_rate_final=0.001,gamma=0.9,buffer_size=256,"
        "gradient_steps=2,n_steps=3,tau=0.1,averaging=0.9,reward_scale=2,policy_delay=3,target_policy_noise=0.3,"
        "target_noise_clip=0.2,exploration_noise=0.4,exploration_noise_final=0.1,random_steps=8,action_penalty=0.1",
        "net_arch=12+12,copies=4,batch_size=16,layer_norm=true",
        "net_arch=12+12,copies=4,batch_size=16,lasting_noise=0.9",
    ),
}
"""Parameters of agents, beside their recipes in the tasks. Each is trained with."""


@dataclass(frozen=True)
class Row:
    """What is computed, and of what."""

    name: str
    choices: tuple[tuple[str, str], ...]
    """Parts of the distribution that its bits depend on, and how each was chosen: `methods.raw`, `raw[hold=2]`."""
    compute: Callable[[], Iterator[bytes]]

    @property
    def parts(self) -> set[str]:
        return {part for part, _ in self.choices}

    @property
    def digest(self) -> str:
        """Of all bits, 32 hex digits."""
        hashed = hashlib.sha256()
        for part in self.compute():
            hashed.update(part)
        return hashed.hexdigest()[:32]


# ---------------------------------------------------------------------------------------------------------- trainings


def trained(task: str, method: str, agent: str | None = None, track: Track = "shared", budget: str = "quick") -> Row:
    """A tiny training on a task of `pinned_tasks`, scored as any cell."""
    by = choices.parse_choice(agent or "dqn")

    def compute() -> Iterator[bytes]:
        at, paid_by = named_tasks.parse_task(str(TASKS / task)), choices.parse_choice(method)
        recipes = Recipes({"points": {"dqn": {"raw": Recipe({"gamma": 0.8}, 4)}}}, "here") if track == "tuned" else None
        (planned,) = plan_cells([at], [paid_by], [by], [0], budget, track, recipes)
        on = planned.load_task()
        try:
            measured = measure(on, build_method(on, paid_by), build_agent(on, by), planned)
        except Unsuitable as reason:
            yield type(reason).__name__.encode()
        else:
            yield json.dumps(_numbers(measured.numbers)).encode()
            yield from (each.tobytes() for each in (measured.assessment.traces, measured.assessment.states))
            for policy in (measured.selected, measured.final):
                weights = policy.arrays() if isinstance(policy, Policy) else None
                yield from (np.ascontiguousarray(array).tobytes() for array in (weights or {}).values())

    view = [("view", "view")] if track == "auto" else []
    names = (f"methods.{choices.parse_choice(method).name}", method), (f"agents.{by.name}", str(by))
    harness = (("harness", text) for text in (task, track, budget))
    return Row(f"training {task} {method} {by} {track} {budget}", (*harness, *view, *names), compute)


def _numbers(measurement: Measurement) -> dict[str, Any]:
    """What the ledger has of a cell, without times and words."""
    content: dict[str, Any] = TypeAdapter(Measurement).dump_python(measurement, mode="json")
    for name in ("training_cpu_seconds", "training_wall_seconds", "cpu_seconds", "wall_seconds", "reward_nanoseconds"):
        del content[name]
    for point in content["curve"]:
        del point["cpu_seconds"]
    return {**content, "extension": content["extension"] != ""}


# ------------------------------------------------------------------------------------------------------------ rewards


class _Played(gymnasium.Env[Any, Any]):
    """Plays a recorded trace of x and y, whatever is done."""

    def __init__(self, trace: Any) -> None:
        self.observation_space = gymnasium.spaces.Box(-4, 4, (2,), np.float64)
        self.action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float64)
        self._trace, self._t = trace, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self._t = 0
        return self._trace[0], {}

    def step(self, action: Any) -> Any:
        self._t += 1
        return self._trace[self._t], 0.0, False, False, {}


def paid(method: str) -> Row:
    """What a method pays and shows on fixed traces, for formulas of several shapes."""

    def compute() -> Iterator[bytes]:
        generator = np.random.default_rng(7)
        walks = np.clip(np.cumsum(generator.normal(0, 0.5, (6, STEPS + 1, 2)), axis=1), -3.9, 3.9)
        for formula in FORMULAS:
            yield _paid(method, formula, walks)

    name = f"methods.{choices.parse_choice(method).name}"
    return Row(f"rewards {method}", (("harness", "rewards"), (name, method)), compute)


def _paid(method: str, formula: str, walks: Any) -> bytes:
    """Rewards of each step, and the method's inputs at the end; what it says where it does not fit."""
    copies = SyncVectorEnv([lambda walk=walk: _Played(walk) for walk in walks], autoreset_mode=AutoresetMode.DISABLED)
    ranges = {"x": (-4.0, 4.0), "y": (-4.0, 4.0)}
    try:
        env = stlbench.wrap(copies, formula, names=("x", "y"), ranges=ranges, steps=STEPS, method=method)
    except (Unsuitable, UsageError):
        return b"unsuitable"
    env.reset(seed=0)
    still = np.zeros((len(walks), 1))
    steps = [env.step(still)[:2] for _ in range(STEPS)]
    return np.array([reward for _, reward in steps], float).tobytes() + np.asarray(steps[-1][0], float).tobytes()


# -------------------------------------------------------------------------------------------------------------- tasks

_FEW = 60
"""Decisions of an environment, whose episode may take seconds."""


_LAYERED = ("linear-chain", "panda-places", "unicycle-choice")
"""Tasks whose formulas flag takes by a schedule only."""


def moves(part: str, name: str) -> Row:
    """Where fixed actions lead from fixed starts, what policies see of it, and margins and robustness."""
    payer = "sparse" if name in _LAYERED else "flag"

    def compute() -> Iterator[bytes]:
        env = StlVectorEnv(2, name, payer)
        task, generator = env.task, np.random.default_rng(11)
        system = list(_system(name))
        observation, info = env.reset(seed=3)
        seen, signals = [observation], [info["signals"]]
        over = np.zeros(2, dtype=bool)
        while not over.all() and (system or len(signals) < _FEW):
            observation, reward, _, over, info = env.step(_actions(env, generator))
            last = info.get("final_info", info)
            seen += [np.stack(info["final_obs"]) if "final_obs" in info else observation, reward]
            signals.append(last["signals"])
        env.close()
        trace = np.concatenate(signals, axis=1).astype(float)
        yield trace.tobytes()
        yield from (np.ascontiguousarray(each).tobytes() for each in (*seen, *system))
        if system:
            yield np.array([stl.robustness(task.formula, one, task.signals) for one in trace]).tobytes()

    return Row(f"moves {name}", (("harness", "moves"), (f"methods.{payer}", payer), (part, part)), compute)


def _actions(env: StlVectorEnv, generator: np.random.Generator) -> Any:
    actions = env.task.actions
    if isinstance(actions, ActionGrid):
        return generator.integers(actions.size, size=env.num_envs)
    space = env.action_space
    return generator.uniform(space.low, space.high).astype(space.dtype)


def _system(name: str) -> Iterator[Any]:
    """Steps of a system alone, and what policies see of them in double precision; nothing where a task is none."""
    task, generator = load_task(name), np.random.default_rng(13)
    try:
        system, actions = task.system, task.actions
    except Unsuitable:
        return
    states = task.starts.of_training(np.random.default_rng(5), 5)
    yield states
    for t in range(8):
        states = system.step(states, generator.uniform(actions.low, actions.high, (5, len(actions.names))))
        yield from (states, system.features(states, np.full(5, t + 1)), system.scaled_state(states))
        yield system.signals(states)


# -------------------------------------------------------------------------------------------------------------- rules

_VIEWED = (*FORMULAS, "G[0,20] (x >= 1 -> F[0,9] norm(x, y - 1) <= 0.5) & F[3,9] y >= 0 & F[9,12] y >= 1")


def _viewed() -> Iterator[bytes]:
    """What policies see of some formulas."""
    generator = np.random.default_rng(17)
    state, signals = generator.uniform(-1, 1, (40, 3)), generator.uniform(-4, 4, (40, 2))
    t, ranges = generator.integers(0, STEPS + 1, 40), {"x": (-4.0, 4.0), "y": (-4.0, 4.0)}
    for formula in _VIEWED:
        yield FormulaView(stl.parse(formula), ranges, STEPS)(state, signals, t).tobytes()


def _selected() -> Iterator[bytes]:
    """Races of checkpoints that are close, from several numbers of starts, and when patience ends."""
    generator = np.random.default_rng(19)
    for starts in (5, 8, 24, 64, 200):
        for share in (0.0, 0.5, 0.95, 1.0):
            robustness = generator.normal(generator.normal(1, 0.3, (12, 1)), 0.3, (12, starts))
            satisfied = generator.random((12, starts)) < share
            chosen = race(lambda rows, part, s=satisfied, r=robustness: (s[rows, part], r[rows, part]), 12, starts)
            yield from (np.asarray(each).tobytes() for each in chosen)
    for checkpoints in (1, 2, 4):
        patience, scores = Patience(checkpoints), np.cumprod(1 + generator.uniform(-0.03, 0.08, 60))
        yield bytes(
            patience.ends(float(share), score) for share, score in zip(np.tile([1, 1, 0.9], 20), scores, strict=True)
        )


def _judged() -> Iterator[bytes]:
    """Verdicts on traces that end early, by what an early end means; what is paid for the steps that are left."""
    generator = np.random.default_rng(23)
    walks = np.clip(np.cumsum(generator.normal(0, 0.5, (40, STEPS + 1, 2)), axis=1), -3.9, 3.9)
    without_end(walks, generator.integers(0, STEPS + 1, 40))
    for text in (*FORMULAS, "G[0,28] x >= -9"):  # the last holds wherever it goes
        formula = stl.parse(text)
        given = Specification(formula, ("x", "y"), (-4.0, -4.0), (4.0, 4.0), STEPS, 1.0, can_end=True)
        for terminated in ("hold", "violated", "interval"):
            known = np.nan_to_num(walks) if terminated == "hold" else walks
            yield from (each.tobytes() for each in judge(formula, known, given, terminated))
            yield from _left(given, terminated)


def _left(given: Specification, terminated: EarlyEnd) -> Iterator[bytes]:
    for name in ("raw", "flag", "hprs[violation=ends]"):
        try:
            method = plugins.build("methods", choices.parse_choice(name), given)
        except Unsuitable:
            continue
        ends, start, now = EarlyEnds(method, terminated), np.array([[0.5, -1.0]]), np.array([False, True, True])
        for t in (1, 7, STEPS - 1, STEPS):
            memory = method.initial_memory(start, np.array([t]))
            yield from (
                np.float64(ends.sum_left(start, np.zeros((1, 1)), t, memory, each)).tobytes() for each in (1, 0.9)
            )
            yield ends.standing_still(np.ones(3), ~now, now, np.full(3, t), 2).tobytes()


# --------------------------------------------------------------------------------------------------------- the matrix


def rows() -> Iterator[Row]:
    """All of it."""
    yield Row("rule selection", (("harness", "selection"),), _selected)
    paying = ("methods.raw", "raw"), ("methods.flag", "flag"), ("methods.hprs", "hprs[violation=ends]")
    yield Row("rule early ends", (("harness", "early ends"), *paying), _judged)
    yield Row("rule view", (("harness", "rules"), ("view", "view")), _viewed)
    for method, variants in METHODS.items():
        for choice in (method, *(f"{method}[{parameters}]" for parameters in variants)):
            yield paid(choice)
            yield trained("points", choice)
    for agent, variants in AGENTS.items():
        on = "thrust" if agent in ("td3", "sb3-td3", "sb3-sac", "sb3-ppo") else "points"
        yield trained(on, "tltl", agent)
        for choice in (agent, *(f"{agent}[{parameters}]" for parameters in variants)):
            yield trained(on, "flag", choice)
    for left_out in ("features", "hold", "cuts+exploring"):
        yield trained(f"points[without={left_out}]", "raw")
    yield trained("points", "flag", track="plain", budget="smoke")
    yield trained("points", "raw", track="tuned")
    yield trained("points", "raw", budget="patient")
    for agent in ("dqn", "dqn-per-robot"):
        yield trained("points", "cfer[counterfactuals=3]", agent)
    # Other rules of this track need no revision: the recipe and the task file are parts of each key. So these are
    # named here. The budget quick would be lengthened.
    yield trained("points", "raw", "dqn[bounded=true,gamma=0.95]", track="auto", budget="smoke")
    for task in ("pole-holds", "pole-fails", "pole-unknown"):
        for method in ("flag", "raw", "hprs[violation=ends]"):
            yield trained(task, method)
    for kind in ("tasks", "suites"):
        for name, plugin in plugins.available(kind).items():
            if plugin.distribution == plugins.OWN:
                yield from (moves(f"{kind}.{name}", each) for each in ([name] if kind == "tasks" else _members(name)))


def _members(suite: str) -> list[str]:
    """One task of each system."""
    return [each for each in named_tasks.named(f"{suite}:core") if each.endswith("-reach-stay-1")]
