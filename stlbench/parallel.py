"""Tasks of several robots through PettingZoo's parallel API, so that any multi-agent library can train on them.

>>> from stlbench.parallel import parallel_env
>>> env = parallel_env("formation", "funnel")

Needs the extra `multi`. A task has several robots where its file names them under `robots`. All see the same
observation, that of `stlbench.gym`, and are paid the same reward: the method is one, on the formula over all robots'
signals. A robot's actions are indices into the grid of its own axes, or vectors where actions are continuous.
"""

from stlbench.simulation.gymnasium.parallel import StlParallelEnv, parallel_env

__all__ = ["StlParallelEnv", "parallel_env"]
