'''The contract: what a plugin imports of stlbench, beside `stlbench.stl`.

A complete reward method, the robustness of the terms that are active:

    import numpy as np
    from stlbench.contract import Array, Integers, RewardMethod, Specification

    class Raw(RewardMethod):
        """The least margin of the terms whose interval includes t; 0 where there is none."""

        def __init__(self, specification: Specification) -> None:
            super().__init__(specification)
            self._terms = [(term.start, term.end, specification.margin(term.psi)) for term in specification.terms]
            self.scale = max(abs(end) for term in specification.terms for end in specification.range(term.psi))

        def arrival(self, signals: Array, t: Integers) -> Array:
            least = np.full(t.shape, np.inf)
            for start, end, margin in self._terms:
                least = np.where((start <= t) & (t <= end), np.minimum(least, margin(signals)), least)
            return np.where(np.isfinite(least), least, 0.0)

Its distribution names it in `pyproject.toml`: `[project.entry-points."stlbench.methods"]`, `my-raw = "my_package:Raw"`.
`stlbench new method NAME` writes such a distribution, and `stlbench check NAME` checks the rules.

**Required.** There are six kinds of plugins. Each has an entry-point group, a base class, and methods to write:

| group | base class | write |
|---|---|---|
| `stlbench.methods` | `RewardMethod` | `arrival`, where the reward depends on the sample and the time; else `along` |
| `stlbench.tasks` | `System` | `step`, `signals`; `task.yaml` in the same package says the rest |
| `stlbench.agents` | `Agent` | `train`: steps an `Environment`, returns a `Policy` with `act` |
| `stlbench.executors` | `Executor` | `run`: calls a function on items in processes of their own |
| `stlbench.logs` | `RunLog` | `ended`: takes the result of a cell |
| `stlbench.suites` | `Suite` | `names`, `splits`, `task`: makes tasks from their names |

Arrays are NumPy float64 and batched, rows first. `N` is the number of copies in lock-step, and `k` that of signals. The
state has the size `n`, the memory `m`, the observation `D`. Time is a step count: a trace has samples 0..T, and
transition t leads from sample t to sample t + 1. One step lasts the task's sampling time.

The parameters of a plugin are keyword-only arguments of its constructor with annotations and defaults, for example of a
`dataclass(frozen=True, kw_only=True)`. The harness checks what a user writes, as in `funnel[ginf=0.02]`, by the
annotations. A plugin that cannot be applied raises `Unsuitable` with one line.

**Additions.** Leave them out unless you need them:

| addition | who needs it |
|---|---|
| `RewardMethod.memory_size`, `initial_memory`, `inputs`, `input_size` | rewards of the past, as of flag |
| `RewardMethod.scale`, `floor` | rewards whose size is far from 1 |
| `RewardMethod.can_end`, `over` | methods that know when nothing more is paid: counters, hprs, machine |
| `RewardMethod.counterfactuals`, `counterfactual` | methods that pay for other memories: cfer, counters, machine |
| `CounterfactualEnvironment` | agents that learn from other memories: dqn |
| `RewardMethod.extension` | methods that go beyond the form of their publication |
| `System.initial_states`, `features`, `controller` | other coordinates, more to see than the state, reference scores |
| `System.scaled_state` | states that are far from 1 |
| `GymTask`, `WorldTask`, `World` | environments of Gymnasium, simulations in C++ or on a GPU |
| `RewardMethod.preference`, `Agent.preference` | those to take where none is named |
| `Agent.recipe`, `second_recipe` | the track `auto`; the race of `solve` |
| `Agent.search_space`, `cost` | agents for `stlbench tune`, agents to which inputs are dear |
| `Agent.restore`, `Policy.arrays`, `Policy.onnx` | policies that are stored and exported |
| `Agent.uncompiled`, `preload` | agents that compile code or load large libraries |
| `Agent.plans`, `Model`, `End`, `StatePolicy` | agents that plan |
| `Agent.discounts`, `Environment.reset(alike)` | agents that search for the greatest return from common starts |
| `Agent.trains` | agents without training, such as a controller |
| `Agent.resumes`, `Training.initial` | agents that start from an earlier policy |
| `Training.keep`, `earlier` | agents that go on with an earlier training |
| `Work.prepare`, `log`, `facts` | executors that fork, store output, or use other machines |
| `cached` | plugins with functions that Numba compiles |
| `stlbench.contract.presentation` | plugins with something to show in tables, figures and films |
'''

from stlbench.contract.agent import (
    ActionBox,
    ActionGrid,
    Actions,
    Agent,
    Cost,
    CounterfactualEnvironment,
    End,
    Environment,
    Event,
    Model,
    Policy,
    StatePolicy,
    Training,
    Transition,
)
from stlbench.contract.arrays import Array, Arrays, Integers, Truth
from stlbench.contract.compiled import cached
from stlbench.contract.method import Intractable, RewardMethod, Specification, Unsuitable
from stlbench.contract.run import Executor, LoggedCell, LoggedCheckpoint, Outcome, RunLog, Work
from stlbench.contract.task import GymTask, Suite, SuiteScores, SuiteTask, System, World, WorldTask
from stlbench.errors import cause, foreign

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
    "Suite",
    "SuiteScores",
    "SuiteTask",
    "System",
    "Training",
    "Transition",
    "Truth",
    "Unsuitable",
    "Work",
    "World",
    "WorldTask",
    "cached",
    "cause",
]

if _problem := foreign():
    raise ImportError(_problem)
