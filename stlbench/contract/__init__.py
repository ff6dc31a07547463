"""The contract: what a plugin author reads. A plugin imports nothing else of stlbench but `stlbench.stl`, and
`stlbench.contract.presentation` if it has something to show. Each part is a file of its own in `stlbench/contract`, and
is imported from here.

Five kinds of plugin, each found by its entry-point group and named by its entry point:

- `stlbench.methods`, a `RewardMethod` subclass: the reward of a transition, and its own memory;
- `stlbench.tasks`, a `System` subclass: dynamics, beside a `task.yaml` in its package; or a `GymTask` or
  `WorldTask` subclass, where starts are seeds;
- `stlbench.agents`, an `Agent` subclass: training, environment in, policy out;
- `stlbench.executors`, an `Executor` subclass: cells run in processes, here or on a cluster;
- `stlbench.logs`, a `RunLog` subclass: how a run goes on, for tools that show it.

Conventions, everywhere: arrays are NumPy float64 and batched, rows first. `N` is the number of copies that run in
lock-step, `n` the state's size, `k` the number of signals, `m` the memory's size, `D` the observation's. Time is a
step count: a trace of an episode has samples 0..T, transition t leads from sample t to sample t + 1, so t is 0 at
the first transition and T - 1 at the last. One step lasts the task's sampling time, in seconds.

Parameters of a plugin are the keyword-only arguments of its constructor, with annotations and defaults, such as those
of a `dataclass(frozen=True, kw_only=True)`. The harness checks what a user writes (`funnel[variant=code,ginf=0.02]`)
against the annotations, so `Literal[...]`, `float`, `int`, `bool` and `str` give clear messages without any code.
"""

from __future__ import annotations

from stlbench.contract import origin
from stlbench.contract.actions import ActionBox, ActionGrid, Actions
from stlbench.contract.agent import Agent, Cost, Training
from stlbench.contract.arrays import Array, Arrays, Integers, Truth
from stlbench.contract.environment import CounterfactualEnvironment, Environment, Event, Transition
from stlbench.contract.environment_tasks import GymTask, WorldTask
from stlbench.contract.executor import Executor, Outcome, Work
from stlbench.contract.log import LoggedCell, LoggedCheckpoint, RunLog
from stlbench.contract.method import RewardMethod
from stlbench.contract.model import End, Model
from stlbench.contract.policy import Policy, StatePolicy
from stlbench.contract.refusals import Intractable, Unsuitable
from stlbench.contract.specification import Specification
from stlbench.contract.system import System
from stlbench.contract.world import World
from stlbench.errors import cause

__all__ = [
    "ActionBox",
    "ActionGrid",
    "Actions",
    "Agent",
    "Array",
    "Arrays",
    "Cost",
    "CounterfactualEnvironment",
    "End",
    "Environment",
    "Event",
    "Executor",
    "GymTask",
    "Integers",
    "Intractable",
    "LoggedCell",
    "LoggedCheckpoint",
    "Model",
    "Outcome",
    "Policy",
    "RewardMethod",
    "RunLog",
    "Specification",
    "StatePolicy",
    "System",
    "Training",
    "Transition",
    "Truth",
    "Unsuitable",
    "Work",
    "World",
    "WorldTask",
    "cause",
]

if _problem := origin.foreign():
    raise ImportError(_problem)
