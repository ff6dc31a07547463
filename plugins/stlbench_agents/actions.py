"""The kind of actions that an agent needs of a task: a grid to choose from, or a box."""

from __future__ import annotations

from stlbench.contract import ActionBox, ActionGrid, Actions, Unsuitable


def grid_of(actions: Actions) -> ActionGrid:
    """A task's actions, which have to be a grid. Raises `Unsuitable` where its actions are continuous."""
    if not isinstance(actions, ActionGrid):
        raise Unsuitable(
            f"the task's actions {', '.join(actions.names)} are continuous, and this agent chooses from a grid; "
            "give each axis a count, or take an agent such as td3"
        )
    return actions


def box_of(actions: Actions) -> ActionBox:
    """A task's actions, which have to be continuous. Raises `Unsuitable` where it has a grid."""
    if not isinstance(actions, ActionBox):
        raise Unsuitable(
            f"the task's actions {', '.join(actions.names)} are a grid, and this agent's are continuous; "
            "take an agent such as dqn"
        )
    return actions
