"""Agents: environment in, policy out. Import them from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal, NamedTuple

from stlbench.contract.actions import Actions
from stlbench.contract.arrays import Arrays
from stlbench.contract.environment import Environment
from stlbench.contract.model import Model
from stlbench.contract.policy import Policy, StatePolicy
from stlbench.contract.refusals import Unsuitable


@dataclass(frozen=True)
class Training:
    """All that an agent is given for one cell."""

    make: Callable[[int], Environment]
    """Make the environment with N copies; its initial states depend on the cell's seed and on nothing of the method."""
    steps: int
    """Budget: environment steps of one sampling time, summed over the copies."""
    seed: int
    """For the agent's own randomness; the same for every method of a task."""
    report: Callable[[Policy | StatePolicy, int], None]
    """Call it as report(policy, steps so far) at about `checkpoints` evenly spaced times and at the end. The referee
    scores the policy on starts kept for selection; the time it takes is not counted as training."""
    checkpoints: int = 20
    model: Model | None = None
    """For an agent that plans; None for one that learns."""


class Cost(NamedTuple):
    """What training takes, by counting."""

    replay: int
    """Bytes of the transitions that are kept at the same time."""
    update: float
    """Work of an update, in any unit: of two sizes of observations, the ratio is about that of their times."""


class Agent(ABC):
    """A training algorithm. Its keyword-only parameters are the recipe, which the task file gives; else the defaults.

    A task's recipe is the same for every method: an agent that learns is never told which method it trains. The
    constructor raises `Unsuitable` where it cannot train here at all, as without a library; `train`, where a task's
    actions do not fit.
    """

    plans: ClassVar[Literal["reward", "formula"] | None] = None
    """What it makes the most of where it plans: the method's reward, or the formula's robustness, whatever the method.
    It is then given dynamics and reward themselves, as `Training.model`, in place of environments to learn from. What
    it finds shows what a reward asks for, or what is possible; it is no rival of learned policies."""
    trains: ClassVar[bool] = True
    """Whether it learns by steps of environments. False of one whose policy is there without, as a controller by hand;
    one that plans need not say it. Of one that trains and has taken no step, no policy is scored: the cell is
    `raised`."""
    search_space: ClassVar[Mapping[str, tuple[float | int | str | bool, ...]]] = MappingProxyType({})
    """What `stlbench tune` tries, the same for every method: parameter -> values. `hold` stands for the steps for which
    the task holds an action; of its values those count that fit the task. The value of the task's own recipe is tried
    as well. A method that is first paid late needs a discount near 1, and one that is paid at once a smaller one: leave
    such parameters out, and the comparison is one of methods with the recipe of one of them."""

    @abstractmethod
    def train(self, training: Training) -> Policy | StatePolicy:
        """Spend the budget and return the final policy. The same `training.seed` gives the same policy, bit for bit."""

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        """The policy that gave these `Policy.arrays`, for a task with these actions. It acts the same, bit for bit.

        A method of the class: a policy can be used where, for want of a library, the agent cannot train. Raises
        `Unsuitable` for arrays that are of none of its policies or of other actions, by default for all.
        """
        raise Unsuitable("it does not say how its policies are restored")

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost | None:
        """What training would take; None, as by default, where the agent cannot say, and is then never refused.

        Args:
            size: D, numbers in an observation.
            actions: of the task.
            decisions: of all copies together, in the whole budget.
        """
        return None

    def uncompiled(self) -> Callable[[], None] | None:
        """What compiles the agent's code, where it is compiled and this machine has not done so yet; None elsewhere.

        The harness calls it before the first cell, and says that it does. Without it, what is compiled at first use
        takes its time in every cell, unless it is kept on disk.
        """
        return None

    def preload(self) -> None:  # noqa: B027 - most have nothing to load
        """Import the libraries that training needs, and load compiled code, for many cells at once.

        It is called in the process from which those of cells are forked, so it starts no threads and changes nothing
        that another agent could see. Of other distributions than stlbench's it is not called: what their import changes
        stays in their own cells.
        """
