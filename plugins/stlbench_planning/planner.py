"""The agents that plan: `planner` for the method's reward, `best-possible` for the formula's robustness."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from stlbench.contract import Agent, Model, StatePolicy, Training
from stlbench.contract.compiled import is_ready, note_ready
from stlbench_planning.grid import AxisRecipe

if TYPE_CHECKING:
    from stlbench_planning.grid import ActionSet, Grid

Count = Annotated[int, Field(ge=1)]
_LOOPS = "loops"  # the part of this package that is compiled


@dataclass(frozen=True, kw_only=True)
class _GridPlanner(Agent):
    """Backward induction over time on a grid of the state."""

    grid: Mapping[str, AxisRecipe] = field(default_factory=dict)
    """the axis of each column of the state; of one that is a signal too, its range where left out"""
    resolution: Annotated[float, Field(gt=0)] = 1.0
    """factor on the points of every axis"""
    actions: Count = 25
    """about how many actions are planned with, evenly chosen among the task's"""

    def train(self, training: Training) -> StatePolicy:
        """Solve; no environment is stepped. Raises `Unsuitable` if the task or the method does not fit a grid."""
        if training.model is None:
            raise TypeError("a planner is given a model")
        policy = self._solve(training.model, *self._prepared(training.model))
        training.report(policy, 0)
        return policy

    def check(self, model: Model) -> None:
        self._prepared(model)

    def _prepared(self, model: Model) -> tuple[Grid, ActionSet]:
        from stlbench_planning.grid import prepare  # imports Numba

        return prepare(model, self.grid, self.resolution, self.actions)

    def uncompiled(self) -> Callable[[], None] | None:
        return None if is_ready(__package__, _LOOPS) else self.preload

    def preload(self) -> None:
        from stlbench_planning.loops import compile_all

        compile_all()
        note_ready(__package__, _LOOPS)

    @abstractmethod
    def _solve(self, model: Model, grid: Grid, actions: ActionSet) -> StatePolicy:
        """The policy that this agent is for."""


@dataclass(frozen=True, kw_only=True)
class Planner(_GridPlanner):
    """Exact planning: the policy that the method's reward asks for.

    The greatest discounted sum of rewards by backward induction on a grid, under the rules of the task's training
    episodes: cuts, ends, held actions. It is given what no learner has: dynamics and reward as functions.
    """

    revision = 2
    plans = "reward"
    recipe = MappingProxyType({"gamma": 0.9})

    gamma: Annotated[float, Field(ge=0, le=1)] = 0.95
    """discount of a decision, that is, of `hold` steps"""
    memories: Count = 64
    """the most values of the method's memory that are planned with"""
    rounded: Annotated[int, Field(ge=0)] = 0
    """to how many values a memory of one number is rounded that takes more: fit for a running minimum or maximum, not
    for a count; 0 refuses it"""

    def _solve(self, model: Model, grid: Grid, actions: ActionSet) -> StatePolicy:
        from stlbench_planning import sums
        from stlbench_planning.sums import Limits

        return sums.plan(model, grid, actions, self.gamma, Limits(self.memories, self.rounded))


@dataclass(frozen=True, kw_only=True)
class BestPossible(_GridPlanner):
    """The best that is possible: the policy of the greatest robustness, whatever the method.

    Maximin by backward induction on a grid, with a stage for each F term and a countdown for each F G term.
    """

    revision = 2
    plans = "formula"

    def _solve(self, model: Model, grid: Grid, actions: ActionSet) -> StatePolicy:
        from stlbench_planning import maximin

        return maximin.plan(model, grid, actions)
