"""The score of a policy that stlbench did not train, by the same referee and starts, and its row in a ledger."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from stlbench.contract import Array, GymTask, Intractable, RewardMethod, System, Unsuitable
from stlbench.errors import UsageError
from stlbench.records import array_files, results_folder, upkeep
from stlbench.records.array_files import Assessment
from stlbench.records.identity import OUTSIDE, CellId, ReadCell, valid
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.observation import Observation
from stlbench.records.result import MAIN, TASK_FOLDER, Measurement, Result, Score
from stlbench.records.result_files import cell_files, inside, writing
from stlbench.registry import named_tasks
from stlbench.registry.choices import NAME, Choice
from stlbench.share.actions import OnObservation, OnState, numbers_of, read_actions
from stlbench.share.onnx import load_onnx
from stlbench.share.source import Source, from_the_reports_starts, load_function, load_traces
from stlbench.share.torch_files import load_sb3, load_state_dict
from stlbench.simulation import referee
from stlbench.simulation.baselines import Unpaid
from stlbench.simulation.faults import Question
from stlbench.simulation.worlds import observation_of
from stlbench.study.cell import digest, harness
from stlbench.study.provenance import collect
from stlbench.task import Task, build_method, load_task

UNKNOWN = Choice("unknown")
"""In the place of a method: nobody said which reward the policy was trained by, and it is shown no inputs of one."""
On = Literal["observation", "state", "environment"]


@dataclass(frozen=True)
class Shown:
    """The view of a policy."""

    on: On | None = None
    """Agents of stlbench see (N, D); of a system the states (N, n), and for a function the step counts t (N,); of a
    task on an environment its own observations (N, d), as they are. None is the first, unless a file contradicts
    it."""
    method: Choice = UNKNOWN  # the reward method whose inputs are the end of the observation


class Scored(NamedTuple):
    measurement: Measurement  # with what is known of it: scores, and nothing of a training
    assessment: Assessment  # without states if it is of recorded traces
    starts: str  # whose they are, in words
    observation: str = ""  # what the policy was shown, in words; empty of recorded traces
    moved: str = ""  # how many of its actions were moved to the task's grid, and how far; empty where none was


def score(task: Task, source: Source, shown: Shown, random_starts: int) -> Scored:
    """Score a policy, or recorded traces, by a task's formula and protocols.

    There are `random_starts` beside the grid, as the task's budget says. Raises `UsageError` if the policy cannot be
    read, is for another observation, fails, or gives no actions of the task; or if traces are not of the task.
    """
    begun = time.process_time(), time.perf_counter()
    if source.kind == "traces":
        if shown != Shown():
            raise UsageError(f"{source.text} has traces, which are shown nothing; leave --method and --on out")
        traces, lasted = load_traces(source.path, task)
        try:
            assessment = Assessment({MAIN: referee.score(task, traces, lasted=lasted)}, traces, None)
        except ValueError as error:
            raise UsageError(f"{source.text}: {error}") from error
        starts = "the report's starts" if from_the_reports_starts(traces, task) else "starts of its own"
        return Scored(_measured(assessment.scores, begun), assessment, starts)
    played = play(task, source, shown)
    assessment = referee.Referee(task, played.method, random_starts).assess(played.policy)
    measured = _measured(assessment.scores, begun, played.method.input_size)
    moved = played.policy.moved.text({name: axis.unit for name, axis in task.file.actions.items()}, task.actions.names)
    return Scored(measured, assessment, "the report's starts", played.observation, moved)


class Played(NamedTuple):
    """The referee needs this to let a policy act."""

    method: RewardMethod
    policy: OnObservation | OnState
    observation: str  # what it is shown, in words


def play(task: Task, source: Source, shown: Shown) -> Played:
    method = _method(task, shown.method)
    observation = observation_of(task, method, "" if shown.method == UNKNOWN else str(shown.method))
    table = None if source.table is None else read_actions(Path(source.table), task.actions)
    if shown.on == "state":
        if not isinstance(task.dynamics, System):
            raise UsageError(f"--on state: task {task.name} is no system, its states are not to be had")
        observation = Observation(len(task.dynamics.state), task.dynamics.state, task=task.name).unscaled
        function = _function(task, source, table, observation, shown)
        if source.kind == "function":
            return Played(method, OnState(function, task.actions, source.text, table), f"{observation} and the step")
        # a network is given the states alone
        of_states = OnState(lambda state, t: function(state), task.actions, source.text, table)
        return Played(method, of_states, str(observation))
    if shown.on != "environment":
        function = _function(task, source, table, observation, shown)
        return Played(method, OnObservation(function, task.actions, source.text, table), str(observation))
    if not isinstance(task.dynamics, GymTask):
        raise UsageError(f"--on environment: task {task.name} is on no environment of Gymnasium")
    if method.input_size:
        raise UsageError("--on environment: what it shows has no inputs of a method; leave --method out")
    observed = task.source.observed
    function = _function(task, source, table, observation.unscaled, shown)
    own = OnObservation(lambda seen: function(observed.own(seen[:, : observed.size])), task.actions, source.text, table)
    return Played(method, own, str(observation.unscaled))


def _method(task: Task, choice: Choice) -> RewardMethod:
    if choice == UNKNOWN:
        return Unpaid(task.specification)
    try:
        return build_method(task, choice)
    except (Intractable, Unsuitable) as error:
        raise UsageError(f"method {choice} on task {task.name}: {error}") from error


def _function(
    task: Task, source: Source, table: Array | None, observation: Observation, shown: Shown
) -> Callable[..., Any]:
    actions = task.actions if table is None else numbers_of(table)
    match source.kind:
        case "function":
            return load_function(source.text)
        case "sb3":
            return load_sb3(source.path, actions, observation, declared=shown.on is not None)
        case "torch":
            assert source.architecture is not None
            return load_state_dict(source.path, source.architecture, observation.total)
        case _:
            return load_onnx(source.path, observation)


def _measured(scores: Mapping[str, Score], begun: tuple[float, float], inputs: int = 0) -> Measurement:
    """Nothing of it is about training; the seconds are those of scoring."""
    cpu, wall = time.process_time() - begun[0], time.perf_counter() - begun[1]
    return Measurement(
        selected=scores,
        final=scores,
        selected_steps=0,
        curve=(),
        training_cpu_seconds=0.0,
        training_wall_seconds=0.0,
        cpu_seconds=cpu,
        wall_seconds=wall,
        env_steps=0,
        reward_nanoseconds=0.0,
        inputs_added=inputs,
    )


class Entry(NamedTuple):
    result: Result
    scored: Scored
    signals: tuple[str, ...]  # of the task


def outside_question(
    task: Choice, source: Source, shown: Shown, budget: str | None, name: str | None, seed: int
) -> Question[Entry]:
    """A question for the score of a policy from outside. No budget means the task's only one, else `quick`."""
    functions = [("functions", source.text)] if source.kind == "function" else []
    methods = [("methods", shown.method.name)] if shown.method != UNKNOWN else []
    plugins = ("tasks", task.name), *methods, *functions
    arguments = task, source, shown, budget, name, seed
    return Question(_entry, arguments, plugins, f"{source.text} cannot be scored on {task}")


def _entry(choice: Choice, source: Source, shown: Shown, budget: str | None, name: str | None, seed: int) -> Entry:
    task = load_task(choice)
    budgets = tuple(task.file.budgets)
    budget = budget or (budgets[0] if len(budgets) == 1 else "quick")
    scored = score(task, source, shown, task.budget(budget).random_starts)
    return Entry(row(task, source, shown, scored, budget, name, seed), scored, task.signals)


def row(task: Task, source: Source, shown: Shown, scored: Scored, budget: str, name: str | None, seed: int) -> Result:
    """The row: the policy's name is in the place of the agent, its source and hash are in the provenance."""
    if name is not None and not NAME.fullmatch(name):
        raise UsageError(f"--name {name}: a name consists of a-z, 0-9 and -, and does not begin with -")
    cell = CellId(task.choice, shown.method, Choice(name or source.name), seed, budget, OUTSIDE)
    try:
        valid(ReadCell, cell.plain)  # else the row would be refused when it is read
    except ValueError as error:
        raise UsageError(f"{cell.name}: {error}") from error
    sha256, more, on = source.digest, source.more, shown.on or "observation"
    key = digest([harness().digest, cell.name, budget, sha256, on, more])
    remarks = {"observation": scored.observation, "moved": scored.moved}
    facts = {"source": source.shown, "sha256": sha256, "on": on, "begun_at": scored.starts, **more}
    facts |= {name: text for name, text in remarks.items() if text}
    folder = named_tasks.place_of(task.choice.name)
    place = {} if folder is None else {TASK_FOLDER: str(folder)}
    return Result(cell, key, "done", measurement=scored.measurement, provenance={**facts, **collect(1), **place})


def record(folder: Path, entry: Entry) -> Result | None:
    """Write a row and its traces to a folder of results; the row of the same name that it replaces, if any.

    Raises `UsageError` if the folder has no ledger but lines of text, or cannot be written.
    """
    result = entry.result
    results_folder.refuse_lines(folder, "say another folder by --results")
    with writing(folder), Ledger(folder / LEDGER) as ledger:
        before = next((each for each in ledger.results() if each.id == result.id), None)
        traces = inside(cell_files(folder, result.id, result.key).traces, folder)
        array_files.save_traces(traces, entry.scored.assessment, entry.signals)
        upkeep.replace(folder, ledger, result)
    return before
