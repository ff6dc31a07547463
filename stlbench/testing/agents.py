"""The rules of an agent, on small tasks that it trains on for a moment: a point on a line, or two robots."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import get_args

import numpy as np

from stlbench import contract
from stlbench.contract.agent import ActionKind
from stlbench.errors import UsageError, cause
from stlbench.registry import choices
from stlbench.registry.choices import Choice
from stlbench.simulation.environment import BatchEnvironment, model_of
from stlbench.simulation.referee import record
from stlbench.task.reading import read_task_file
from stlbench.task.task import Task
from stlbench.testing.rules import RuleBroken, Rules, made

_TEXT = """
title: Go to the middle and stay there
source: made for checks of agents
formula: G[5,10] ({distance} <= 0.2)
sampling_time: 0.1
steps: 10
signals: {signals}
actions: {actions}
robots: {robots}
initial: {{box: {box}}}
starts: 8
agents: {{check: {{}}}}
budgets: {{check: {{steps: {steps}, checkpoints: 3}}}}
"""
_STEPS = 2000


@dataclass(frozen=True)
class Form:
    """The points and actions of a task."""

    text: str  # for messages
    points: tuple[str, ...] = ("x",)
    count: int | None = None  # values of each action; None if it is continuous
    robots: bool = False  # whether each point is a robot of its own


FORMS = (
    Form("one of 5 actions", count=5),
    Form("continuous actions"),
    Form("two robots with 3 actions each", ("x", "y"), 3, robots=True),
)
"""An agent has to train on one of these; it may refuse the others."""


class _Line(contract.System):
    """x' = x + dt v, for each point."""

    def __init__(self, dt: float, points: tuple[str, ...]) -> None:
        super().__init__(dt)
        self.state = points  # type: ignore[misc]  # a class of its own for each number of points would say no more

    def step(self, state: contract.Array, action: contract.Array) -> contract.Array:
        return state + self.dt * action

    def signals(self, state: contract.Array) -> contract.Array:
        return state

    def features(self, state: contract.Array, t: contract.Integers) -> contract.Array:
        return state / 2


class Nearness(contract.RewardMethod):
    """How near the middle the points are, in [-1, 0]."""

    def __init__(self, specification: contract.Specification) -> None:
        super().__init__(specification)

    def arrival(self, signals: contract.Array, t: contract.Integers) -> contract.Array:
        """Minus the mean distance, over 2."""
        nearness: contract.Array = -np.abs(signals).mean(axis=-1) / 2
        return np.clip(nearness, -1, 0)


def line_task(form: Form) -> Task:
    """The task: 10 steps of 0.1 s, starts in [-1, 1], speeds in [-2, 2]."""
    axes = {name: f"v{name}" for name in form.points}
    count = f", count: {form.count}" if form.count else ""
    text = _TEXT.format(
        distance=f"norm({', '.join(form.points)})" if len(form.points) > 1 else f"abs({form.points[0]})",
        signals=_flow({name: "{low: -2, high: 2}" for name in form.points}),
        actions=_flow({axis: f"{{low: -2, high: 2{count}}}" for axis in axes.values()}),
        robots=_flow({name: f"[{axis}]" for name, axis in axes.items()} if form.robots else {}),
        box=_flow({name: "[-1, 1]" for name in form.points}),
        steps=_STEPS,
    )
    return Task(Choice("line"), read_task_file(text, "line"), _Line(0.1, form.points))


def _flow(entries: dict[str, str]) -> str:
    return f"{{{', '.join(f'{name}: {value}' for name, value in entries.items())}}}"


_HOLD = "hold"  # a parameter of the task that a search space may have


def check_agent(agent: type[contract.Agent] | str, rules: Rules | None = None) -> None:
    """Check an agent by short trainings on a point on a line: with a grid of actions, continuous ones, two robots.

    The rules: parameters are keyword-only, with annotations; `search_space` and `recipe` have parameters and values
    that fit them; `preference` has places for kinds of actions; `cost` grows with observations and decisions; training
    takes no more than its budget, and some of it unless the agent says that it does not train (`trains`), and reports
    policies that later training does not change; the same seed gives the same policies, bit for bit; a policy's actions
    are the task's, pure, and those of a batch are its rows' one by one; a policy that can be kept acts the same when it
    is restored. An agent may refuse some of the tasks.

    Args:
        agent: a class, made with its default parameters, or the name of an installed agent with parameters.
        rules: takes those that are kept, for a caller that lists them.

    Raises:
        AssertionError: the rule that is broken.
        Unsuitable: the agent cannot train on any of the tasks, or on this machine; no rule is broken.
        UsageError: no such agent, or a wrong parameter; the message says what there is.
    """
    rules, made_agent = rules or Rules(), made("agents", agent)
    rules.parameters(type(made_agent), 0)
    _check_search_space(made_agent, rules)
    _check_recipe(made_agent, rules)
    rules.places(made_agent.preference, get_args(ActionKind))
    compile_it = made_agent.uncompiled()
    rules.keep(compile_it is None or callable(compile_it), "uncompiled is None or can be called", compile_it)
    if compile_it is not None:
        compile_it()
    refusals = [refusal for form in FORMS if (refusal := _refusal(made_agent, form, rules)) is not None]
    if len(refusals) == len(FORMS):
        raise refusals[0]


def _refusal(agent: contract.Agent, form: Form, rules: Rules) -> contract.Unsuitable | None:
    rule = f"with {form.text}, it trains or raises Unsuitable"
    try:
        _check_training(agent, line_task(form), rules)
    except contract.Unsuitable as refusal:
        return refusal
    except RuleBroken:
        raise
    except (Exception, SystemExit) as error:
        raise RuleBroken(f"rule broken: {rule}; got {cause(error)}") from error
    rules.keep(True, rule, None)
    return None


def _check_search_space(agent: contract.Agent, rules: Rules) -> None:
    known = choices.declared(type(agent))
    for name, values in agent.search_space.items():
        rules.keep(name == _HOLD or name in known, "search_space names parameters of the agent, and hold", name)
        rules.keep(len(values) > 0, "search_space has values for each parameter", f"none for {name}")
        for value in () if name == _HOLD else values:
            rules.keep(
                _fits(known, name, {name: value}), "values of search_space are of their type", f"{name} = {value!r}"
            )


def _check_recipe(agent: contract.Agent, rules: Rules) -> None:
    known = choices.declared(type(agent))
    rule = "recipe has parameters of the agent, with values of their types"
    for name, value in agent.recipe.items():
        rules.keep(name in known and _fits(known, name, {name: value}), rule, f"{name} = {value!r}")
    for name, value in agent.second_recipe.items():  # a part of the name of the agent in a race
        fits = name in known and _fits(known, name, {}, ((name, str(value)),))
        rules.keep(fits, f"second_{rule}", f"{name} = {value!r}")


def _fits(
    known: dict[str, choices.Parameter], name: str, recipe: dict[str, object], chosen: tuple[tuple[str, str], ...] = ()
) -> bool:
    try:
        choices.check({name: known[name]}, Choice("agent", chosen), recipe)
    except UsageError:
        return False
    return True


# ---------------------------------------------------------------------------------------------------------- training


@dataclass
class _Trained:
    final: contract.Policy | contract.StatePolicy
    taken: int
    reported: list[tuple[contract.Policy | contract.StatePolicy, int, bytes]] = field(default_factory=list)
    """Policy, steps so far, and the policy's traces at that moment."""


def _train(
    agent: contract.Agent, task: Task, behave: Callable[[contract.Policy | contract.StatePolicy], bytes]
) -> _Trained:
    method, budget = Nearness(task.specification), task.budget("check")
    made, reported = list[BatchEnvironment](), list[tuple[contract.Policy | contract.StatePolicy, int, bytes]]()

    def make(count: int) -> BatchEnvironment:
        made.append(BatchEnvironment(task, method, count, 1))
        return made[-1]

    model = None if agent.plans is None else model_of(task, method)
    training = contract.Training(
        make, budget.steps, 2, lambda policy, steps: reported.append((policy, steps, behave(policy))), 3, model
    )
    final = agent.train(training)
    return _Trained(final, sum(environment.taken for environment in made), reported)


def _check_training(agent: contract.Agent, task: Task, rules: Rules) -> None:
    method, states = Nearness(task.specification), task.starts.report_and_selection()[0]

    def behave(policy: contract.Policy | contract.StatePolicy) -> bytes:
        if isinstance(policy, contract.Policy):
            _check_actions(policy, task, rules)
        return record(task, method, policy, states).traces.tobytes()

    _check_cost(agent, task.actions, rules)
    once, again = _train(agent, task, behave), _train(agent, task, behave)
    steps, budget = [at for _, at, _ in once.reported], task.budget("check").steps
    rules.keep(once.taken <= budget, f"training takes at most its budget, {budget} environment steps", once.taken)
    rules.keep(len(steps) > 0, "training reports a policy", "none")
    rules.keep(len(steps) <= 8, "policies are reported about `checkpoints` times, here 3", len(steps))
    ordered = steps == sorted(steps) and steps[0] >= 0 and steps[-1] <= budget
    rules.keep(ordered, "reports count the environment steps so far", steps)
    changed = [at for policy, at, traces in once.reported if behave(policy) != traces]
    rules.keep(not changed, "a policy that was reported does not change", f"one of step {changed[:1]} that did")
    same = [traces for *_, traces in once.reported] == [traces for *_, traces in again.reported]
    rules.keep(same, "the same seed gives the same reported policies, bit for bit", "others")
    rules.keep(behave(once.final) == behave(again.final), "the same seed gives the same final policy", "another")
    idle = once.taken == 0 and agent.trains and agent.plans is None
    rules.keep(not idle, "an agent takes environment steps, plans, or says trains = False", "no step")
    _check_restored(agent, once.final, task.actions, behave, rules)


def _check_restored(
    agent: contract.Agent,
    policy: contract.Policy | contract.StatePolicy,
    actions: contract.Actions,
    behave: Callable[[contract.Policy | contract.StatePolicy], bytes],
    rules: Rules,
) -> None:
    arrays = policy.arrays() if isinstance(policy, contract.Policy) else None
    if arrays is None:
        return
    copies = {name: np.array(array) for name, array in arrays.items()}
    objects = [name for name, array in copies.items() if array.dtype.hasobject]
    rules.keep(not objects, "arrays of a policy are numbers or texts", f"objects in {objects}")
    same = behave(type(agent).restore(copies, actions)) == behave(policy)
    rules.keep(same, "a policy that is restored from its arrays acts the same, bit for bit", "otherwise")


def _check_cost(agent: contract.Agent, actions: contract.Actions, rules: Rules) -> None:
    costs = [agent.cost(size, actions, decisions) for size, decisions in ((10, 1000), (20, 1000), (20, 2000))]
    rules.keep(len({cost is None for cost in costs}) == 1, "cost is None for all sizes or for none", costs)
    known = [cost for cost in costs if cost is not None]
    positive = all(cost.replay >= 0 and cost.update > 0 for cost in known)
    rules.keep(positive, "cost has bytes of the replay, at least 0, and work of an update, above 0", known)
    grows = all(a.replay <= b.replay and a.update <= b.update for a, b in pairwise(known))
    rules.keep(grows, "cost does not fall where observations or decisions are more", known)


def _check_actions(policy: contract.Policy, task: Task, rules: Rules) -> None:
    environment = BatchEnvironment(task, Nearness(task.specification), 6, 3)
    observation = environment.reset()
    for _ in range(3):
        observation = environment.step(_some(task.actions)).observation

    def act(observation: contract.Array) -> contract.Array:
        return np.asarray(policy.act(observation))

    shape = (6,) if isinstance(task.actions, contract.ActionGrid) else (6, len(task.actions.names))
    action = rules.function("act", act, (observation,), shape)
    if isinstance(task.actions, contract.ActionGrid):
        valid = action.dtype.kind in "iu" and bool(np.all((action >= 0) & (action < task.actions.size)))
        rules.keep(valid, f"actions are whole numbers in 0..{task.actions.size - 1}", action)


def _some(actions: contract.Actions) -> contract.Integers | contract.Array:
    if isinstance(actions, contract.ActionBox):
        return np.tile(np.array(actions.high), (6, 1))
    return np.arange(6) % actions.size
