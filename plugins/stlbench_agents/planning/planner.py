"""The agents that plan: `planner` for the method's reward, `best-possible` for the formula's robustness."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from stlbench.contract import Model, StatePolicy, Training
from stlbench_agents.planning.grid import AxisRecipe
from stlbench_agents.training import CompiledAgent, Count, Positive, Share, Whole

if TYPE_CHECKING:
    from stlbench_agents.planning.grid import ActionSet, Grid


@dataclass(frozen=True, kw_only=True)
class _GridPlanner(CompiledAgent):
    """Backward induction over time on a grid of the state."""

    compiled_part = "planning"

    grid: Mapping[str, AxisRecipe] = field(default_factory=dict)
    """the axis of each column of the state; of one that is a signal too, its range where left out"""
    resolution: Positive = 1.0
    """factor on the points of every axis"""
    actions: Count = 25
    """about how many actions are planned with, evenly chosen among the task's"""

    def train(self, training: Training) -> StatePolicy:
        """Solve; no environment is stepped. Raises `Unsuitable` where the task or the method does not fit a grid."""
        if training.model is None:
            raise TypeError("a planner is given a model")
        policy = self._solve(training.model, *self._prepared(training.model))
        training.report(policy, 0)
        return policy

    def check(self, model: Model) -> None:
        self._prepared(model)

    def _prepared(self, model: Model) -> tuple[Grid, ActionSet]:
        from stlbench_agents.planning.grid import prepare  # imports Numba

        return prepare(model, self.grid, self.resolution, self.actions)

    def compile(self) -> None:
        from stlbench_agents.planning.loops import compile_all

        compile_all()

    @abstractmethod
    def _solve(self, model: Model, grid: Grid, actions: ActionSet) -> StatePolicy:
        """The policy that this agent is for."""


@dataclass(frozen=True, kw_only=True)
class Planner(_GridPlanner):
    """Exact planning: the policy that the method's reward asks for.

    The greatest discounted sum of rewards by backward induction on a grid, under the rules of the task's training
    episodes: cuts, ends, held actions. It is given what no learner has: dynamics and reward as functions.
    """

    plans = "reward"
    recipe = MappingProxyType({"gamma": 0.9})

    gamma: Share = 0.95
    """discount of a decision, that is, of `hold` steps"""
    memories: Count = 64
    """the most values of the method's memory that are planned with"""
    rounded: Whole = 0
    """to how many values a memory of one number is rounded that takes more: fit for a running minimum or maximum, not
    for a count; 0 refuses it"""

    def _solve(self, model: Model, grid: Grid, actions: ActionSet) -> StatePolicy:
        from stlbench_agents.planning import sums
        from stlbench_agents.planning.sums import Limits

        return sums.plan(model, grid, actions, self.gamma, Limits(self.memories, self.rounded))


@dataclass(frozen=True, kw_only=True)
class BestPossible(_GridPlanner):
    """The best that is possible: the policy of the greatest robustness, whatever the method.

    Maximin by backward induction on a grid, with a stage for each F term and a countdown for each F G term.
    """

    plans = "formula"

    def _solve(self, model: Model, grid: Grid, actions: ActionSet) -> StatePolicy:
        from stlbench_agents.planning import maximin

        return maximin.plan(model, grid, actions)
