"""The contents of a `task.yaml`."""

from __future__ import annotations

import operator
from functools import reduce
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo

from stlbench import stl
from stlbench.records.identity import Line, Name
from stlbench.task.entry import (
    MOST_STARTS,
    Count,
    Entry,
    Finite,
    Formula,
    PointFormula,
    Positive,
    Read,
    Region,
    Starts,
    read_point_formula,
)

VIOLATION: Literal["violation"] = "violation"
"""The condition that a term G[a,b] psi of the formula is violated."""
LOST: Literal["lost"] = "lost"
"""The condition that the environment ended the episode, and that the formula is violated with the last sample held."""


def _read_where(value: Any, info: ValidationInfo) -> stl.Formula | Literal["violation", "lost"]:
    return value if value in (VIOLATION, LOST) else read_point_formula(value, info)


class Ending(Entry):
    """An early end of a training episode, as if the least that the method pays (`floor`) were paid for ever after."""

    where: Annotated[stl.Formula | Literal["violation", "lost"], Read(_read_where)]
    """A formula without temporal operators over the signals, such as of a pole that fell; `VIOLATION`; or `LOST`: the
    environment ended the episode, and with the last sample held the formula is violated."""


class Near(Entry):
    """A condition on the first state of episodes that begin at a time for which it stands."""

    until: Count
    """The last step for which it stands."""
    where: PointFormula
    """A condition on the signals."""


class Exploring(Entry):
    """Training episodes that begin at a random time of the task, a decision's, instead of at its start."""

    share: Annotated[float, Field(gt=0, le=1)]
    """The share of the training episodes."""
    kept: Annotated[float, Field(ge=0, le=1)] = 0.0
    """The share of these that begins in the state in which the copy's last episode ended."""
    states: Region | None = None
    """The places where the others begin; if left out, the states from which episodes start."""
    near: Annotated[tuple[Near, ...], Field(exclude_if=operator.not_)] = ()
    """Half of the drawn states fulfil one: the condition that ends first of those that stand at the time."""
    length: Count | None = None
    """They are broken off after this many decisions on average; at the end of the task where left out."""


class TrainingEpisodes(Entry):
    """How training episodes differ from those that the referee scores, the same for every method and agent."""

    starts: Region | None = None
    """The states where episodes start; `initial` if left out."""
    cuts: tuple[Count, ...] = ()
    """Phase boundaries, steps at which the reward begins to ask for something else. A return stops there, with the
    value of going on as before: an agent that looks across leaves too early (anticipation)."""
    ends: tuple[Ending, ...] = ()
    """The conditions that end episodes early."""
    exploring: Exploring | None = None


class Range(Entry):
    """The range of a signal: the state space over which rho_max and rho_min are taken."""

    low: Finite
    high: Finite
    unit: Line = ""


class Signal(Range):
    """A signal, and on an environment what it is there."""

    expression: str | None = None
    """Over named entries of the observation and entries of the info, in the grammar of formulas: atan2(y, x). If
    left out, the entry of the signal's own name."""


Api = Literal["gymnasium", "pettingzoo"]


class Environment(Entry):
    """An environment of Gymnasium, or a parallel one of PettingZoo, whose agents act jointly."""

    id: str | None = None
    """As `gymnasium.make` takes it: "CartPole-v1", or "module:Id-v0" where a module registers it. For PettingZoo, a
    module with `parallel_env`. None where a class makes the environment."""
    api: Api = "gymnasium"
    kwargs: dict[str, Any] = Field(default_factory=dict)
    """The arguments with which it is made."""
    drawn: dict[str, Any] = Field(default_factory=dict)
    """The further arguments of copies that films show, such as a camera's name. Changes no result."""
    names: tuple[str, ...] | dict[str, tuple[str, ...]] | None = None
    """Names of all entries of the observation, in their order; for a Dict observation {key: names of its entries}."""
    scale: dict[str, Positive] = Field(default_factory=dict)
    """Named entry -> about its largest magnitude, by which policies see it divided. Entries whose space has ends go
    from -1 to 1 without it."""


EarlyEnd = Literal["hold", "violated", "interval"]
"""The meaning of an episode that an environment ends before the last step."""


class Axis(Range):
    """One axis of the actions: `count` evenly spaced values from `low` to `high`, both included, or all between."""

    count: Annotated[int, Field(ge=2)] | None = None
    """Continuous where left out."""

    @property
    def values(self) -> tuple[float, ...]:
        """A counted axis' values, rounded so that -5, -4.5, ... are exactly that."""
        assert self.count is not None
        return tuple(float(value) for value in np.round(np.linspace(self.low, self.high, self.count), 12))


class Protocol(Entry):
    """A further way to score the policy: another formula, other starts, or both. Robustness is averaged over them."""

    title: Line
    formula: Formula | None = None
    """In the unit that `time` names; the task's own formula where left out."""
    initial: Region | None = None
    """The task's own initial states where left out."""
    starts: Starts = 64


class Budget(Entry):
    """How much training, on how many seeds."""

    steps: Count
    """Environment steps of one sampling time, all copies together."""
    seeds: Count = 3
    deadline: Positive = 3600.0
    """Wall seconds after which a cell is stopped."""
    checkpoints: Count = 20
    patience: Annotated[int, Field(ge=0)] | None = None
    """Training may end after so many checkpoints without a better one, at the next that satisfies from all starts that
    are looked at; it lasts for all steps where left out. 0 is at the first that satisfies from all starts for
    selection."""
    seconds: Positive | None = None
    """Training ends at the first checkpoint after so many wall seconds. The result then depends on the machine, so
    leave it out where methods are compared."""
    resumable: bool = False
    """Whether a file is stored from which another training goes on (`run --init`): critics, replay."""
    random_starts: Annotated[int, Field(ge=0, le=MOST_STARTS)] = 1000
    """Random initial states from which the report scores policies, beside the grid that figures show; 0 for none."""


class BestKnown(Entry):
    """The largest mean robustness of the task's formula over the report's starts that anything is known to reach."""

    robustness: Finite
    """The robustness that was reached, in the unit of the formula's predicates."""
    how: Line = ""
    """The way in which it was reached, so that others can repeat it."""
    upper_bound: Finite | None = None
    """More than this is proven to be impossible; None where nothing is proven."""
    why: Line = ""
    """The proof of the bound, in a sentence."""


class Baseline(Entry):
    """The scores of something without a policy from the report's starts."""

    robustness: Finite
    """Mean robustness."""
    satisfied: Annotated[float, Field(ge=0, le=1)]
    """Share of the starts that satisfy the formula."""


class BestConstant(Baseline):
    """The baseline of one action, which is taken all the time."""

    action: Annotated[tuple[Finite, ...], Field(min_length=1)]
    """The action, a number for each axis."""


class Baselines(Entry):
    """The baselines, which need no policy, as `studies/baselines.py` measured them."""

    zero: Baseline
    constant: BestConstant
    random: Baseline


OPTIONAL = ("features", "schedule", "rewarded", "hold", "cuts", "ends", "near", "exploring")
"""The parts without which a task can be trained, to learn their worth."""
BY_HAND = ("rewarded", "nested", "features", "training", "agents")
"""The keys that a `by_hand.yaml` may have in place of the `task.yaml` beside it: help made by somebody for learning."""


class TaskFile(Entry):
    """The content of a `task.yaml`."""

    title: Line
    source: Line
    """The source of the task: paper and section."""
    notes: Line = ""
    """Notes that a reader of the results should know, such as a choice that the source leaves open."""
    formula: Formula
    rewarded: Formula | None = None
    """The formula as reward methods see it, with predicates brought to one scale, capped or stretched:
    satisfied when the formula is. The referee scores `formula`."""
    schedule: Annotated[Formula | None, Field(exclude_if=lambda value: value is None)] = None
    """A conjunction of terms of eq. 2 that implies `formula`. Training follows it; the referee scores `formula`."""
    schedules: Annotated[dict[Name, Formula], Field(exclude_if=operator.not_)] = Field(default_factory=dict)
    """Other schedules, by name. Training follows one on request: my-task[schedule=late]."""
    nested: Formula | None = None
    """The same task as an outer operator over an inner window, for methods that need that form."""
    time: Literal["steps", "seconds"] = "steps"
    """Unit of the formulas' intervals."""
    sampling_time: Positive
    """Seconds a step."""
    steps: Count
    """T, transitions in an episode."""
    hold: Count = 1
    """Steps for which an agent's action is held."""
    environment: Environment | None = None
    """The environment that the task is made on, where it is no system."""
    terminated: EarlyEnd = "hold"
    """The verdict on an episode that an environment ends before the last step.

    `hold`: the last sample stays to the end. `violated`: the formula is violated, by as much as is possible within the
    ranges. `interval`: nothing is known, and the lower end of what is possible counts. In training the episode is over.
    The rest is worth what the method would pay on average while the last sample stays; its floor; or what going on
    would be worth.
    """
    signals: Annotated[dict[Name, Signal], Field(min_length=1)]
    plane: tuple[str, str] | None = None
    """The two signals, across and up, in whose plane figures and films show trajectories."""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """Keyword arguments of the system."""
    actions: dict[Name, Axis] = Field(default_factory=dict)
    """If left out, all that an environment has."""
    robots: dict[Name, Annotated[tuple[str, ...], Field(min_length=1)]] = Field(default_factory=dict)
    """Robot -> its actions, where there is more than one robot; together all actions, in their order."""
    initial: Region | None = None
    """The places of the referee's starts. None on an environment, where they are seeds."""
    features: Literal["engineered", "state", "formula"] = "engineered"
    """The policies' view of a system: `System.features`, or `System.scaled_state`, the state alone, or with the state
    the view of the formula (`view.FormulaView`). An environment shows its observation, for `formula` with the view."""
    training: TrainingEpisodes = TrainingEpisodes()
    best_known: BestKnown | None = None
    """The largest robustness that is known, and its proven bound, to compare policies with."""
    baselines: Baselines | None = None
    """The measured baselines. If left out, they are measured when they are needed."""
    starts: Starts = 64
    """Initial states on the report grid; as many others are kept for the selection of checkpoints."""
    protocols: dict[Name, Protocol] = Field(default_factory=dict)
    agents: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Agent -> recipe, the same for every method. The first is the task's own agent. A task without any recipe is
    trained on the track `auto` unless another track is named."""
    budgets: Annotated[dict[Name, Budget], Field(min_length=1)]

    @property
    def decisions(self) -> int:
        """The number of actions in an episode."""
        return self.steps // self.hold

    @property
    def followed(self) -> stl.Formula:
        """The formula whose windows training follows."""
        return self.formula if self.schedule is None else self.schedule

    @property
    def box(self) -> dict[str, tuple[float, float]]:
        return {name: (signal.low, signal.high) for name, signal in self.signals.items()}

    def without(self, part: str) -> TaskFile:
        """This file without one of OPTIONAL, for an ablation. Raises `ValueError` if it is without it already."""
        if not self.has(part):
            raise ValueError(f"the task is without {part} as it is")
        return self.less(part)

    def has(self, part: str) -> bool:
        """Whether there is something of one of OPTIONAL to leave out. Raises `ValueError` for another part."""
        return self.less(part) != self

    def plain(self) -> TaskFile:
        """This file without all of OPTIONAL that it has, for the track `plain`; where training starts is no part."""
        return reduce(TaskFile.less, OPTIONAL, self)

    def less(self, part: str) -> TaskFile:
        """This file without one of OPTIONAL, which it may be without already. Raises `ValueError` for another part."""
        if part not in OPTIONAL:
            raise ValueError(f"a task is never without '{part}', but perhaps without {', '.join(OPTIONAL)}")
        if part == "near":
            exploring = self.training.exploring
            less = None if exploring is None else exploring.model_copy(update={"near": ()})
            return self._training(exploring=less)
        if part in TrainingEpisodes.model_fields:
            return self._training(**{part: TrainingEpisodes.model_fields[part].default})
        value = "state" if part == "features" else TaskFile.model_fields[part].default
        return self.model_copy(update={part: value})

    def _training(self, **changes: Any) -> TaskFile:
        return self.model_copy(update={"training": self.training.model_copy(update=changes)})

    def scheduled(self, name: str) -> TaskFile:
        """This file with one of its schedules. Raises `ValueError` if it has none of this name."""
        if name not in self.schedules:
            known = f"there are: {', '.join(self.schedules)}" if self.schedules else "its file names none"
            raise ValueError(f"the task has no schedule '{name}'; {known}")
        return self.model_copy(update={"schedule": self.schedules[name]})

    def held(self, steps: int) -> TaskFile:
        """This file with actions held for so many steps. Raises `ValueError` if an episode or a cut is no multiple."""
        for name, whole in (("steps", self.steps), *(("a cut at", cut) for cut in self.training.cuts)):
            if whole % steps:
                raise ValueError(f"{name} {whole} is no multiple of hold = {steps}")
        return self.model_copy(update={"hold": steps})
