"""Episodes of stored policies as data sets of Minari, with the referee's robustness as labels."""

import re
import shutil
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from stlbench import __version__
from stlbench.contract import ActionGrid, Array, Integers, Policy
from stlbench.errors import UsageError, unwritable
from stlbench.records.result import Result
from stlbench.records.result_files import inside, write
from stlbench.share.zoo import with_policies
from stlbench.simulation import referee
from stlbench.simulation.environment import Simulator
from stlbench.simulation.faults import Question, plugins_of
from stlbench.simulation.worlds import observation_of
from stlbench.study.plugin_guard import ask_one
from stlbench.study.policies import load_policy
from stlbench.task import Task

_CARD = "README.md"
"""The file name under which Hugging Face's hub finds a card of a data set."""


class Episode(NamedTuple):
    observations: NDArray[np.float32]
    """(decisions + 1, D), without the inputs of the method."""
    actions: Integers | Array
    """Indices (decisions,) of the grid, or vectors (decisions, axes)."""
    signals: Array
    """(decisions + 1, hold, k): the samples that the action before led to; first the first sample, repeated."""
    ended: bool
    """Whether the environment ended the episode, before its time."""
    robustness: float
    satisfied: bool


class Played(NamedTuple):
    """The episodes of a stored policy from the starts of the report."""

    task: Task
    observation: str
    episodes: tuple[Episode, ...]


def export(folder: Path, target: Path) -> list[Path]:
    """Write a data set for each task and track whose policies are stored; the folders of the data sets.

    A data set is in `stlbench/TASK-TRACK-v0` below the target, in Minari's layout, with a card beside it. Raises
    `UsageError` if Minari is missing, no policy is stored, a data set is there already, or it cannot be written.
    """
    try:
        import minari.dataset.minari_storage  # noqa: F401
    except ImportError as error:
        raise UsageError('Minari is not installed: pip install "stlbench-rl[minari]"') from error
    groups = defaultdict[str, list[Result]](list)
    for result in with_policies(folder):
        groups[_name(result)].append(result)
    if not groups:
        raise UsageError(f"{folder} has no stored policy, which could act again")
    for name, group in groups.items():
        if len(tasks := sorted({str(result.id.task) for result in group})) > 1:
            raise UsageError(f"{' and '.join(tasks)} would both be {name}; export them from folders of their own")
    places = {name: inside(target / name, target) for name in groups}
    for place in places.values():  # before a policy acts
        if (place / "data").exists():
            raise UsageError(f"{place} is there already; remove it, or name another folder with --out")
    try:
        target.mkdir(parents=True, exist_ok=True)
        with _all_or_none(places.values()):
            return [_write(folder, group, name, places[name]) for name, group in groups.items()]
    except OSError as error:
        raise unwritable(f"cannot write {target}", error) from error


@contextmanager
def _all_or_none(places: Collection[Path]) -> Iterator[None]:
    """Remove data sets that were written, none of which was there, where not all can be."""
    cards = [place / _CARD for place in places if not (place / _CARD).exists()]
    try:
        yield
    except BaseException:
        for place in places:
            if (place / "data").is_dir():
                shutil.rmtree(place / "data", ignore_errors=True)
                with suppress(OSError):
                    if place / _CARD in cards:
                        (place / _CARD).unlink(missing_ok=True)
                    place.rmdir()
        raise


def _name(result: Result) -> str:
    words = re.sub(r"[^A-Za-z0-9]+", "-", f"{result.id.task}-{result.id.track}").strip("-")
    return f"stlbench/{words}-v0"


def _write(folder: Path, group: Sequence[Result], name: str, place: Path) -> Path:
    import minari
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    buffers, labels = list[EpisodeBuffer](), list[dict[str, Any]]()
    for result in group:
        played = ask_one(Question(play, (folder, result), plugins_of(result.id), f"{result.id.name} cannot act"))
        assert result.measured.policies is not None
        made_by = {"cell": result.id.name, "policy": result.measured.policies.selected}
        for episode in played.episodes:
            buffers.append(_buffer(EpisodeBuffer, episode))
            labels.append({"robustness": episode.robustness, "satisfied": episode.satisfied, **made_by})
    (place / "data").mkdir(parents=True)
    task = played.task
    data = (place / "data").absolute()  # Minari goes wrong with a relative path
    storage = MinariStorage.new(data, *_spaces(task, played.episodes[0]), data_format="hdf5")
    storage.update_metadata(
        {
            "dataset_id": name,
            "minari_version": minari.__version__,
            "algorithm_name": "policies that stlbench trained",
            "description": f"{task.name}: {task.file.title}. An episode's return is the robustness of {task.formula}",
            "requirements": [f"stlbench-rl=={__version__}"],
        }
    )
    storage.update_episodes(buffers)
    storage.update_episode_metadata(labels)
    words = {
        "dataset": name,
        "policies": len(group),
        "task": task.name,
        "episodes": len(buffers),
        "steps": sum(len(buffer.rewards) for buffer in buffers),
        "minari": minari.__version__,
        "version": __version__,
        "formula": task.formula,
        "sampling_time": f"{task.file.sampling_time:g}",
        "hold": task.file.hold,
        "observation": played.observation,
        "signals": ", ".join(task.signals),
        "cells": ", ".join(f"`{result.id.name}`" for result in group),
    }
    template = Template((Path(__file__).parent / "data.md").read_text(encoding="utf-8"))
    write(place / _CARD, template.substitute(words))
    return place


def _spaces(task: Task, episode: Episode) -> tuple[Box, Discrete | Box]:
    actions = task.actions
    seen = Box(-np.inf, np.inf, episode.observations.shape[1:], np.float32)
    if isinstance(actions, ActionGrid):
        return seen, Discrete(actions.size)
    return seen, Box(np.array(actions.low), np.array(actions.high), dtype=np.float64)


def _buffer(kind: Any, episode: Episode) -> Any:
    count = len(episode.actions)
    rewards = np.zeros(count)
    rewards[-1] = episode.robustness
    over = np.arange(count) == count - 1
    return kind(
        observations=episode.observations,
        actions=episode.actions,
        rewards=rewards,
        terminations=over & episode.ended,
        truncations=over & (not episode.ended),
        infos={"signals": episode.signals},
    )


def play(folder: Path, result: Result) -> Played:
    """Let the selected policy of a cell act again from each start of the report. Raises `UsageError`."""
    task, method, policy = load_policy(folder, result)
    begun, episodes = task.starts.report_and_selection()[0], list[Episode]()
    for part in np.array_split(begun, -(-len(begun) // referee.at_once(task))):
        seen = _Seen(policy)
        traces, lasted = referee.simulate(task, method, seen.act, part)
        score = referee.score(task, traces, lasted=lasted)
        width = seen.observed[0].shape[1] - method.input_size
        observed = np.stack([*seen.observed, seen.simulator.observe()], axis=1)[..., :width].astype(np.float32)
        acted = np.stack(seen.acted, axis=1)
        for number, steps in enumerate(lasted):
            decisions = -(-int(steps) // task.file.hold)
            episodes.append(
                Episode(
                    observed[number, : decisions + 1],
                    acted[number, :decisions],
                    _samples(traces[number], decisions, task.file.hold),
                    bool(steps < task.file.steps),
                    score.robustness[number],
                    score.satisfied[number],
                )
            )
    shown = replace(observation_of(task, method), inputs=0, method="")
    return Played(task, str(shown), tuple(episodes))


class _Seen:
    """Acts as a policy, and keeps what it was shown and what it did."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.observed, self.acted = list[Array](), list[Any]()

    def act(self, simulator: Simulator) -> Integers | Array:
        self.simulator = simulator
        self.observed.append(simulator.observe())
        self.acted.append(self.policy.act(self.observed[-1]))
        action: Integers | Array = self.acted[-1]
        return action


def _samples(trace: Array, decisions: int, hold: int) -> Array:
    first = np.repeat(trace[:1], hold, axis=0)
    return np.concatenate([first, trace[1 : decisions * hold + 1]]).reshape(decisions + 1, hold, -1)
