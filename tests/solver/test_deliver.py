"""The files of a solution: nothing of an earlier policy stays, and each sentence is true."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from helpers.line_task import line
from solver.conftest import FORMULA, POINT
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.result import MAIN, Result
from stlbench.registry import plugins
from stlbench.solver.deliver import Delivery, _environment, sentence
from stlbench.solver.problem import Problem
from stlbench.solver.run import _is_delivered
from stlbench.solver.trainer import Clock
from stlbench.solver.workspace import workspace_of
from stlbench.study.results import Results
from stlbench.study.run import run_study

PROBLEM = Problem("CartPole-v1", FORMULA)
STALE = ("film.gif", "page.html", "policy.onnx", "counterexample/counterexample-old.png")


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder whose race has one policy, and that has files of an earlier one."""
    folder = tmp_path_factory.mktemp("trained") / "my own"
    workspace = workspace_of(PROBLEM, folder)
    workspace.budget("probe", steps=640, seeds=1, deadline=300.0, checkpoints=1, random_starts=0)
    study = {"tasks": [workspace.task.choice], "methods": ["raw"], "seeds": [0], "budget": "probe", "track": "auto"}
    run_study(**study, results=folder / "race", jobs=1)
    for name in STALE:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("of an earlier policy")
    return folder


def delivery(trained: Path, interrupted: bool) -> Delivery:
    """Of a copy, where no time is left."""
    plugins._ADDED["tasks"].pop("task", None)
    shutil.copytree(trained, "my own")
    workspace, best = workspace_of(PROBLEM, Path("my own")), [*Results.load("my own/race")]
    return Delivery(workspace, PROBLEM, Clock(0.0), 0.95, best, interrupted)


@pytest.mark.parametrize("interrupted", [True, False])
def test_nothing_of_an_earlier_policy_is_shown(
    trained: Path, interrupted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stlbench.solver.deliver.export", lambda *given: None)
    facts = delivery(trained, interrupted).write()
    assert not [name for name in STALE if Path("my own", name).exists()]
    assert not Path("my own/counterexample").exists()
    assert json.loads(Path("my own/certificate.json").read_text()) == facts
    text = Path("my own/solution.md").read_text()
    assert text.partition("## Files")[2].split() == [
        word for name in ("certificate.json", "policy.npz", "race", "solve.json", "task") for word in ("-", f"`{name}`")
    ]


def test_earlier_counterexamples_are_not_removed_through_a_link(trained: Path) -> None:
    given = delivery(trained, True)
    Path("my own/counterexample").rename("elsewhere")
    Path("my own/counterexample").symlink_to(Path("elsewhere").absolute())
    with pytest.raises(UsageError, match="my own/counterexample is a link, and stlbench writes through none"):
        given.write()
    assert [path.name for path in Path("elsewhere").iterdir()] == ["counterexample-old.png"]


def test_an_interrupt_of_the_search_loses_no_earlier_solution(trained: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*given: Any) -> None:
        raise KeyboardInterrupt

    given = replace(delivery(trained, False), clock=Clock(1.0))
    monkeypatch.setattr("stlbench.solver.deliver.falsify", interrupted)
    with pytest.raises(KeyboardInterrupt):
        given.write()
    assert [name for name in STALE if Path("my own", name).exists()] == [*STALE]


def test_the_commands_for_what_is_left_out_work(trained: Path) -> None:
    parts, given = {"a counterexample": "--evaluations 1", "the film": "--format png", "the page": ""}, None
    given = delivery(trained, False)
    for what, cheaper in parts.items():
        said = re.fullmatch(
            rf"no time was left for {what}; `stlbench (.*)` (makes it|searches one)", given._left_out(what)
        )
        assert said is not None
        done = CliRunner().invoke(app, shlex.split(said[1].replace("--html", "") + f" {cheaper}"))
        assert done.exit_code == 0, done.output
    assert "--html" in given._left_out("the page")


@pytest.mark.usefixtures("made")
def test_they_find_a_module_in_the_working_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = workspace_of(Problem(POINT, "G[0,9] far <= 1"), Path("out"))
    monkeypatch.setattr(sys.modules["zz_made"], "__file__", str(Path("zz_made.py").absolute()))
    best = cast(Any, SimpleNamespace(id=CellId("task", "raw", "td3", 0, "probe")))
    given = Delivery(workspace, PROBLEM, Clock(0.0), 0.95, [best])
    assert "; `PYTHONPATH=. stlbench render out/race task/raw/td3/0 --budget probe" in given._left_out("the film")


def test_what_an_interrupt_left_out_is_not_for_want_of_time(trained: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stlbench.solver.deliver.export", lambda *given: None)
    delivery(trained, True).write()
    text = Path("my own/solution.md").read_text()
    assert "no time was left" not in text
    assert "interrupted before the film; `stlbench render" in text
    assert "The policy is from the race: it was interrupted then." in text


def test_a_confidence_is_not_rounded_to_certainty() -> None:
    facts = {"low": 0.99, "satisfied": 1000, "starts": 1000}
    assert ", 99.99999 % confidence" in sentence(facts | {"confidence": 0.9999999})
    assert ", 57 % confidence" in sentence(facts | {"confidence": 0.57})


def test_what_rests_on_the_last_sample_is_said() -> None:
    facts = {"low": 0.99, "satisfied": 1000, "starts": 1000, "confidence": 0.95}
    assert "last sample" not in sentence(facts)
    assert "last sample" not in sentence(facts | {"held": 0})
    assert sentence(facts | {"held": 7}).endswith("7 of these rest on the last sample, which stays after an early end.")


def test_a_certificate_names_the_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "my-line"
    home.mkdir()
    (home / "task.yaml").write_text("title: a line\n")
    monkeypatch.chdir(home)
    names = [_environment(line(), Problem(name, None)) for name in (".", "suite:unicycle/sequence/3", "hold-disc")]
    plugins._ADDED["tasks"].pop("my-line", None)
    assert names == ["my-line", "suite-unicycle-sequence-3", "hold-disc"]


def test_a_folder_of_the_user_may_be_called_task(tmp_path: Path, trained: Path) -> None:
    """As that of the solution is, which is registered by then."""
    home = tmp_path / "mine" / "task"
    home.mkdir(parents=True)
    (home / "task.yaml").write_text("title: a line\n")
    workspace_of(PROBLEM, trained)
    assert _environment(line(), Problem(str(home), None)) == "task"


def made(budget: str, share: float) -> Result:
    """A policy that satisfies from such a share of the starts for selection, chosen at the end of its training."""
    scores = {MAIN: SimpleNamespace(ended_early=0)}
    selection = SimpleNamespace(satisfaction=share, robustness_mean=0.1)
    measured = SimpleNamespace(selection=selection, selected_steps=5000, env_steps=5000, selected=scores)
    cell = CellId.parse("task/raw/dqn/200/auto", budget)
    return cast(Result, SimpleNamespace(id=cell, key="k", measurement=measured))


def test_what_was_compared_is_said_alone() -> None:
    """An interrupted training was not compared from further starts; one of equal share was no better."""
    final, more = made("final", 1.0), made("more-1", 1.0)
    said = [*Delivery._comparison(cast(Any, SimpleNamespace(trained=[more, final], best=more, interrupted=False)))]
    assert said[1:] == ["It was trained on, after the policies before it."]


@pytest.mark.parametrize(("share", "improving"), [(1.0, False), (0.9, True)])
def test_a_policy_that_satisfied_from_all_starts_for_selection_was_not_stopped(share: float, improving: bool) -> None:
    file = SimpleNamespace(terminated="hold")
    workspace = SimpleNamespace(task=SimpleNamespace(file=file, formula="F"))
    given = cast(Any, SimpleNamespace(best=made("probe", share), workspace=workspace, clock=Clock(10.0)))
    assert ("still improving" in Delivery._suggestions(given, "")[0]) == improving


WHOLE = {"cell": "a", "budget": "b", "key": "k", "interrupted": False, "confidence": 0.95}
WHOLE |= {"satisfied": 1, "starts": 1, "low": 0.1, "probability": 1.0}


@pytest.mark.parametrize(
    "text", ["[]", "3", "{}", '{"cell": "a", "budget": "b"}', '{"cell": "a", "budget": "b", "key": "k"}']
)
def test_a_certificate_of_another_shape_is_written_again(text: str) -> None:
    Path("solution.md").write_text("learned")
    Path("certificate.json").write_text(text)
    assert not _is_delivered(Path(), made("probe", 1.0), 0.95)


def test_a_solution_is_delivered_with_its_text() -> None:
    Path("certificate.json").write_text(json.dumps(WHOLE))
    assert not _is_delivered(Path(), made("probe", 1.0), 0.95)
    Path("solution.md").write_text("learned")
    assert _is_delivered(Path(), made("probe", 1.0), 0.95)
    assert not _is_delivered(Path(), made("probe", 1.0), 0.9)
