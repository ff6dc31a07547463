"""Witnesses: numbers whose bits depend on one part of the distribution, so that a changed bit is seen.

The parts are those of `stlbench/registry/revisions.yaml`. The file of pins has, for each part, the revisions that its
witness depends on, a digest of all its bits, and a few of its numbers. On the processor and with the packages that the
file names, the digest must be the same. Elsewhere the numbers must be close.

`python tests/helpers/witnesses.py --write` pins what has no pin yet. It refuses a part whose bits have changed while
its revision has not.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata, resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import llvmlite.binding
import numpy as np
import yaml
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import stlbench
from stlbench import stl
from stlbench.contract import ActionGrid, Executor, Outcome, Unsuitable
from stlbench.errors import UsageError
from stlbench.gym import StlVectorEnv
from stlbench.registry import suites
from stlbench.task import load_task
from stlbench.task.view import FormulaView

PINS = Path(__file__).parents[1] / "study" / "witnesses.json"
TASKS = Path(__file__).parent / "witness_tasks"

PACKAGES = (
    *("box2d", "dm_control", "gymnasium", "gymnasium-robotics", "highway-env", "llvmlite", "mujoco", "numba", "numpy"),
    *("scipy", "stable-baselines3", "torch"),
)
"""Those whose versions can change bits."""

RTOL, ATOL = 1e-4, 1e-6
"""How far numbers may be apart on another processor."""

Numbers = Mapping[str, Any]
"""Name -> array of a witness."""


def revisions() -> dict[str, int]:
    """The revision of each part: `harness`, `agents.dqn`, ..."""
    text = resources.files("stlbench").joinpath("registry/revisions.yaml").read_text(encoding="utf-8")
    read = yaml.safe_load(text)
    alone = {kind: number for kind, number in read.items() if isinstance(number, int)}
    kinds = {kind: parts for kind, parts in read.items() if kind not in alone}
    return alone | {f"{kind}.{name}": number for kind, parts in kinds.items() for name, number in parts.items()}


def here() -> dict[str, str]:
    """What the bits of floating-point numbers may depend on: the processor, Python and packages."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines() if platform.system() == "Linux" else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    processor = f"{next(names, platform.processor())} ({llvmlite.binding.get_host_cpu_name()})"
    return {"processor": processor, "python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


# ---------------------------------------------------------------------------------------------------------- trainings


class Here(Executor):
    """Runs cells in this process, which loads libraries once for all of them."""

    def run(self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]) -> Any:
        """One outcome per item. What a cell raises is raised."""
        yield from (Outcome(index, "done", function(item)) for index, item in enumerate(items))


def _install_executor() -> None:
    """Make `Here` a plugin, of a distribution in a temporary folder on the path."""
    folder = Path(tempfile.mkdtemp(prefix="witness-executor-"))
    atexit.register(shutil.rmtree, folder)
    info = folder / "witness_executor-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: witness-executor\nVersion: 1\n")
    (info / "entry_points.txt").write_text(f"[stlbench.executors]\nwitness-here = {__name__}:Here\n")
    sys.path.append(str(folder))


_install_executor()


@dataclass(frozen=True)
class Training:
    """A witness of tiny trainings on tasks of `witness_tasks`."""

    tasks: tuple[str, ...]
    methods: tuple[str, ...] = ("raw",)
    agents: tuple[str, ...] | None = None
    track: str = "shared"
    budget: str = "quick"

    def __call__(self) -> dict[str, Any]:
        """Scores, curves, traces and weights."""
        with tempfile.TemporaryDirectory() as folder:
            results = stlbench.run_study(
                tasks=[str(TASKS / task) for task in self.tasks],
                methods=self.methods,
                agents=self.agents,
                seeds=1,
                track=self.track,
                budget=self.budget,
                jobs=1,
                executor="witness-here",
                results=folder,
            )
            failures = results.failures()
            assert failures.empty, failures.to_string()
            scores, curves, planned = results.robustness(), results.curves(), results.cells()["grid_value"]
            numbers: dict[str, Any] = {
                "scores": scores[["robustness_mean", "robustness_min", "satisfaction", "ended_early"]].to_numpy(float),
                "curve": curves[["steps", "satisfaction", "robustness_mean"]].to_numpy(float),
                "planned": planned.to_numpy(float),
            }
            for result in results:
                name = f"{result.id.task.name} {result.id.method} {result.id.agent}"
                numbers[f"{name} done"] = result.status == "done"
                if result.status == "done":
                    numbers[f"{name} traces"] = results.traces(result.id).samples
                    numbers |= {f"{name} weights {i}": each for i, each in enumerate(_weights(results, result.id))}
        return numbers


def _weights(results: stlbench.Results, cell: Any) -> list[Any]:
    """The arrays of floating-point numbers that a trained policy consists of; none of a plan, which is not stored."""
    with suppress(UsageError):
        arrays = results.policy(cell, which="final").policy.arrays() or {}
        return [array for array in arrays.values() if array.dtype.kind == "f"]
    return []


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


FORMULAS = (
    "G[8,30] (abs(x - 1) <= 0.6) & F[2,20] (abs(y + 1) <= 0.5)",
    "G[0,20] F[0,10] (x >= 0.5 | y >= 1)",
    "F[0,20] G[0,6] (norm(x, y) <= 1.2)",
    "F[0,30] (x >= 1 & F[0,0] y <= 0.5) & G[0,30] (y >= -3)",
    "G[0,28] (x <= 2.5 & y >= -2.5)",
)
STEPS = 30

VARIANTS: Mapping[str, tuple[str, ...]] = {
    "bhnr": ("", "mode=block", "semantics=lse"),
    "cfer": ("", "flags=published"),
    "dense": ("", "mode=difference"),
    "flag": ("", "beta=10"),
    "funnel": ("", "variant=code", "shape=clipped", "shape=normalised,t_star=0.5,ginf=0.05", "activity=literal"),
    "hprs": ("", "later=target", "variant=auto-shaping"),
    "machine": ("", "shaping=phases"),
    "raw": ("", "activity=literal"),
    "sparse": ("", "pays=failure"),
    "tau-cmdp": ("", "window=after"),
    "tau-mdp": ("", "form=probability"),
}
"""Parameters of methods, beside their defaults."""


def rewards(method: str) -> dict[str, Any]:
    """What a method pays and shows on fixed traces, for formulas of several shapes; NaN where it is unsuitable."""
    generator = np.random.default_rng(7)
    walks = np.clip(np.cumsum(generator.normal(0, 0.5, (6, STEPS + 1, 2)), axis=1), -3.9, 3.9)
    numbers = dict[str, Any]()
    for parameters in VARIANTS.get(method, ("",)):
        name = f"{method}[{parameters}]" if parameters else method
        for place, formula in enumerate(FORMULAS):
            numbers[f"{name} {place}"] = _paid(name, formula, walks)
    return numbers


def _paid(method: str, formula: str, walks: Any) -> Any:
    """Rewards of each step, and the method's inputs at the end."""
    copies = SyncVectorEnv([lambda walk=walk: _Played(walk) for walk in walks], autoreset_mode=AutoresetMode.DISABLED)
    ranges = {"x": (-4.0, 4.0), "y": (-4.0, 4.0)}
    try:
        env = stlbench.wrap(copies, formula, names=("x", "y"), ranges=ranges, steps=STEPS, method=method)
    except (Unsuitable, UsageError):
        return np.array([np.nan])
    env.reset(seed=0)
    still = np.zeros((len(walks), 1))
    steps = [env.step(still)[:2] for _ in range(STEPS)]
    paid = np.array([reward for _, reward in steps], dtype=float)
    return np.concatenate([paid.sum(axis=0), paid.ravel(), np.ravel(steps[-1][0])])


# -------------------------------------------------------------------------------------------------------------- tasks

_FEW = 60
"""Decisions of an environment, whose episode may take seconds."""


def moves(name: str) -> dict[str, Any]:
    """Where fixed actions lead from fixed starts, what policies see of it, and margins and robustness."""
    env = StlVectorEnv(2, name, "flag")
    task, generator = env.task, np.random.default_rng(11)
    system = _system(name)
    observation, info = env.reset(seed=3)
    seen, signals, paid = [observation], [info["signals"]], []
    over = np.zeros(2, dtype=bool)
    while not over.all() and (system or len(paid) < _FEW):
        observation, reward, _, over, info = env.step(_actions(env, generator))
        last = info.get("final_info", info)
        seen.append(np.stack(info["final_obs"]) if "final_obs" in info else observation)
        signals.append(last["signals"])
        paid.append(reward)
    env.close()
    trace = np.concatenate(signals, axis=1).astype(float)
    numbers = {"signals": trace[:, ::7], "last": trace[:, -1], "seen": np.array(seen), "paid": np.array(paid)}
    if system:
        numbers["robustness"] = [stl.robustness(task.formula, one, task.signals).item() for one in trace]
    return numbers | system


def _actions(env: StlVectorEnv, generator: np.random.Generator) -> Any:
    actions = env.task.actions
    if isinstance(actions, ActionGrid):
        return generator.integers(actions.size, size=env.num_envs)
    space = env.action_space
    return generator.uniform(space.low, space.high).astype(space.dtype)


def _system(name: str) -> dict[str, Any]:
    """Steps of a system alone, and what policies see of them in double precision; nothing where a task is none."""
    task, generator = load_task(name), np.random.default_rng(13)
    try:
        system, actions = task.system, task.actions
    except Unsuitable:
        return {}
    states = task.starts.of_training(np.random.default_rng(5), 5)
    numbers = {"starts": states}
    for t in range(8):
        states = system.step(states, generator.uniform(actions.low, actions.high, (5, len(actions.names))))
        clock = np.full(5, t + 1)
        numbers[f"state {t}"] = states
        numbers[f"features {t}"] = system.features(states, clock)
        numbers[f"scaled {t}"] = system.scaled_state(states)
        numbers[f"read {t}"] = system.signals(states)
    return numbers


# --------------------------------------------------------------------------------------------------------- witnesses


@dataclass(frozen=True)
class Witness:
    """Of one part: how its numbers are computed, and the other parts that they depend on."""

    part: str
    compute: Callable[[], Numbers]
    others: tuple[str, ...] = ("harness",)
    needs: tuple[str, ...] = ()
    """Modules of optional packages, without which it cannot be computed."""

    @property
    def depends(self) -> dict[str, int]:
        """The revisions of the part and of those that it depends on."""
        known = revisions()
        return {name: known[name] for name in (self.part, *self.others)}

    @property
    def missing(self) -> str | None:
        """The first module that is not installed."""
        return next((module for module in self.needs if find_spec(module) is None), None)


_HARNESS = (
    Training(
        ("points", "points[without=features]", "points[without=hold]", "points[without=cuts+exploring]"), ("raw",)
    ),
    Training(("points",), ("flag",), track="plain"),
    Training(("pole-holds", "pole-fails", "pole-unknown"), ("flag",)),
)


_VIEWED = (*FORMULAS, "G[0,20] (x >= 1 -> F[0,9] norm(x, y - 1) <= 0.5) & F[3,9] y >= 0 & F[9,12] y >= 1")


def _view() -> Numbers:
    """What policies see of some formulas, and a training on the track `auto`."""
    generator = np.random.default_rng(17)
    state, signals = generator.uniform(-1, 1, (40, 3)), generator.uniform(-4, 4, (40, 2))
    t, ranges = generator.integers(0, STEPS + 1, 40), {"x": (-4.0, 4.0), "y": (-4.0, 4.0)}
    views = [FormulaView(stl.parse(formula), ranges, STEPS) for formula in _VIEWED]
    seen = {formula: view(state, signals, t) for formula, view in zip(_VIEWED, views, strict=True)}
    # The recipe and the task file are parts of each key, so other rules need no revision. The discount is named here;
    # after a change of other rules the pin is removed and written again. The budget quick would be lengthened: long
    # trainings differ from processor to processor.
    trained = Training(("points",), ("raw",), ("dqn[gamma=0.95]",), track="auto", budget="smoke")()
    return seen | {name.replace("[gamma=0.95]", ""): values for name, values in trained.items()}


def _harness() -> Numbers:
    computed = [training() for training in _HARNESS]
    return {f"{place} {name}": values for place, numbers in enumerate(computed) for name, values in numbers.items()}


_AGENTS: Mapping[str, tuple[str, ...]] = {
    "dqn": ("points",),
    "dqn-per-robot": ("points",),
    "planner": ("points",),
    "best-possible": ("points",),
    "sb3-dqn": ("points",),
}
_TASKS: Mapping[str, tuple[str, ...]] = {
    "ball-in-cup": ("mujoco", "dm_control"),
    "cartpole": ("mujoco", "dm_control"),
    "fetch-reach": ("mujoco", "gymnasium_robotics"),
    "hopper": ("mujoco",),
    "lane": ("highway_env",),
    "lunar-lander": ("Box2D",),
    "walker": ("mujoco",),
}


def _agent(name: str) -> Witness:
    is_sb3 = name.startswith("sb3-")
    methods = ("tltl",) if is_sb3 else ("flag", "tltl")
    training = Training(_AGENTS.get(name, ("thrust",)), methods, (name, *_RECIPES.get(name, ())))
    others = ("harness", *(f"methods.{method}" for method in methods))
    return Witness(f"agents.{name}", training, others, ("stable_baselines3",) if is_sb3 else ())


_RECIPES: Mapping[str, tuple[str, ...]] = {
    "dqn": ("dqn[head=additive,averaging=0]", "dqn[net_arch=64+64,n_steps=1,double=false]"),
    "td3": ("td3[net_arch=64+64,gradient_steps=2]",),
}


def _method(name: str) -> Witness:
    def compute() -> Numbers:
        return {**rewards(name), **Training(("points",), (name,))()}

    return Witness(f"methods.{name}", compute, ("harness", "agents.dqn"))


def _task(name: str) -> Witness:
    others = ("harness",) if name == "flag" else ("harness", "methods.flag")
    return Witness(f"tasks.{name}", lambda: moves(name), others, _TASKS.get(name, ()))


def _suite(name: str) -> Witness:
    """One task of each system."""
    names = [each for each in suites.named(f"{name}:core") if each.endswith("-reach-stay-1")]

    def compute() -> Numbers:
        return {f"{each} {key}": values for each in names for key, values in moves(each).items()}

    return Witness(f"suites.{name}", compute, ("harness", "methods.flag"))


def witnesses() -> Iterator[Witness]:
    """One for each part."""
    alone = {
        "harness": Witness("harness", _harness, ("methods.raw", "methods.flag", "agents.dqn")),
        "view": Witness("view", _view, ("harness", "methods.raw", "agents.dqn")),
    }
    makers = {"agents": _agent, "methods": _method, "suites": _suite, "tasks": _task}
    for part in revisions():
        kind, _, name = part.partition(".")
        yield makers[kind](name) if name else alone[part]


# -------------------------------------------------------------------------------------------------------------- pinning


def digest(numbers: Numbers) -> str:
    """Of all bits."""
    hashed = hashlib.sha256()
    for name, values in numbers.items():
        array = np.ascontiguousarray(values)
        hashed.update(f"{name} {array.dtype} {array.shape}\n".encode() + array.tobytes())
    return hashed.hexdigest()[:32]


def sketch(numbers: Numbers) -> list[float]:
    """A few numbers: of 12 arrays the mean of the magnitudes."""
    floats = [np.asarray(values, float) for values in numbers.values() if np.asarray(values).dtype.kind in "fiub"]
    chosen = [floats[i] for i in np.linspace(0, len(floats) - 1, min(12, len(floats))).astype(int)]
    return [float(f"{np.nanmean(np.abs(each)) if np.isfinite(each).any() else 0.0:.8g}") for each in chosen]


def problem(witness: Witness, numbers: Numbers, pins: Mapping[str, Any]) -> str | None:
    """In a line, what is wrong with a part's pin; None where it holds."""
    pin, part = pins["parts"].get(witness.part), witness.part
    if pin is None or pin["revisions"] != witness.depends:
        return f"no pin of {part} for these revisions: run `python tests/helpers/witnesses.py --write`"
    same = digest(numbers) == pin["digest"]
    if here() != pins["machine"]:
        same = len(pin["values"]) == len(sketch(numbers)) and np.allclose(sketch(numbers), pin["values"], RTOL, ATOL)
    if same:
        return None
    number = witness.depends[part]
    return (
        f"the bits of {part} have changed, and its revision has not: if that is meant, raise {part} from {number} to "
        f"{number + 1} in stlbench/registry/revisions.yaml, list the change in CHANGELOG.md under Results, and run "
        "`python tests/helpers/witnesses.py --write`"
    )


def read_pins() -> dict[str, Any]:
    """The file of pins."""
    if not PINS.exists():
        return {"machine": here(), "parts": {}}
    return dict(json.loads(PINS.read_text(encoding="utf-8")))


def write() -> list[str]:
    """Pin what has no pin; the problems of parts whose bits have changed without a new revision."""
    pins, parts, problems = read_pins(), dict[str, Any](), list[str]()
    for witness in witnesses():
        if witness.missing:
            return [f"{witness.part}: {witness.missing} is not installed, and all extras must be to write pins"]
        numbers = witness.compute()
        said = problem(witness, numbers, pins)
        parts[witness.part] = {"revisions": witness.depends, "digest": digest(numbers), "values": sketch(numbers)}
        if said and not said.startswith("no pin"):
            problems.append(said)
    if not problems:
        PINS.write_text(json.dumps({"machine": here(), "parts": parts}, indent=1) + "\n", encoding="utf-8")
    return problems


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit("usage: python tests/helpers/witnesses.py --write")
    sys.exit("\n".join(write()))
