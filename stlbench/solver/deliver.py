"""The folder of a solution: certificate, counterexamples, policy, page, film, and a text that says what came of it."""

import json
import shlex
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stlbench.contract import GymTask
from stlbench.errors import UsageError, one_line, unwritable
from stlbench.records import array_files, results_folder
from stlbench.records.array_files import read_policy
from stlbench.records.result import LEARNED, MAIN, Result
from stlbench.records.result_files import inside, write
from stlbench.registry import named_tasks
from stlbench.report import Report, condense
from stlbench.report.files import write as write_report
from stlbench.report.page import Opening, require, write_page
from stlbench.search.actor import Actor, of_cell, space_of
from stlbench.search.certify import Claim, certify
from stlbench.search.falsify import Falsification, How, falsify
from stlbench.search.outputs import write as write_counterexample
from stlbench.share.onnx import export
from stlbench.share.source import found_with
from stlbench.solver.contestants import rank
from stlbench.solver.problem import Problem
from stlbench.solver.solution import FILE, FINAL, MORE, TEXT, cells_of
from stlbench.solver.trainer import Clock
from stlbench.solver.workspace import TASK, WITNESS, Workspace
from stlbench.study.plugin_guard import ask, load_guarded
from stlbench.study.policies import EVERY
from stlbench.task.reading import code_of
from stlbench.task.task import Task
from stlbench.tracks.references import references

_SHARE = 0.05
"""The share of the time for the episodes of the certificate. The search for a counterexample has as many."""
_MOST, _FEWEST, _TIMED = 1000, 100, 16  # starts of the certificate, and those by which an episode is timed
_COUNTEREXAMPLE = "counterexample"
_OF_POLICY = (FILE, TEXT, "policy.npz", "policy.onnx", "page.html", "film.gif")
"""Files on one policy. Those of an earlier policy are removed."""


@dataclass(frozen=True)
class Delivery:
    """The files that come of trainings."""

    workspace: Workspace
    problem: Problem
    clock: Clock
    confidence: float
    trained: Sequence[Result]
    """The best first."""
    interrupted: bool = False
    """Whether the user stopped it: the certificate then has few starts, and there is no search, page or film."""

    @property
    def best(self) -> Result:
        """Chosen by the starts for selection."""
        return self.trained[0]

    @property
    def folder(self) -> Path:
        """The folder of all files."""
        return self.workspace.folder

    @property
    def cells(self) -> Path:
        """The folder of results that has the best."""
        return self.folder / cells_of(self.best.id.budget)

    def write(self) -> dict[str, Any]:
        """Write all files; the facts of the certificate."""
        actor, remarks = of_cell(self.cells, self.best), list[str]()
        starts = _FEWEST if self.interrupted else self._starts(actor)
        facts = {"formula": str(actor.task.formula), "step seconds": actor.task.file.sampling_time}
        facts |= {"environment": _environment(actor.task, self.problem)}
        facts |= {"cell": self.best.id.name, "budget": self.best.id.budget, "key": self.best.key}
        repeatable = self.workspace.state["repeatable"]
        facts |= {"interrupted": self.interrupted} | self._certified(actor, starts) | {"repeatable": repeatable}
        if not repeatable:
            facts["seed"] = None
        counterexample = None
        if repeatable and not self.interrupted:
            if self.clock.left:
                counterexample = falsify(actor, How(evaluations=starts))
            else:
                remarks.append(self._left_out("a counterexample"))
        self._remove_earlier()  # after the search: an interrupt of it loses no earlier solution
        if counterexample is not None and counterexample.found:
            write_counterexample(counterexample, self.folder / _COUNTEREXAMPLE)
        page = partial(self._page, actor.task, facts, counterexample)
        for what, part in (("policy", self._policy), ("film", self._film), ("page", page)):
            if what != "policy" and (self.interrupted or not self.clock.left):
                remarks.append(self._left_out(f"the {what}"))
                continue
            try:
                part()
            except UsageError as error:
                remarks.append(f"left out: {one_line(error)}")
        write(self.folder / TEXT, "\n".join(self._text(actor.task, facts, counterexample, remarks)) + "\n")
        write(self.folder / FILE, json.dumps(facts, indent=1))  # the last, as it says that all is delivered
        return facts

    def _remove_earlier(self) -> None:
        """Remove what an earlier delivery wrote: it may be on another policy."""
        for name in _OF_POLICY:
            inside(self.folder / name, self.folder).unlink(missing_ok=True)
        if (found := inside(self.folder / _COUNTEREXAMPLE, self.folder)).is_dir():
            shutil.rmtree(found)

    def _left_out(self, what: str) -> str:
        """Why a part is not made, and the command that makes it."""
        parts = (self.best.id.name, self.cells, self.folder / TASK.name)
        cell, cells, home = (shlex.quote(str(part)) for part in parts)
        known = f"--budget {self.best.id.budget} --task-folder {home}"
        later = {
            "a counterexample": f"falsify {cell} --results {cells} {known}` searches one",
            "the film": f"render {cells} {cell} {known}` makes it",
            "the page": f"report {cells} --html --task-folder {home}` makes it",
        }
        why = "interrupted before" if self.interrupted else "no time was left for"
        entry = self.workspace.task.file.environment
        return f"{why} {what}; `{found_with(entry.id if entry else None)}stlbench {later[what]}"

    def _starts(self, actor: Actor) -> int:
        """The starts of the certificate: as many as a share of the time lets the policy act from."""
        points = space_of(actor.task).draw(np.random.default_rng(0), _TIMED)
        began = time.perf_counter()
        actor.play(points)
        each = (time.perf_counter() - began) / len(points)
        return int(np.clip(60 * _SHARE * self.clock.minutes / each, _FEWEST, _MOST))

    def _certified(self, actor: Actor, starts: int) -> dict[str, Any]:
        """The facts of the certificate; of a task with a single start, whether it satisfies."""
        space = space_of(actor.task)
        if not space.single:
            return dict(certify(actor, Claim(self.confidence, starts=starts)).facts)
        satisfied = int(actor.play(space.draw(np.random.default_rng(0), 1)).satisfied[0])
        return {"starts": 1, "satisfied": satisfied, "probability": float(satisfied), "low": None, "confidence": None}

    def _policy(self) -> None:
        array_files.write_arrays(self.folder / "policy.npz", read_policy(self.cells, self.best, "selected"))
        export(self.cells, self.best, "selected", self.folder / "policy.onnx")

    def _page(self, task: Task, facts: Mapping[str, Any], attacked: Falsification | None) -> None:
        """The page, or without its package the tables and figures as files."""
        cells = self.cells
        groups = condense(results_folder.read(cells))
        report = Report(groups, references((group.setting for group in groups), ask))
        try:
            require()
        except UsageError:
            write_report(report, cells, load_guarded)
            raise
        with results_folder.one_by_one(cells) as find:
            opening = self._opening(task, facts, attacked)
            write_page(report, find, cells, load_guarded, ask, self.folder / "page.html", opening=opening)

    def _opening(self, task: Task, facts: Mapping[str, Any], attacked: Falsification | None) -> Opening:
        """Certificate, film and counterexample, and what was asked of what."""
        file, cell = task.file, self.best.id
        asked = {
            "environment": facts["environment"],
            "formula": f"{task.formula}",
            "steps": f"of {file.sampling_time:g} s; an episode has {file.steps}",
            **{f"signal {name}": signal.expression or "an entry" for name, signal in file.signals.items()},
            "an early end": file.terminated,
            "trained by": f"{cell.method} with {cell.agent}, seed {cell.seed}, within {self.clock.minutes:g} minutes",
        }
        lines = [sentence(facts)]
        if attacked is not None:
            lines.append(f"The search for a counterexample tried {attacked.evaluations} starts: {_attack(attacked)}.")
        found = sorted((self.folder / _COUNTEREXAMPLE).glob("*.png"))
        pictures = [path for path in (self.folder / "film.gif", *found) if path.is_file()]
        return Opening([*lines, *self._notes(facts)], [*asked.items()], pictures, file.title)

    def _film(self) -> None:
        from stlbench.study.film import film_cell  # imports Matplotlib, for which no training should wait

        filmed = film_cell(self.cells, self.best, "selected", EVERY, "gif", self.folder)
        for path in filmed.paths:
            target = inside(self.folder / f"film{path.suffix}", self.folder)
            try:
                path.replace(target)
            except OSError as error:
                raise unwritable(f"cannot write {target}", error) from error

    # ------------------------------------------------------------------------------------------------------- the text

    def _notes(self, facts: Mapping[str, Any]) -> list[str]:
        """Notes on the problem, without doubts that the policy refutes."""
        return [*(() if facts["probability"] >= LEARNED else self.workspace.doubts), *self.workspace.notes]

    def _text(
        self, task: Task, facts: Mapping[str, Any], attacked: Falsification | None, remarks: Sequence[str]
    ) -> Iterator[str]:
        yield f"# {task.file.title}\n"
        if self.interrupted:
            yield "Interrupted: this is the best policy so far. The same command goes on.\n"
        yield f"{sentence(facts)}\n"
        yield f"Formula, in steps of {task.file.sampling_time:g} s: `{task.formula}`\n"
        cell = self.best.id
        yield f"Trained by {cell.method} with {cell.agent}, seed {cell.seed}, on the track auto."
        if task.file.schedule is not None and cell.task != TASK:
            yield f"It followed these windows: `{task.file.schedule}`."
        yield from self._comparison()
        if attacked is not None:
            yield f"The search for a counterexample tried {attacked.evaluations} starts: {_attack(attacked)}."
        yield from (f"\n- {line}" for line in (*self._notes(facts), *remarks))
        if facts["probability"] < LEARNED:
            yield from ("", "## What is missing", "", *self._missing())
        yield from ("", "## Run the policy", "", "```python", *_lines(task, self.problem, self.folder), "```", "")
        yield "## Files"
        for name in sorted({path.name for path in self.folder.iterdir()} | {FILE}):
            yield f"- `{name}`"

    def _comparison(self) -> Iterator[str]:
        """The results of the final training, so that one lucky seed does not hide another."""
        finals = [result for result in self.trained if result.id.budget == FINAL and result.measurement is not None]
        shares = {result.id.seed: rank(result)[0] for result in finals}
        each = ", ".join(f"seed {seed} {100 * share:.0f} %" for seed, share in sorted(shares.items()))
        if each:
            yield f"Retrained with fresh seeds. Share of the selection starts that satisfy: {each}."
        if self.best.id.budget.startswith(MORE):
            yield "It was trained on, after the policies before it."
        elif self.best.id.budget != FINAL:
            ended = "it was interrupted then" if self.interrupted else "nothing was trained after it"
            if any(result.id.budget.startswith(MORE) for result in self.trained):
                ended = "no later training gave a better one"
            why = "no fresh seed is better on the selection starts" if each else ended
            yield f"The policy is from the race: {why}."

    def _missing(self) -> Iterator[str]:
        assert self.best.measurement is not None
        score = self.best.measurement.selected[MAIN]
        yield f"The best policy satisfies from {100 * score.satisfaction:.0f} % of the report's starts."
        yield f"Its mean robustness there is {score.mean:.3g}, from its best start {max(score.robustness):.3g}."
        failing = max(score.first_failed.items(), key=lambda part: part[1], default=("", 0))
        if failing[1]:
            yield f"What fails first, from {failing[1]} of {score.starts} starts: `{failing[0]}`."
        yield self._witness(any(score.satisfied))
        yield "\nMost promising to change:\n"
        yield from (f"{place}. {text}" for place, text in enumerate(self._suggestions(failing[0]), 1))

    def _witness(self, satisfied: bool) -> str:
        if satisfied:
            return "A witness exists: the policy satisfies from some starts."
        if (self.folder / WITNESS).is_file():
            return f"A witness exists: the held actions of `{WITNESS}` satisfy from one start."
        return "No episode is known that satisfies."

    def _suggestions(self, failing: str) -> list[str]:
        """The two most promising changes."""
        assert self.best.measurement is not None
        measured, task = self.best.measurement, self.workspace.task
        texts = []
        if measured.selected[MAIN].ended_early and task.file.terminated == "violated":
            texts.append(
                "The environment ends episodes early, which violates; `terminated: hold` keeps the last sample."
            )
        if measured.selected_steps > 0.6 * measured.env_steps and rank(self.best)[0] < 1:
            texts.append(
                f"The policy was still improving: take more time, such as `--minutes {3 * self.clock.minutes:g}`."
            )
        texts.append(f"Relax `{failing or task.formula}`: a wider tolerance, or a later and longer interval.")
        texts.append(
            "Narrow the ranges of the signals in `task/task.yaml` to what the task needs: rewards scale with them."
        )
        texts.append(f"Take more time, such as `--minutes {3 * self.clock.minutes:g}`.")
        return texts[:2]


def sentence(facts: Mapping[str, Any]) -> str:
    """The certificate in words."""
    if not facts["satisfied"]:
        return f"Not learned: the policy satisfies from none of {facts['starts']} fresh starts."
    if facts["low"] is None:
        return "The task has a single start, from which the policy satisfies."
    counted = f"{facts['satisfied']} of {facts['starts']} fresh starts"
    share = f"{100 * np.floor(1e3 * facts['low']) / 1e3:.1f} %"  # rounded down, as a claim must not exceed its proof
    confidence = f"{100 * facts['confidence']:.15g} % confidence"  # all digits: 99.99999 % is not 100 %
    said = f"It satisfies from at least {share} of the starts, {confidence} ({counted})."
    held = facts.get("held")
    return f"{said} {held} of these rest on the last sample, which stays after an early end." if held else said


def _environment(task: Task, problem: Problem) -> str:
    """The id in Gymnasium, or the name of the task: never a path."""
    entry = task.file.environment
    if entry and entry.id:
        return entry.id
    name, home = problem.environment, Path(problem.environment)
    own = named_tasks.is_path(name) and home.is_dir()  # its name may be that of the solution's folder `task`
    return home.absolute().name if own else f"{named_tasks.task_of(name)}"


def _attack(attacked: Falsification) -> str:
    if not attacked.found:
        return f"no counterexample, least robustness {attacked.worst.robustness:.3g}"
    return (
        f"from {attacked.start_text(4)} it violates, robustness {attacked.worst.robustness:.3g}; see `counterexample/`"
    )


def _lines(task: Task, problem: Problem, folder: Path) -> list[str]:
    """Python that runs the policy for an episode."""
    trusted = ", run_code=True" if code_of(folder / TASK.name) else ""
    place = folder.name if folder.is_absolute() else folder
    load = f'policy = stlbench.Solution.load("{place}"{trusted}).policy'
    loop = f"for t in range({task.file.steps}):"
    if isinstance(task.dynamics, GymTask):
        given = "".join(f", {name}={value!r}" for name, value in problem.keywords.items())
        entry = task.file.environment
        made = f'gymnasium.make("{entry.id}"{given})' if entry and entry.id else "policy.task.dynamics.make()"
        return [
            "import gymnasium, stlbench",
            f"{load}",
            f"env = {made}",
            "observation, info = env.reset(seed=1)",
            loop,
            "    observation, _, terminated, truncated, info = env.step(policy(observation, t, info))",
            "    if terminated or truncated:",
            "        break",
        ]
    return [
        "import stlbench",
        load,
        "system, (state, *_) = policy.task.system, policy.task.starts.report_and_selection()[0]",
        loop,
        "    state = system.step(state[None], policy(state, t)[None])[0]",
    ]
