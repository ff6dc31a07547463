"""The grid and the actions of a plan, checked to fit the memory of a machine."""

from __future__ import annotations

from collections.abc import Mapping

from stlbench.contract import Model, Unsuitable
from stlbench_agents.planning.axes import AxisRecipe, axes_of
from stlbench_agents.planning.grid import Grid
from stlbench_agents.planning.moves import ActionSet

_GIGABYTES = 4.0


def prepare(model: Model, recipes: Mapping[str, AxisRecipe], resolution: float, most: int) -> tuple[Grid, ActionSet]:
    """The grid of the states and the set of actions. Raises `Unsuitable`, as where 4 GB are not enough."""
    grid, actions = Grid(axes_of(model, recipes, resolution)), ActionSet.of(model.actions, most)
    each = len(actions) * grid.size
    dimensions = 4 * (1 + len(grid.axes)), 4 * (1 + len(model.method.specification.signals))
    decisions = model.steps // model.hold
    needed = (each * (dimensions[0] + model.hold * dimensions[1] + 4) + 4 * grid.size * decisions) / 1e9
    refuse_beyond(needed, f"a grid of {grid} points with {len(actions)} actions of {model.hold} samples")
    return grid, actions


def refuse_beyond(gigabytes: float, what: str) -> None:
    """Raises `Unsuitable` where `what` needs more than a plan may have."""
    if gigabytes > _GIGABYTES:
        raise Unsuitable(
            f"{what} needs {gigabytes:.1f} GB, and may have {_GIGABYTES:g}; choose a lower resolution, or fewer actions"
        )
