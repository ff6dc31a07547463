"""The rules of a task: what moves in it under random actions and under its controller, its formula, its recipes."""

from __future__ import annotations

import numpy as np

from stlbench import stl
from stlbench.contract import Array, System, Training, Unsuitable
from stlbench.errors import UsageError, one_line
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.rollout import baselines, controller, referee
from stlbench.rollout.auto import for_every_method
from stlbench.rollout.controller import Unpaid
from stlbench.rollout.environment import BatchEnvironment
from stlbench.rollout.rehearsal import rehearse
from stlbench.task import Task, build_agent, load_task
from stlbench.testing import systems, worlds
from stlbench.testing.rules import Rules

_ALIKE = 0.05  # of two shares of starts that satisfy: contacts differ between machines in their last bits, and grow


def check_task(name: str, rules: Rules | None = None) -> None:
    """Check a task: what moves in it under random actions and under its controller, its formula, its recipes.

    The rules of a system: `initial_states`, `step`, `signals`, `features`, `scaled_state` and `controller` give finite
    values of the contract's shapes, are pure and leave their arguments alone, and a batch is its rows one by one. Those
    of an environment or a world: the same seed and actions give the same episode, in any copy, and whatever it did
    before; a copy that has ended stands still.

    Both: samples and features are finite; the first samples lie in the signals' ranges, and features of what is in
    there within [-5, 5]; the nested form has the formula's robustness, and the rewarded one is satisfied when the
    formula is; the controller, where there is one, satisfies the formula from some of the report's starts; constant
    actions get what the file states that they get; recipes are for agents that are installed, and fit them; the task's
    own agent, the first that it has a recipe for, can train on it for a moment. Warnings say that a constant action
    solves the task, and that the agent was not tried, where it lacks a library on this machine.

    Args:
        name: of an installed task, or the path of a folder.
        rules: takes those that are kept, for a caller that lists them.

    Raises:
        AssertionError: the rule that is broken.
        UsageError: no such task, a task file with errors, or recipes that their agents do not understand, all of them.
    """
    task, rules = load_task(name), rules or Rules()
    _check_recipes(task)
    rules.keep(True, "each recipe fits its agent", None)
    if isinstance(task.dynamics, System):
        _check_forms(task, systems.random_traces(task, rules), rules)
        systems.check_controller(task, rules)
    else:
        _check_forms(task, worlds.random_traces(task, rules), rules)
    _check_controller(task, rules)
    _check_baselines(task, rules)
    _check_agent(task, rules)


def _check_recipes(task: Task) -> None:
    problems = list[str]()
    for agent, recipe in task.file.agents.items():
        try:
            plugins.check("agents", Choice(agent), recipe)
        except UsageError as error:
            problems.append(f"agents.{agent}: {str(error).removeprefix(f'{agent}: ')}")
    if problems:
        raise UsageError("\n".join([f"task {task.name}: recipes have errors:", *(f"  {line}" for line in problems)]))


def _check_agent(task: Task, rules: Rules) -> None:
    """Let the task's own agent train for a moment, on the task's own track and without a reward."""
    task = for_every_method(task, task.own_agent, task.own_track)
    rule = f"the task's own agent, {task.own_agent}, can act and train on it"
    try:
        agent = build_agent(task, task.own_agent)
    except Unsuitable as refusal:
        rules.warnings.append(f"the task's own agent, {task.own_agent}, was not tried: {one_line(refusal)}")
        return
    if agent.plans is not None:
        return
    if (compile_it := agent.uncompiled()) is not None:
        compile_it()
    budget = next(iter(task.file.budgets.values()))
    unpaid = Unpaid(task.specification)
    training = Training(
        lambda count: BatchEnvironment(task, unpaid, count, 0), budget.steps, 0, lambda policy, steps: None, 1
    )
    try:
        rehearse(agent, training, task.file.hold)
    except Unsuitable as refusal:
        rules.keep(False, rule, one_line(refusal))
    rules.keep(True, rule, None)


def _check_controller(task: Task, rules: Rules) -> None:
    """The rules of a controller by hand, for a task that has one."""
    begun = task.starts.report_and_selection()[0]
    found = controller.record(task, begun[:: -(-len(begun) // 8)])
    if found is None:
        return
    first = found.traces[:, 0]
    rules.keep(bool(np.isfinite(first).all()), "the controller's samples are finite", first)
    score = referee.score(task, found.traces)
    rule = "the controller satisfies the formula from some starts"
    rules.keep(any(score.satisfied), rule, f"robustness {score.robustness}")


def _check_baselines(task: Task, rules: Rules) -> None:
    """Warn of a trivial task. Constant actions must get what its file states."""
    found = baselines.constants(task)
    if found.trivial:
        share = 100 * max(found.zero.satisfaction, found.best.satisfaction)
        said = ", ".join(f"{value:.6g}" for value in found.action)
        rules.warnings.append(
            f"the task is trivial: a constant action satisfies the formula from {share:.4g} % of the report's starts, "
            f"the action zero or ({said}); no method has to learn anything here"
        )
    if task.file.baselines is not None:
        axes = len(task.actions.names)
        rules.keep(len(found.action) == axes, f"baselines.constant.action has {axes} numbers", found.action)
        for name, action, stated in (
            ("zero", baselines.zero(task), found.zero),
            ("constant", np.array(found.action), found.best),
        ):
            got = baselines.score(task, action).satisfaction
            rule = f"baselines.{name} is what its action gets; the file states satisfied: {stated.satisfaction:.4g}"
            rules.keep(abs(got - stated.satisfaction) <= _ALIKE, rule, f"{got:.4g}")


def _check_forms(task: Task, traces: Array, rules: Rules) -> None:
    """The schedule, the rewarded and the nested form against the formula."""
    satisfied = stl.satisfied(task.formula, traces, task.signals)
    followed = stl.satisfied(task.file.followed, traces, task.signals)
    implied = bool((satisfied | ~followed).all())
    rules.keep(implied, "what satisfies the schedule satisfies the formula", followed & ~satisfied)
    rewarded = stl.satisfied(task.specification.formula, traces, task.signals)
    same = np.array_equal(rewarded, followed)
    rules.keep(same, "the rewarded form is satisfied when the formula or its schedule is", rewarded)
    robustness = stl.robustness(task.formula, traces, task.signals)
    form = task.formula if task.specification.nested is None else task.specification.nested
    nested = stl.robustness(form, traces, task.signals)
    rules.keep(np.allclose(nested, robustness), "the nested form has the formula's robustness", nested - robustness)
