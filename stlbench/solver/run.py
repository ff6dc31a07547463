"""`stlbench.solve`: understand the problem, race, decide, deliver."""

import math
import re
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from types import FunctionType
from typing import Any, Literal, get_args

import gymnasium
import numpy as np
from gymnasium.envs.registration import load_env_creator
from gymnasium.wrappers import HumanRendering, OrderEnforcing, PassiveEnvChecker, RenderCollection

from stlbench.errors import UsageError, did_you_mean, one_line
from stlbench.records.result import Result
from stlbench.registry.choices import LOCAL
from stlbench.search.certify import Claim, check
from stlbench.share.source import from_here
from stlbench.solver.contestants import best_first
from stlbench.solver.deliver import Delivery, sentence
from stlbench.solver.earlier import EarlierPolicy
from stlbench.solver.problem import Problem
from stlbench.solver.race import Race
from stlbench.solver.solution import FILE, TEXT, Solution, certificate_of
from stlbench.solver.trainer import Clock
from stlbench.solver.workspace import is_of, workspace_of
from stlbench.study.progress import Progress, duration
from stlbench.task.file import EarlyEnd
from stlbench.task.gym_make import blaming, layers, made

_WORDS: Mapping[str, tuple[str, ...]] = {"time": ("steps", "seconds"), "terminated": get_args(EarlyEnd)}
_TRIES = 10
"""The number of tries: each has 1000 of the 10,000 seeds that a study may have."""
_IDLE = (HumanRendering, OrderEnforcing, PassiveEnvChecker, RenderCollection)
"""Layers of an environment that change no episode."""
_ADDRESS = re.compile(r" at 0x\w+")
"""Python's number of an object, which another copy of it does not have."""
_ANEW = (
    "trainings make it anew: register it so in a module, `gymnasium.register('Mine-v0', make_mine, "
    "max_episode_steps=200)`, and name it 'my_module:Mine-v0'"
)
_SAID = {"satisfied", "starts", "low", "confidence", "probability"}
"""Facts of a certificate that are shown."""


def solve(
    environment: str | gymnasium.Env[Any, Any],
    formula: str | None = None,
    *,
    signals: Mapping[str, str | int] | None = None,
    minutes: float = 10.0,
    into: str | Path | None = None,
    confidence: float = 0.95,
    time: Literal["steps", "seconds"] | None = None,
    terminated: EarlyEnd | None = None,
    start: str | Path | None = None,
    seed: int = 0,
    executor: str = LOCAL,
    jobs: int | None = None,
    progress: bool = False,
) -> Solution:
    """Make a policy with a certificate from an environment and a formula: `stlbench solve` in Python.

    A folder keeps the work that is done. After an interrupt the best policy so far is written there, with a certificate
    from few starts, and `KeyboardInterrupt` is raised. The same call goes on.

    Args:
        environment: an id of Gymnasium, "CartPole-v1" or "my_module:Mine-v0"; a registered environment; or a task of
            stlbench, by its name or its folder's path.
        formula: what the policy has to satisfy; None for the task's own.
        signals: signal -> expression over the entries of the observation, {"theta": "atan2(y, x)"}. `obs[0]`, or the
            number 0, is the first entry, and `obs[key][0]` the first of a Dict. Entries are signals by their own names,
            and so are numbers of the info that every step and reset has.
        minutes: how long it may take. The first look, the files and a busy machine can take a minute more.
        into: the folder. If None, "solved/" and the environment's name, with a number where another problem is there.
        confidence: of the certificate, in (0, 1).
        time: unit of the formula's intervals; steps, or what the task says, if None.
        terminated: what it means that the environment ends an episode early, as in a task file; by the formula if None.
        start: folder of an earlier solution, of the same observations and actions. Trainings start from its policy,
            with the same method and agent.
        seed: from 0 to 9. Another number is another try, with other seeds of all trainings.
        executor: where trainings run, as for `run_study`.
        jobs: trainings at a time.
        progress: print on stderr how it goes on.

    Raises:
        UsageError: in one line, what is wrong with the environment, the formula, a signal, the folder or the time.
    """
    check(Claim(confidence))
    _check(minutes, seed, time=time, terminated=terminated)
    identifier, keywords = _identified(environment)
    if ":" in identifier:
        from_here()
    texts = {name: f"obs[{text}]" if isinstance(text, int) else text for name, text in _named(signals).items()}
    clock, screen = Clock(minutes), Progress()

    def note(text: str) -> None:
        if progress:
            screen.note(text)

    def say(text: str) -> None:
        note(f"== {text}; {duration(clock.left)} left" if clock.left else f"== {text}")

    begun = None if start is None else EarlierPolicy.of(Path(start))
    digest = None if begun is None else begun.digest
    problem = Problem(identifier, formula, texts, time, terminated, keywords, digest, seed)
    folder = Path(into) if into is not None else _folder(problem)
    say(f"understanding {identifier}, in {folder}")
    with blaming(identifier):
        workspace = workspace_of(problem, folder, minutes, note)
    for line in (*workspace.doubts, *workspace.notes):
        note(line)
    if begun is not None:
        begun.check(workspace.task)
    workspace.begin(minutes)
    trainer = Race(workspace, clock, say, progress, executor, jobs, begun, seed)
    try:
        if (trained := trainer.chosen()) is None:
            winner = trainer.race()
            trained = trainer.improve(best_first(trainer.final(winner), [winner]))
    except KeyboardInterrupt:
        if (trained := trainer.kept()) and not _is_delivered(folder, trained[0], confidence):
            say("interrupted: a short certificate of the best so far; ctrl-C again leaves it out")
            note(sentence(Delivery(workspace, problem, clock, confidence, trained, interrupted=True).write()))
        raise
    if not _is_delivered(folder, trained[0], confidence):
        say("certificate, counterexamples and files")
        with blaming(identifier):
            Delivery(workspace, problem, clock, confidence, trained).write()
    workspace.drop_trainings()
    solution = Solution.load(folder, run_code=True)  # the task is the user's own
    note(sentence(solution.certificate))
    return solution


def _check(minutes: float, seed: int, **words: str | None) -> None:
    for name, value in words.items():
        if value is not None and value not in _WORDS[name]:
            raise UsageError(f"{name}: unknown {value!r}{did_you_mean(str(value), _WORDS[name])}")
    if not isinstance(minutes, int | float) or not 0 < minutes < math.inf:
        raise UsageError(f"minutes should be more than 0 and finite, got {_shown(minutes)}")
    if not isinstance(seed, int) or seed not in range(_TRIES):
        raise UsageError(f"seed should be a whole number from 0 to {_TRIES - 1}, got {_shown(seed)}")


def _shown(value: object) -> str:
    return one_line(f"{value:g}" if isinstance(value, int | float) else repr(value))


def _folder(problem: Problem) -> Path:
    """The folder of this problem in `solved`, or the first that is free."""
    name = re.sub(r"[^a-z0-9]+", "-", problem.environment.lower()).strip("-") or "task"
    folders = (Path("solved") / (f"{name}-{number}" if number > 1 else name) for number in count(1))
    return next(folder for folder in folders if not folder.exists() or is_of(problem, folder))


def _named(signals: Mapping[str, str | int] | None) -> Mapping[str, str | int]:
    """The signals, checked."""
    if not isinstance(signals or {}, Mapping):
        raise UsageError(f'signals should be a dict, {{"theta": "atan2(y, x)"}}, got {_shown(signals)}')
    for name, text in (signals or {}).items():
        if not isinstance(text, str | int):
            raise UsageError(f"signal {name} should be an expression, or the number of an entry, got {one_line(text)}")
    return signals or {}


def _identified(environment: str | gymnasium.Env[Any, Any]) -> tuple[str, dict[str, Any]]:
    """The id by which a fresh process makes it, with what it is made with. Raises `UsageError` if that is another."""
    if isinstance(environment, str):
        return environment, {}
    if not isinstance(environment, gymnasium.Env):
        raise UsageError(f"environment should be an id or an environment, got {_shown(environment)}; {_ANEW}")
    spec, kind = environment.spec, type(environment.unwrapped)
    entry: Any = spec and spec.entry_point
    creator = load_env_creator(entry) if isinstance(entry, str) else entry
    home = (creator if isinstance(creator, FunctionType) else kind).__module__
    if spec is None or home == "__main__":
        raise UsageError(f"{kind.__name__} has no id by which it can be made; {_ANEW}")
    own = spec.namespace is None and not home.startswith("gymnasium.")
    identifier, facts = f"{home}:{spec.id}" if own else spec.id, _facts(environment)
    keywords: dict[str, Any] = facts["arguments"]
    registered = _facts(made(identifier, keywords, limit=None))
    if wrong := [name for name, fact in registered.items() if facts[name] != fact]:
        differ = "; ".join(f"its {name} should be {registered[name]}, got {facts[name]}" for name in wrong[:2])
        raise UsageError(f"the environment is not {spec.id} as registered: {one_line(differ)}; {_ANEW}")
    return identifier, keywords


def _facts(env: gymnasium.Env[Any, Any]) -> dict[str, Any]:
    """What its id should make again. Layers that only check or draw are left out."""
    spec: Any = env.spec
    idle = {kind.__name__ for kind in _IDLE}
    recorded = [(each.entry_point, each.kwargs) for each in spec.additional_wrappers if each.name not in idle]
    return {
        "time limit": spec.max_episode_steps,
        "layers": ", ".join(kind.__name__ for kind in layers(env) if kind not in _IDLE),
        "entry point": _ADDRESS.sub("", f"{spec.entry_point}"),
        "arguments": {name: _plain(name, value) for name, value in spec.kwargs.items() if name != "render_mode"},
        "wrappers": _ADDRESS.sub("", f"{recorded}"),
    }


def _plain(name: str, value: Any) -> Any:
    """The value of an argument as a task file has it. Raises `UsageError` if none can."""
    value = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    if isinstance(value, Mapping) and all(type(key) is str for key in value):
        return {key: _plain(f"{name}.{key}", part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(name, part) for part in value]
    if value is not None and type(value) not in (bool, int, float, str):
        kinds = "numbers, texts, and lists and mappings of them"
        raise UsageError(f"the environment's argument {name} is {one_line(value)}, a task file has {kinds}; {_ANEW}")
    return value


def _is_delivered(folder: Path, best: Result, confidence: float) -> bool:
    """Whether the files are those of this training, at this confidence."""
    try:
        facts = certificate_of(folder / FILE)
    except (OSError, ValueError):
        return False
    whole = facts.get("interrupted") is False and facts.keys() >= _SAID and (folder / TEXT).is_file()
    return bool(whole and facts.get("key") == best.key and facts["confidence"] in (confidence, None))
