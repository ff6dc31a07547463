"""What agents that choose among finitely many actions ask of a task."""

from __future__ import annotations

from stlbench.contract import ActionGrid, Environment, Unsuitable

__all__ = ["grid_of"]


def grid_of(environment: Environment) -> ActionGrid:
    """The task's grid of actions. Raises `Unsuitable` where its actions are continuous."""
    actions = environment.actions
    if not isinstance(actions, ActionGrid):
        raise Unsuitable(
            f"the task's actions {', '.join(actions.names)} are continuous, and this agent chooses from a grid; "
            "give each axis a count, or take an agent such as td3"
        )
    return actions
