"""The result of `stlbench solve`: a policy that acts on an environment's own observations, and its certificate."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stlbench.contract import ActionGrid, Array, GymTask, Integers, System
from stlbench.errors import UsageError
from stlbench.records.result import LEARNED
from stlbench.records.result_files import inside, read
from stlbench.registry import named_tasks
from stlbench.simulation.faults import pay
from stlbench.simulation.worlds import scaled_times, time_and_inputs
from stlbench.solver.workspace import TASK
from stlbench.study.policies import LoadedPolicy, load_policy
from stlbench.study.results import Results
from stlbench.task.gym_spaces import as_action
from stlbench.task.reading import code_of

FILE, TEXT = "certificate.json", "solution.md"
FINAL, RACE = "final", "race"
"""Folders of results: of the last trainings, the first of which has a budget of that name, and of all before."""
MORE = "more-"
"""The beginning of the budgets of those that go on after it."""


class Acting:
    """A stored policy that acts on what its environment shows, or on a system's state.

    Call it at every step of an episode, from t = 0 on: the method's inputs depend on the samples so far. Beyond the
    formula's horizon it acts as in its last decision.
    """

    def __init__(self, loaded: LoadedPolicy) -> None:
        self.task, self._method, self._policy = loaded
        self._times = scaled_times(self.task.file.steps)
        self._next = 0
        self._memory: Array = np.zeros((1, 0))
        self._sample: Array = np.zeros((1, 0))
        self._vector: Array = np.zeros((1, 0))

    def __call__(self, observation: Any, t: int, info: Mapping[str, Any] | None = None) -> Any:
        """The action at step t of an episode, as the environment takes it.

        Args:
            observation: what the environment shows; of a task on a system its state (n,).
            t: steps since the reset. A 0 begins a new episode.
            info: of the environment, where signals are entries of it.

        Raises:
            UsageError: t is not 0 or the step after that of the last call, or a signal needs the info.
        """
        if t not in (0, self._next):
            raise UsageError(f"t is {t}; expected is 0, or {self._next}, the next step of the episode")
        seen, sample = self._read(observation, info)
        if t == 0:
            self._memory = self._method.initial_memory(sample, np.array([0]))
        elif t < self.task.file.steps:
            both = np.stack([self._sample, sample])
            _, self._memory = pay(self._method, both, self._vector, np.array([t - 1]), self._memory)
        self._sample, self._next = sample, t + 1
        if t % self.task.file.hold == 0:
            self._vector = self._decide(seen, sample, np.array([min(t, self.task.file.steps - self.task.file.hold)]))
        if isinstance(self.task.dynamics, GymTask):
            return as_action(self.task.source.action_space, self._vector[0])
        return self._vector[0].copy()

    def _read(self, observation: Any, info: Mapping[str, Any] | None) -> tuple[Array, Array]:
        """The policy's view of the observation (1, d), and the signals (1, k)."""
        dynamics = self.task.dynamics
        if isinstance(dynamics, System):
            state = np.asarray(observation, dtype=np.float64)[None]
            return dynamics.scaled_state(state), dynamics.signals(state)
        if not isinstance(dynamics, GymTask):
            raise UsageError(f"{type(dynamics).__name__} is a world of its own, whose observations are not known here")
        if info is None and (names := self.task.source.expressions.from_info):
            rule = "pass the info as the third argument, policy(observation, t, info)"
            raise UsageError(f"signals: '{names[0]}' is an entry of the info; {rule}")
        seen, sample = self.task.source.read([(observation, info or {})])
        return self.task.source.observed.scaled(seen), sample

    def _decide(self, seen: Array, sample: Array, t: Integers) -> Array:
        view = [] if self.task.view is None else [self.task.view(seen, sample, t)]
        shown = [seen, *view, *time_and_inputs(self._method, self._times, t, self._memory)]
        action: Any = self._policy.act(np.concatenate(shown, axis=1))
        actions = self.task.actions
        vector: Array = actions.vectors[action] if isinstance(actions, ActionGrid) else action
        return np.clip(vector, actions.low, actions.high)


@dataclass(frozen=True)
class Solution:
    """The result of `stlbench.solve`.

    Attributes:
        folder: with the policy, the task file, the certificate and the page.
        certificate: what `certificate.json` has: starts, how many satisfied, the interval and its confidence.
        policy: the policy, `policy(observation, t, info)`. The info may be left out if no signal is of it.
    """

    folder: Path
    certificate: Mapping[str, Any]
    policy: Acting = field(repr=False)

    @classmethod
    def load(cls, folder: str | Path, run_code: bool = False) -> Solution:
        """The solution in a folder that `stlbench solve` wrote.

        Args:
            folder: as `into` of `solve`.
            run_code: whether code that the folder has or names may run: `task/system.py`, the module in the id of an
                environment, what a text among its arguments names. Only say so of a folder that you trust.

        Raises:
            UsageError: there is no solution, or its task needs code that may not run.
        """
        place = Path(folder)
        try:
            certificate = certificate_of(place / FILE)
            cells, home = (inside(place / name, place, "read") for name in (cells_of(certificate["budget"]), TASK.name))
            for path in home.iterdir():
                inside(path, place, "read")
            code = code_of(home)
        except (OSError, ValueError) as error:
            raise UsageError(f"{place} has no solution; `stlbench solve` writes one: {error}") from error
        if code and not run_code:
            raise UsageError(f"{place}: its task runs {', '.join(code)}; if you trust it, load it with run_code=True")
        named_tasks.know(home, instead=True)
        result = Results.load(cells).cell(certificate["cell"], certificate["budget"])
        return cls(place, certificate, Acting(load_policy(cells, result)))

    @property
    def learned(self) -> bool:
        """Whether the policy satisfies from at least 95 % of the starts of the certificate."""
        return bool(self.certificate["probability"] >= LEARNED)

    def report(self) -> str:
        """The text of `solution.md`."""
        return read(self.folder / TEXT, self.folder).decode()


def cells_of(budget: str) -> str:
    """The folder of results that has the trainings of a budget."""
    return FINAL if budget == FINAL or budget.startswith(MORE) else RACE


def certificate_of(path: Path) -> Mapping[str, Any]:
    """The content of a certificate's file. Raises `OSError` or `ValueError`, and `UsageError` for a link."""
    content = json.loads(read(path, path.parent))
    if not isinstance(content, dict) or not all(isinstance(content.get(name), str) for name in ("cell", "budget")):
        raise ValueError(f"{path.name} names no cell with its budget")
    return content
