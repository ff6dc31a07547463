"""The content of a `task.yaml`, checked all at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from stlbench import stl
from stlbench.contract import Array, Truth
from stlbench.errors import UsageError, did_you_mean
from stlbench.result import MAIN

__all__ = ["Budget", "Protocol", "Region", "TaskFile", "read_task_file"]

Count = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Range(_Strict):
    """Where a signal lives: the state space over which rho_max and rho_min are taken."""

    low: Finite
    high: Finite
    unit: str = ""

    @model_validator(mode="after")
    def _ordered(self) -> Range:
        if self.low >= self.high:
            raise ValueError(f"low must be less than high, got {self.low} and {self.high}")
        return self


class Axis(Range):
    """One axis of the actions: `count` evenly spaced values from `low` to `high`, both included, or all between."""

    count: Annotated[int, Field(ge=2)] | None = None
    """Continuous where left out."""

    @property
    def values(self) -> tuple[float, ...]:
        """A counted axis' values, rounded so that -5, -4.5, ... are exactly that."""
        assert self.count is not None
        return tuple(float(value) for value in np.round(np.linspace(self.low, self.high, self.count), 12))


class Region(_Strict):
    """A set of initial states: a box over the state's names, numbers where a state is fixed, a condition."""

    box: dict[str, Finite | tuple[Finite, Finite]]
    where: str | None = None
    """A formula without temporal operators over the state's names that initial states fulfil."""

    @model_validator(mode="after")
    def _checked(self) -> Region:
        for name, ends in self.box.items():
            if isinstance(ends, tuple) and ends[0] > ends[1]:
                raise ValueError(f"{name}: low must not exceed high, got {list(ends)}")
        if self.where is not None:
            stl.holds(stl.parse(self.where), tuple(self.box))
        return self

    @property
    def low(self) -> Array:
        """Lower corner, (n,)."""
        return np.array([ends[0] if isinstance(ends, tuple) else ends for ends in self.box.values()])

    @property
    def high(self) -> Array:
        """Upper corner, (n,)."""
        return np.array([ends[1] if isinstance(ends, tuple) else ends for ends in self.box.values()])

    def keep(self, states: Array) -> Array:
        """Those of the states (N, n) that fulfil `where`."""
        if self.where is None:
            return states
        return states[_predicate(self.where, tuple(self.box))(states)]


@cache
def _predicate(text: str, names: tuple[str, ...]) -> Callable[[Array], Truth]:
    return stl.holds(stl.parse(text), names)


class Protocol(_Strict):
    """A further way to score the policy: another formula, other starts, or both. Robustness is averaged over them."""

    title: str
    formula: str | None = None
    """In the unit that `time` names; the task's own formula where left out."""
    initial: Region | None = None
    """The task's own initial states where left out."""
    starts: Count = 64


class Exploring(_Strict):
    """Training episodes that begin at a random time of the task, a decision's, instead of at its start."""

    share: Annotated[float, Field(gt=0, le=1)]
    """Of the training episodes."""
    kept: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Of these, the share that begins in the state in which the copy's last episode ended."""
    states: Region | None = None
    """Where the others begin; among the states from which episodes start where left out."""
    length: Count | None = None
    """They are broken off after this many decisions on average; at the end of the task where left out."""


class Lost(_Strict):
    """States from which no training episode goes on, such as a pole that fell."""

    where: str
    """A formula without temporal operators over the signals."""
    reward: Finite
    """As if it were paid for ever after, in units of the method's `scale`."""


class Training(_Strict):
    """How training episodes differ from those that the referee scores, the same for every method and agent."""

    starts: Region | None = None
    """Where episodes start; `initial` where left out."""
    cuts: tuple[Count, ...] = ()
    """Phase boundaries, steps at which the reward begins to ask for something else. A return stops there, with the
    value of going on as before: an agent that looks across leaves too early (anticipation)."""
    violation: Finite | None = None
    """An episode ends where a term G[a,b] psi is lost, as if this reward, in units of the method's `scale`, were paid
    for ever after. Episodes go on where left out."""
    lost: Lost | None = None
    exploring: Exploring | None = None


class Budget(_Strict):
    """How much training, on how many seeds."""

    steps: Count
    """Environment steps of one sampling time, all copies together."""
    seeds: Count = 3
    deadline: Positive = 3600.0
    """Wall seconds after which a cell is stopped."""
    checkpoints: Count = 20


OPTIONAL = ("rewarded", "hold", "cuts", "violation", "lost", "exploring")
"""What a task can be trained without, to learn what it is worth."""


class TaskFile(_Strict):
    """The content of a `task.yaml`."""

    title: str
    source: str
    """Where the task comes from: paper and section."""
    notes: str = ""
    """What a reader of the results should know, such as a choice that the source leaves open."""
    formula: str
    rewarded: str | None = None
    """The formula as reward methods are told it, where predicates are brought to one scale, capped or stretched:
    satisfied when the formula is. The referee scores `formula`."""
    nested: str | None = None
    """The same task as an outer operator over an inner window, for methods that need that form."""
    time: Literal["steps", "seconds"] = "steps"
    """Unit of the formulas' intervals."""
    sampling_time: Positive
    """Seconds a step."""
    steps: Count
    """T, transitions in an episode."""
    hold: Count = 1
    """Steps for which an agent's action is held."""
    signals: Annotated[dict[str, Range], Field(min_length=1)]
    plane: tuple[str, str] | None = None
    """The two signals, across and up, in whose plane figures and films show trajectories."""
    parameters: dict[str, Any] = {}
    """Keyword arguments of the system."""
    actions: Annotated[dict[str, Axis], Field(min_length=1)]
    robots: dict[str, Annotated[tuple[str, ...], Field(min_length=1)]] = {}
    """Robot -> its actions, where there is more than one robot; together all actions, in their order."""
    initial: Region
    """Where the referee's starts lie."""
    training: Training = Training()
    starts: Count = 64
    """Initial states on the report grid; as many others are kept for the selection of checkpoints."""
    protocols: dict[str, Protocol] = {}
    input_limit: Count = 512
    agents: Annotated[dict[str, dict[str, Any]], Field(min_length=1)]
    """Agent -> recipe, the same for every method. The first is the task's own agent."""
    budgets: Annotated[dict[str, Budget], Field(min_length=1)]

    @property
    def training_starts(self) -> Region:
        """Where training episodes start."""
        return self.training.starts or self.initial

    @property
    def dt(self) -> float | None:
        """What `stl.parse` needs to read intervals: None for steps."""
        return self.sampling_time if self.time == "seconds" else None

    def parsed(self, text: str) -> stl.Formula:
        """A formula of this file, its intervals in steps; `G` and `F` without one reach to the end of the episode."""
        return stl.resolve_end(stl.parse(text, dt=self.dt), self.steps)

    def without(self, part: str) -> TaskFile:
        """This file without one of OPTIONAL, for an ablation. Raises `ValueError` where it is without it already."""
        if part not in OPTIONAL:
            raise ValueError(f"a task is never without '{part}', but perhaps without {', '.join(OPTIONAL)}")
        owner: BaseModel = self.training if part in Training.model_fields else self
        plain = type(owner).model_fields[part].default
        if getattr(owner, part) == plain:
            raise ValueError(f"the task is without {part} as it is")
        changed = owner.model_copy(update={part: plain})
        return changed if isinstance(changed, TaskFile) else self.model_copy(update={"training": changed})

    @model_validator(mode="after")
    def _consistent(self) -> TaskFile:
        problems = [*self._formula_problems(), *self._same_horizon_problems()]
        if self.steps % self.hold:
            problems.append(f"hold: an episode of {self.steps} steps is no multiple of hold = {self.hold}")
        for cut in self.training.cuts:
            if cut % self.hold or cut >= self.steps:
                problems.append(f"training.cuts: {cut} is no multiple of hold = {self.hold} below steps = {self.steps}")
        if self.training.lost is not None:
            try:
                stl.holds(stl.parse(self.training.lost.where), tuple(self.signals))
            except ValueError as error:
                problems.append(f"training.lost.where: {error}")
        for name in self.plane or ():
            if name not in self.signals:
                problems.append(f"plane: no signal '{name}'{did_you_mean(name, self.signals)}")
        if self.plane is not None and self.plane[0] == self.plane[1]:
            problems.append(f"plane: two different signals are needed, got '{self.plane[0]}' twice")
        if len({axis.count is None for axis in self.actions.values()}) > 1:
            problems.append("actions: give each axis a count, for a grid, or none, for continuous actions")
        owned = [name for names in self.robots.values() for name in names]
        if self.robots and owned != list(self.actions):
            wanted = f"they should have each of {', '.join(self.actions)} once, in this order"
            problems.append(f"robots: together they have {', '.join(owned)}; {wanted}")
        if MAIN in self.protocols:
            problems.append(f"protocols: the name '{MAIN}' is the task's own formula; take another")
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def _formula_problems(self) -> list[str]:
        texts = {"formula": self.formula, "rewarded": self.rewarded, "nested": self.nested}
        texts |= {f"protocols.{name}.formula": protocol.formula for name, protocol in self.protocols.items()}
        problems = []
        for where, text in texts.items():
            if text is None:
                continue
            try:
                formula = self.parsed(text)
            except ValueError as error:
                problems.append(f"{where}: {error}")
                continue
            for name in stl.signals(formula):
                if name not in self.signals:
                    problems.append(f"{where}: no signal '{name}'{did_you_mean(name, self.signals)}")
            if stl.horizon(formula) > self.steps:
                problems.append(f"{where}: its horizon of {stl.horizon(formula)} steps exceeds steps = {self.steps}")
        return problems

    def _same_horizon_problems(self) -> list[str]:
        problems = []
        for where, text in (("rewarded", self.rewarded), ("nested", self.nested)):
            if text is None:
                continue
            try:
                ours, other = stl.horizon(self.parsed(self.formula)), stl.horizon(self.parsed(text))
            except ValueError:
                continue
            if ours != other:
                problems.append(f"{where}: its horizon is {other} steps, that of the formula {ours}")
        return problems


def read_task_file(text: str, name: str) -> TaskFile:
    """A task file's text, checked. Raises `UsageError` that lists every error with its place."""
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise UsageError(f"task {name}: task.yaml is no YAML: {error}") from error
    try:
        return TaskFile.model_validate(content)
    except ValidationError as error:
        raise UsageError(f"task {name}: task.yaml has errors:\n{_listed(error, content)}") from error


def _listed(error: ValidationError, content: Any) -> str:
    """Every error on a line: place and message."""
    found = error.errors()
    wrong = {entry["loc"][0] for entry in found if entry["loc"]}
    if wrong and isinstance(content, dict):  # errors between entries are looked for only where the entries are right
        try:
            TaskFile.model_validate({key: value for key, value in content.items() if key not in wrong})
        except ValidationError as other:
            found += [entry for entry in other.errors() if not entry["loc"]]
    lines = []
    for entry in found:
        place = ".".join(str(part) for part in entry["loc"])
        for message in entry["msg"].removeprefix("Value error, ").split("\n"):
            lines.append(f"  {place}: {message}" if place else f"  {message}")
    return "\n".join(lines)
