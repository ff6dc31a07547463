"""Builds the method or agent that a user chose, for a task; and finds methods that pay for the same."""

import math
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import cast

import numpy as np

from stlbench.contract import Agent, Array, Intractable, RewardMethod, Specification, Unsuitable
from stlbench.contract.method import Aim
from stlbench.errors import UsageError, cause
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, choice_of
from stlbench.stl import Formula
from stlbench.task.forms import recurring
from stlbench.task.task import Task


def build_method(task: Task | Specification, choice: Choice | str) -> RewardMethod:
    """The chosen method, with its parameters, for a task, or for a specification alone.

    Raises `Intractable`, `Unsuitable`, `UsageError`, and `ValueError` if `scale`, `floor` or a size is out of range:
    `scale` is positive and finite, `floor` is finite, and sizes are at least 0.
    """
    given = task if isinstance(task, Specification) else task.specification
    method = _built(given, None if isinstance(task, Specification) else task.otherwise, choice_of(choice))
    if not (math.isfinite(method.scale) and method.scale > 0):
        raise ValueError(f"method {choice}: its scale should be finite and more than 0, it is {method.scale}")
    if not math.isfinite(method.floor):
        raise ValueError(f"method {choice}: its floor should be finite, it is {method.floor}")
    for name, size in (("memory_size", method.memory_size), ("input_size", method.input_size)):
        if size < 0:
            raise ValueError(f"method {choice}: its {name} should be at least 0, it is {size}")
    return method


def _built(given: Specification, otherwise: Formula | None, choice: Choice) -> RewardMethod:
    """The method for a specification, or for another form of its formula if it does not take this one."""
    try:
        return cast(RewardMethod, plugins.build("methods", choice, given))
    except Unsuitable:
        if otherwise is None:
            raise
    return cast(RewardMethod, plugins.build("methods", choice, replace(given, formula=otherwise, nested=None)))


def as_given(task: Task, choice: Choice) -> Task:
    """The task without the other form of its formula, if the method takes the formula itself."""
    if task.otherwise is not None:
        with suppress(Exception):  # what is wrong is told when the method is built
            plugins.build("methods", choice, task.specification)
            return replace(task, otherwise=None)
    return task


def fitting_methods(
    task: Task | Specification, choices: Iterable[Choice | str] | None = None
) -> dict[str, RewardMethod]:
    """The methods that can be built, of those chosen or else of all installed, by the text of the choice.

    A method that raises another error than the contract names is left out with a `PluginWarning`.
    """
    methods = dict[str, RewardMethod]()
    name = task.formula if isinstance(task, Specification) else f"task {task.name}"
    for choice in plugins.available("methods") if choices is None else choices:
        try:
            methods[str(choice)] = build_method(task, choice)
        except (Intractable, Unsuitable, UsageError):
            continue
        except Exception as error:
            message = f"method {choice} cannot be built for {name}: {cause(error)}"
            warnings.warn(message, plugins.PluginWarning, stacklevel=2)
    return methods


def aim_of(formula: Formula) -> Aim:
    return "other" if next(recurring(formula), None) is None else "recurring"


def in_turn(fitting: Mapping[str, RewardMethod], aim: Aim) -> tuple[str, ...]:
    """The names of methods that fit a formula, in the order in which to try them.

    Methods with a place for the aim come first (`RewardMethod.preference`). Then come methods inside their source's
    form, and those with fewer inputs.
    """

    def order(name: str) -> tuple[float, bool, int, str]:
        method = fitting[name]
        place = plugins.place(type(method), aim)
        return math.inf if place is None else place, method.extension != "", method.input_size, name

    return tuple(sorted(fitting, key=order))


INIT = "init"
"""A parameter of the choice of an agent, and not of its constructor: the hash of the policy that it starts from."""


def build_agent(task: Task, choice: Choice | str) -> Agent:
    """The chosen agent with the task's recipe, or its defaults; the parameters of the choice override both.

    Raises `UsageError`, and `Unsuitable` if the agent cannot train on this machine.
    """
    choice = choice_of(choice).without(INIT)
    return cast(Agent, plugins.build("agents", choice, defaults=task.recipe(choice.name)))


_SAMPLES = 256
_EXACT = 1e-9
"""Differences within this share of the larger scale of two methods count as equal: sums round in another order."""


@dataclass(frozen=True)
class Difference:
    """The rewards of two methods, of which one is the other plus a function of time."""

    one: str
    other: str
    constant: float | None
    """The surplus of the one's pay over the other's, if it is the same at all times; None if it changes."""

    def __str__(self) -> str:
        """ "funnel is raw minus 0.99 at all times"."""
        if self.constant is None:
            return f"{self.one} is {self.other} plus a function of time alone"
        if self.constant == 0:
            return f"{self.one} is {self.other}"
        sign = "plus" if self.constant > 0 else "minus"
        return f"{self.one} is {self.other} {sign} {abs(self.constant):.6g} at all times"


@dataclass(frozen=True)
class Paid:
    """The pay of a method."""

    rewards: Array
    """(T, samples): at all times, at random samples that are the same for all methods of a task."""
    scale: float
    """`RewardMethod.scale`."""


def payments(method: RewardMethod) -> Paid | None:
    """The method's pay; None if it is no function of samples and time alone (`RewardMethod.arrival`).

    Raises `ValueError` if rewards are no numbers, or have another shape than (T, samples).
    """
    if not method.paid_on_arrival:
        return None
    rewards, expected = np.asarray(_rewards(method)), (method.specification.steps, _SAMPLES)
    if rewards.shape != expected or rewards.dtype.kind not in "fiu":
        raise ValueError(
            f"its rewards should be numbers of shape {expected}, got {rewards.dtype} of shape {rewards.shape}"
        )
    return Paid(rewards, method.scale)


def equal_payments(paid: Mapping[str, Paid | None]) -> tuple[Difference, ...]:
    """Pairs of methods of one task, by name, whose rewards are the same but for a function of time.

    Such methods ask for the same policies if every episode is as long: the sum of a function of time is the same for
    all. If training episodes end early, it also pays for an earlier or a later end. Samples are drawn evenly from the
    box of the signals, so a difference in a very small part of it can be missed.
    """
    known = {name: each for name, each in paid.items() if each is not None}
    differences = (_difference(known[one], known[other], (one, other)) for one, other in combinations(known, 2))
    return tuple(difference for difference in differences if difference is not None)


def _difference(one: Paid, other: Paid, names: tuple[str, str]) -> Difference | None:
    exact = _EXACT * max(one.scale, other.scale)
    with np.errstate(invalid="ignore"):  # infinite rewards have a difference without value: they count as different
        difference = one.rewards - other.rewards
    if not (np.ptp(difference, axis=1) <= exact).all():
        return None
    if np.ptp(difference) > exact:
        return Difference(*names, None)
    constant = float(difference.mean())
    return Difference(*names, 0.0 if abs(constant) <= exact else constant)


def _rewards(method: RewardMethod) -> Array:
    specification, generator = method.specification, np.random.default_rng(0)
    points = generator.uniform(specification.low, specification.high, (_SAMPLES, len(specification.signals)))
    t = np.arange(1, specification.steps + 1)
    shape = len(t), _SAMPLES
    return method.arrival(np.broadcast_to(points, (*shape, points.shape[1])), np.broadcast_to(t[:, None], shape))
