"""Every task with every reward method as a Gymnasium environment, so that any RL library can train on it.

>>> import gymnasium
>>> import stlbench.gym  # registers stlbench/<task>-v0 for every task that is installed
>>> env = gymnasium.make("stlbench/reach-stay-v0", method="funnel[variant=code]")
>>> envs = gymnasium.make_vec("stlbench/reach-stay-v0", num_envs=8, method="funnel")

Gymnasium 1.x looks for no plugins by itself. Without the second import, the module goes into the name:
`gymnasium.make("stlbench.gym:stlbench/reach-stay-v0", method="funnel")`.

Actions are indices into the task's grid, or vectors where a task's actions are continuous. Observations are what every
agent of stlbench sees, as float32, unbounded though about in [-1, 1]. An episode has a fixed length and is truncated at
its end, never terminated: no state of a task is terminal, and a learner may bootstrap there. An environment
of Gymnasium that ends an episode by itself stands still from then on. It is paid as the task's `terminated` says:
`hold` what the method pays for the last sample, `violated` the method's least at every step, `interval` nothing. Of
what a task file says under `training`, only where episodes start is done here; the rest is for the agents of stlbench.

`info["signals"]` has the samples of the trace that a step added, and `info["t"]` the time in steps. All of an
episode's samples, in order, are a trace that `stlbench.stl` can score with `env.unwrapped.task.formula`.
"""

import gymnasium

from stlbench.registry import plugins
from stlbench.simulation.gymnasium.env import StlEnv, StlVectorEnv

__all__ = ["StlEnv", "StlVectorEnv", "register_all"]


def register_all() -> None:
    """Make `stlbench/<task>-v0` known to Gymnasium for every installed task. None of them is imported."""
    for name in plugins.available("tasks"):
        identifier = f"stlbench/{name}-v0"
        if identifier not in gymnasium.registry:
            gymnasium.register(
                identifier,
                entry_point=f"{__name__}:StlEnv",
                vector_entry_point=f"{__name__}:StlVectorEnv",
                kwargs={"task": name},
            )


register_all()
