"""The rules of a task and of a suite: what moves under random actions and under a controller, the formula, the
recipes, and names that stay.
"""

import re

import numpy as np

from stlbench import stl
from stlbench.contract import ActionGrid, Array, GymTask, Integers, System, Training, Unsuitable, World
from stlbench.errors import UsageError, one_line
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.simulation import baselines, referee
from stlbench.simulation.baselines import Unpaid
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.rehearsal import rehearse
from stlbench.simulation.verdicts import without_end
from stlbench.simulation.worlds import make_world
from stlbench.task import build_agent, starts
from stlbench.task.gym_spaces import outside_space
from stlbench.task.starts import StateStarts
from stlbench.task.task import Task, load_task
from stlbench.testing.rules import Rules
from stlbench.tracks.auto import for_every_method


def traces_of_system(task: Task, rules: Rules) -> Array:
    """Traces (N, T + 1, k) under random actions, along which the system's functions are checked."""
    generator, system, file, k = np.random.default_rng(0), task.system, task.file, len(task.signals)
    low, high = np.array(task.specification.low), np.array(task.specification.high)
    points = _points(task, generator)
    n, size = len(points), len(system.state)
    state = rules.function("initial_states", system.initial_states, (points,), (n, size))
    trace = [system.signals(state)]
    within = bool(np.all((low <= trace[0]) & (trace[0] <= high)))
    rules.keep(within, "initial states lie in the signals' ranges", trace[0])
    for t in range(file.steps):
        if t % file.hold == 0:
            action = generator.uniform(task.actions.low, task.actions.high, (n, len(task.actions.names)))
        if t % max(1, file.steps // 8) == 0:
            rules.function("step", system.step, (state, action), (n, size))
            rules.function("signals", system.signals, (state,), (n, k))
            rules.function("signals of (1, N, n)", lambda one: system.signals(one[None])[0], (state,), (n, k))
            features = rules.function("features", system.features, (state, np.full(n, t)), (n, None))
            inside = np.all((low <= trace[-1]) & (trace[-1] <= high), axis=1)
            rules.keep(bool(np.all(np.abs(features[inside]) <= 5)), "features are about in [-1, 1]", features)
            scaled = rules.function("scaled_state", system.scaled_state, (state,), (n, None))
            rules.keep(bool(np.all(np.abs(scaled[inside]) <= 5)), "the scaled state is about in [-1, 1]", scaled)
        state = system.step(state, action)
        trace.append(system.signals(state))
    return np.stack(trace, axis=1)


def check_controller(task: Task, rules: Rules) -> None:
    """That it is a function of state and time; for a task that has one."""
    control, hold = task.system.controller, task.file.hold
    assert isinstance(task.starts, StateStarts)
    state = task.system.initial_states(starts.grid(task.starts.initial, 8))
    if control(state.copy(), np.zeros(len(state), dtype=np.int64)) is None:
        return

    def actions(state: Array, t: Array) -> Array:
        action = control(state, t.astype(np.int64))
        rules.keep(action is not None, "a controller always has an action", action)
        return np.asarray(action, dtype=np.float64)

    for t in range(0, task.file.steps, hold * max(1, task.file.decisions // 8)):
        rules.function("controller", actions, (state, np.full(len(state), t)), (len(state), len(task.actions.names)))


def _points(task: Task, generator: np.random.Generator) -> Array:
    """Points of the regions where episodes begin, in the system's coordinates."""
    assert isinstance(task.starts, StateStarts)
    initial = task.starts.initial
    training = task.file.training.starts or initial
    return np.concatenate([starts.grid(initial, 4), starts.sample(training, generator, 4)])


_COPIES = 4
_STEPS = 200  # the most steps of an episode that are run again to compare


def traces_of_world(task: Task, rules: Rules) -> Array:
    """Traces (N, T + 1, k) under random actions, along which the rules of worlds are checked."""
    actions = _actions(task, np.random.default_rng(0))
    begun, world = task.starts.report_and_selection()[0], make_world(task, _COPIES)
    begun = np.resize(begun, (_COPIES, begun.shape[1]))
    trace = _episode(task, rules, world, begun, actions)
    if world.can_end:
        _warn_of_ends(task, rules, trace, np.where(world.ended, world.lived, task.file.steps))
    few = max(1, _STEPS // task.file.hold)
    again = _episode(task, rules, world, begun, actions[:few])
    same = np.array_equal(again, trace[:, : again.shape[1]])
    rules.keep(same, "the same seeds and actions give the same episodes", "another episode in the same copies")
    alone = _episode(task, rules, make_world(task, 1), begun[-1:], actions[:few, -1:])
    same = np.array_equal(alone[0], again[-1])
    rules.keep(same, "an episode is the same in another copy", "another episode in a copy of its own")
    _check_restart(task, rules, world, begun)
    return trace


def _warn_of_ends(task: Task, rules: Rules, traces: Array, lasted: Integers) -> None:
    """Warn if random actions end an episode before the formula is decided: a policy may learn to do that."""
    recorded = traces if task.file.terminated == "hold" else without_end(traces.copy(), lasted)
    satisfied, horizon = np.array(referee.score(task, recorded).satisfied), stl.horizon(task.formula)
    early = lasted < horizon
    if early.any():
        said = (
            f"{early.sum()} of {len(early)} episodes of random actions end before step {horizon}, the formula's horizon"
        )
        rule = f"by `terminated: {task.file.terminated}` {(early & satisfied).sum()} of these satisfy the formula"
        rules.warnings.append(f"{said}; {rule}")


def _actions(task: Task, generator: np.random.Generator) -> Array:
    """Random ones of a whole episode: (decisions, N, axes)."""
    actions, shape = task.actions, (task.file.decisions, _COPIES)
    if isinstance(actions, ActionGrid):
        return actions.vectors[generator.integers(actions.size, size=shape)]
    return generator.uniform(actions.low, actions.high, (*shape, len(actions.names)))


def _episode(task: Task, rules: Rules, world: World, begun: Array, actions: Array) -> Array:
    """The trace of one episode in each copy."""
    k, hold, count = len(task.signals), task.file.hold, len(begun)
    low, high = np.array(task.specification.low), np.array(task.specification.high)
    world.restart(np.arange(count), begun)
    rules.keep(world.signals.shape == (count, k), f"signals has shape (N, {k})", world.signals.shape)
    outside = np.argwhere(~((low <= world.signals) & (world.signals <= high)))
    got = [f"{task.signals[column]} is {world.signals[row, column]}" for row, column in outside[:1]]
    rules.keep(not got, "the first samples lie in the signals' ranges", "".join(got))
    begin = np.zeros(count, dtype=np.int64)
    _warn_of_outside(task, rules, world.features(begin), begin)
    trace = [world.signals[None].copy()]
    for i, action in enumerate(actions):
        ended, before = world.ended.copy(), world.signals.copy()
        samples = world.advance(action, hold)
        _check_samples(rules, samples, before, (hold + 1, count, k))
        rules.keep(*_finite(task, samples, i * hold))
        if world.can_end:
            rules.keep(bool((samples[:, ended] == before[ended]).all()), "a copy that has ended stands still", samples)
        _check_features(task, rules, world, np.full(count, (i + 1) * hold), (low, high))
        trace.append(samples[1:])
    return np.concatenate(trace).transpose(1, 0, 2)


def _check_samples(rules: Rules, samples: Array, before: Array, shape: tuple[int, ...]) -> None:
    rules.keep(samples.shape == shape, "advance has shape (steps + 1, N, k)", samples.shape)
    rules.keep(np.array_equal(samples[0], before), "advance begins with the sample before it", samples[0])


def _finite(task: Task, samples: Array, t: int) -> tuple[bool, str, object]:
    """The rule, and the first sample that breaks it, of samples (hold + 1, N, k), the first at step t."""
    wrong = np.argwhere(~np.isfinite(samples))
    got = [f"{task.signals[k]} is {samples[i, row, k]} at step {t + i} of copy {row}" for i, row, k in wrong[:1]]
    return not got, "samples are finite", "".join(got)


def _check_features(task: Task, rules: Rules, world: World, t: Integers, box: tuple[Array, Array]) -> None:
    features = world.features(t)
    rules.keep(features.ndim == 2 and len(features) == len(t), "features has shape (N, d)", features.shape)
    _warn_of_outside(task, rules, features, t)
    rules.keep(bool(np.isfinite(features).all()), "features is finite", features)
    inside = np.all((box[0] <= world.signals) & (world.signals <= box[1]), axis=1)
    most = np.abs(features[inside]).max(axis=0, initial=0.0)
    place = int(np.argmax(most))
    said = f"{most[place]:.3g} of {_feature(task, place)}; a scale would help"
    rules.keep(bool(most[place] <= 5), "features are about in [-1, 1]", said)


def _warn_of_outside(task: Task, rules: Rules, features: Array, t: Integers) -> None:
    """Warn, once for each entry, of observations outside their space."""
    for row, _, said in task.source.observed.beyond(features) if isinstance(task.dynamics, GymTask) else ():
        if not any(said.partition(" is ")[0] in line for line in rules.warnings):
            problem = outside_space(said, f"at step {t[row]} of copy {row}")
            remedy = "`environment.scale` takes the place of these ends, and ranges should reach what signals take"
            rules.warnings.append(f"{problem}; {remedy}")


def _feature(task: Task, place: int) -> str:
    return task.source.observed.name(place) if isinstance(task.dynamics, GymTask) else f"number {place}"


def _check_restart(task: Task, rules: Rules, world: World, begun: Array) -> None:
    """One row begins anew, and the other rows stay."""
    world.restart(np.arange(_COPIES), begun)
    first = world.signals.copy()
    world.advance(np.tile(task.actions.low, (_COPIES, 1)).astype(np.float64), task.file.hold)
    others = world.signals[1:].copy()
    world.restart(np.array([0]), begun[:1])
    rules.keep(np.array_equal(world.signals[0], first[0]), "a row begins where its start says", world.signals[0])
    rules.keep(np.array_equal(world.signals[1:], others), "the other rows go on", world.signals[1:])


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
        _check_forms(task, traces_of_system(task, rules), rules)
        check_controller(task, rules)
    else:
        _check_forms(task, traces_of_world(task, rules), rules)
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
    found = baselines.record_controller(task, begun[:: -(-len(begun) // 8)])
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
            got = baselines.score_constant(task, action).satisfaction
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


_NAME = re.compile(r"[a-z0-9][a-z0-9-]*(/[a-z0-9-]+)*")


def check_suite(suite: str, rules: Rules | None = None) -> None:
    """Check a suite, and the first task of each of its splits.

    The rules: names are parts of a-z, 0-9 and - with slashes between them, each of a task of its own; splits have these
    names; all tasks have the same kinds of groups; a name gives the same task twice; a task keeps the rules of
    `check_task`.

    Args:
        suite: the name of an installed suite.
        rules: takes those that are kept, for a caller that lists them.

    Raises:
        AssertionError: the rule that is broken.
        UsageError: no such suite, or a task file with errors.
    """
    rules, made = rules or Rules(), plugins.made(plugins.find("suites", suite))
    wrong = [name for name in made.names if not _NAME.fullmatch(name)]
    rules.keep(not wrong, "names are parts of a-z, 0-9 and - with slashes between them", wrong[:1])
    joined = [name.replace("/", "-") for name in made.names]
    rules.keep(len(set(joined)) == len(joined), "no two names are alike with - in place of /", joined)
    unknown = [name for names in made.splits.values() for name in names if name not in made.names]
    rules.keep(not unknown, "splits have names of the suite", unknown[:1])
    kinds = {tuple(made.groups(name)) for name in made.names}
    rules.keep(len(kinds) <= 1, "all tasks have the same kinds of groups", kinds)
    for name in dict.fromkeys(names[0] for names in made.splits.values() if names):
        rules.keep(made.task(name) == made.task(name), "a name gives the same task twice", name)
        check_task(f"{suite}:{name}", rules)
