"""A small matrix of trainings, rewards and moves whose bits are pinned, so that a changed bit is seen.

A row depends on some parts of the distribution: the harness, the formula's view, an agent, a method, a task, a suite.
The file of pins has the digest of all bits of each row, and the revision of each part. A process of its own computes
the rows with `BASELINE`, in which libraries use no instruction that some processor of the architecture lacks. So the
digests are the same on every processor, but for agents of Stable-Baselines3: PyTorch computes what it computes, and
their rows count on the processor of the pins alone.

`python tests/helpers/pinned_bits.py --write` pins the matrix. It refuses where bits of a row have changed while the
revisions of its parts have not.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import gymnasium
import llvmlite.binding
import numpy as np
import yaml
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from pydantic import TypeAdapter

import stlbench
from stlbench import stl
from stlbench.contract import ActionGrid, Policy, Unsuitable
from stlbench.errors import UsageError
from stlbench.gym import StlVectorEnv
from stlbench.records.identity import Track
from stlbench.records.result import Measurement
from stlbench.registry import choices, named_tasks, plugins
from stlbench.study import cell
from stlbench.study.cell import Recipe, Recipes
from stlbench.study.plan import plan_cells
from stlbench.study.trial import measure
from stlbench.task import build_agent, build_method, load_task
from stlbench.task.view import FormulaView

sys.path.append(str(Path(__file__).parents[1]))  # as pytest does; the command has this file's own folder there
from helpers import pinned_rules

PINS = Path(__file__).parents[1] / "study" / "pinned_bits.json"
TASKS = Path(__file__).parent / "pinned_tasks"

BASELINE = {
    "ATEN_CPU_CAPABILITY": "default",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F",
    "MKL_CBWR": "COMPATIBLE",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_FEATURES": "+sse4.2",
    "NUMBA_CPU_NAME": "x86-64-v2",
    "OMP_NUM_THREADS": "1",
    "ONEDNN_MAX_CPU_ISA": "SSE41",
    "OPENBLAS_CORETYPE": "Nehalem",
}
"""Environment variables by which libraries leave out what only some processors have."""
PACKAGES = (
    *("box2d", "dm_control", "gymnasium", "gymnasium-robotics", "highway-env", "llvmlite", "mujoco", "numba", "numpy"),
    *("scipy", "stable-baselines3", "torch"),
)
"""Those whose versions can change bits. They stand in keys, as far as a cell uses them."""

PARAMETERS = yaml.safe_load((Path(__file__).parent / "pinned_parameters.yaml").read_text(encoding="utf-8"))
"""Parameters of methods, each of which is played on walks and trained with, and of agents, which are trained with."""


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
        walks = np.clip(np.cumsum(generator.normal(0, 0.5, (6, pinned_rules.STEPS + 1, 2)), axis=1), -3.9, 3.9)
        for formula in pinned_rules.FORMULAS:
            yield _paid(method, formula, walks)

    name = f"methods.{choices.parse_choice(method).name}"
    return Row(f"rewards {method}", (("harness", "rewards"), (name, method)), compute)


def _paid(method: str, formula: str, walks: Any) -> bytes:
    """Rewards of each step, and the method's inputs at the end; what it says where it does not fit."""
    copies = SyncVectorEnv([lambda walk=walk: _Played(walk) for walk in walks], autoreset_mode=AutoresetMode.DISABLED)
    ranges = {"x": (-4.0, 4.0), "y": (-4.0, 4.0)}
    try:
        env = stlbench.wrap(copies, formula, names=("x", "y"), ranges=ranges, steps=pinned_rules.STEPS, method=method)
    except (Unsuitable, UsageError):
        return b"unsuitable"
    env.reset(seed=0)
    still = np.zeros((len(walks), 1))
    steps = [env.step(still)[:2] for _ in range(pinned_rules.STEPS)]
    return np.array([reward for _, reward in steps], float).tobytes() + np.asarray(steps[-1][0], float).tobytes()


# -------------------------------------------------------------------------------------------------------------- tasks

_FEW = 60
"""Decisions of an environment, whose episode may take seconds."""


def moves(part: str, name: str) -> Row:
    """Where fixed actions lead from fixed starts, what policies see of it, and margins and robustness."""

    def compute() -> Iterator[bytes]:
        env = StlVectorEnv(2, name, "flag")
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

    return Row(f"moves {name}", (("harness", "moves"), ("methods.flag", "flag"), (part, part)), compute)


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


# --------------------------------------------------------------------------------------------------------- the matrix


def rows() -> Iterator[Row]:
    """All of it."""
    yield Row("rule selection", (("harness", "selection"),), pinned_rules.selected)
    paying = ("methods.raw", "raw"), ("methods.flag", "flag"), ("methods.hprs", "hprs[violation=ends]")
    yield Row("rule early ends", (("harness", "early ends"), *paying), pinned_rules.judged)
    yield Row("rule view", (("harness", "rules"), ("view", "view")), pinned_rules.viewed)
    for method in PARAMETERS["methods"]:
        for choice in _choices("methods", method):
            yield paid(choice)
            yield trained("points", choice)
    for agent in PARAMETERS["agents"]:
        on = "thrust" if agent in ("td3", "sb3-td3", "sb3-sac", "sb3-ppo") else "points"
        yield trained(on, "tltl", agent)
        for choice in _choices("agents", agent):
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


def _choices(kind: str, name: str) -> list[str]:
    """A plugin with its defaults, and with each of its parameters."""
    return [name, *(f"{name}[{each.replace(' ', '')}]" for each in PARAMETERS[kind][name])]


def _members(suite: str) -> list[str]:
    """One task of each system."""
    return [each for each in named_tasks.named(f"{suite}:core") if each.endswith("-reach-stay-1")]


def parts() -> dict[str, int]:
    """The parts of this distribution, and their revisions."""
    kinds = ("agents", "methods", "suites", "tasks")
    known = {f"{kind}.{name}": plugin for kind in kinds for name, plugin in plugins.available(kind).items()}
    own = {name: plugin.revision for name, plugin in known.items() if plugin.distribution == plugins.OWN}
    return {"harness": cell.HARNESS, "view": FormulaView.revision, **own}


def suspects(changed: Iterable[str]) -> list[str]:
    """The parts that explain which rows have changed bits.

    Of all choices the one whose rows are most nearly the changed ones (by Ochiai's coefficient) is to blame first; then
    the same for the changed rows that are left.
    """
    chosen: dict[tuple[str, str], set[str]] = {}
    for row in rows():
        for choice in row.choices:
            chosen.setdefault(choice, set()).add(row.name)
    left, blamed = {*changed}, set[str]()
    while left:
        of_choice = {choice: len(left & names) / (len(left) * len(names)) ** 0.5 for choice, names in chosen.items()}
        choice = max(of_choice, key=lambda each: of_choice[each])
        blamed.add(choice[0])
        left -= chosen[choice]
    return sorted(blamed)


# -------------------------------------------------------------------------------------------------------------- pinning


def here() -> dict[str, str]:
    """What bits may depend on beside the code: the kind of machine, Python and packages."""
    kind = f"{platform.system()} {platform.machine()} {' '.join(platform.libc_ver())}"
    python = ".".join(platform.python_version_tuple()[:2])
    return {"machine": kind, "python": python, **{name: _version(name) for name in PACKAGES}}


def processor() -> str:
    """The name that LLVM has for it."""
    return str(llvmlite.binding.get_host_cpu_name())


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def computed(environment: Mapping[str, str] = BASELINE, program: Path = Path(__file__)) -> dict[str, str]:
    """Row -> digest, by a process of its own. Raises `CalledProcessError`."""
    paths = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", str(program), "--compute"],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return dict(json.loads(ended.stdout.splitlines()[-1]))


def read_pins() -> dict[str, Any]:
    """The file of pins: what `here` said, the revision of each part, and the digest of each row."""
    return dict(json.loads(PINS.read_text(encoding="utf-8")))


def problem(
    digests: Mapping[str, str], pins: Mapping[str, Any], numbers: Mapping[str, int], on: str | None = None
) -> str | None:
    """In a line, what is wrong with the pins of rows; None where they hold. `on` is the processor, if not this one."""
    same = pins["processor"] == (processor() if on is None else on)
    raised = {part for part, number in numbers.items() if pins["revisions"].get(part) != number}
    old = [row.name for row in rows() if row.name in pins["rows"] and not raised.intersection(row.parts)]
    changed = [name for name in old if pins["rows"][name] != digests[name] and (same or " sb3-" not in name)]
    if changed:
        found = suspects(changed)
        part = " or ".join(f"{name} from {numbers[name]} to {numbers[name] + 1}" for name in found)
        return (
            f"bits have changed in {len(changed)} of {len(old)} rows, such as '{changed[0]}': if that is meant, raise "
            f"the revision of {part} where its code stands, list the change in CHANGELOG.md under Results, and run "
            "`python tests/helpers/pinned_bits.py --write`"
        )
    if {*digests} - {*old} or {*pins["rows"]} - {*digests}:
        return "rows are new, or of other revisions: run `python tests/helpers/pinned_bits.py --write`"
    return None


def write() -> str | None:
    """Pin the matrix; or the problem where bits have changed without a new revision, and nothing is written."""
    digests, numbers = computed(), parts()
    if PINS.exists() and "bits have changed" in (said := problem(digests, read_pins(), numbers) or ""):
        return said
    content = {**here(), "processor": processor(), "revisions": numbers, "rows": digests}
    PINS.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return None


if __name__ == "__main__":
    if sys.argv[1:] == ["--compute"]:
        print(json.dumps({row.name: row.digest for row in rows()}))
    elif sys.argv[1:] == ["--write"]:
        sys.exit(write())
    else:
        sys.exit("usage: python tests/helpers/pinned_bits.py --write")
