"""The worlds that the simulator drives: of systems, and of environments of Gymnasium."""

from stlbench.rollout.worlds.make import make_world

__all__ = ["make_world"]
