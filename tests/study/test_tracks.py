"""Tracks: what each makes of a task, and of the keys of its cells."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from helpers.line_task import FILE as LINE
from helpers.line_task import SYSTEM

from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.registry.named_tasks import parse_task
from stlbench.study.cell import Recipe, on_track, read_recipes
from stlbench.study.plan import check_cells, plan_cells
from stlbench.task import load_task
from stlbench.task.file import OPTIONAL

DQN, RAW, FLAG = Choice("dqn"), Choice("raw"), Choice("flag")

FILE = """
recipes:
  robot-nav:
    dqn:
      raw: {agent: {gamma: 0.9}, hold: 20}
      flag: {agent: {gamma: 0.98}}
"""


@pytest.fixture
def recipes(tmp_path: Path):
    """The recipes of a file with this text."""

    def read(text: str = FILE):
        path = tmp_path / "recipes.yaml"
        path.write_text(text)
        return read_recipes(path)

    return read


def cells(track="shared", recipes=None, methods=(RAW, FLAG), task="robot-nav"):
    return plan_cells([Choice(task)], methods, None, [0], "quick", track, recipes)


def test_plain_has_no_part_that_helps_and_no_recipe() -> None:
    task = on_track(load_task("overlap"), DQN, "plain")
    for part in OPTIONAL:
        with pytest.raises(ValueError, match=f"is without {part} as it is"):
            task.file.without(part)
    assert task.recipe("dqn") == {}
    assert task.formula == load_task("overlap").formula
    assert task.file.training.starts == load_task("overlap").file.training.starts


def test_tuned_has_the_method_s_recipe_over_the_shared_one() -> None:
    shared = load_task("robot-nav")
    task = on_track(shared, DQN, "tuned", Recipe({"gamma": 0.9}, hold=20))
    assert task.recipe("dqn") == {**shared.recipe("dqn"), "gamma": 0.9}
    assert (task.file.hold, shared.file.hold) == (20, 10)


def test_each_track_has_keys_of_its_own(recipes) -> None:
    planned = [*cells(), *cells("plain"), *cells("tuned", recipes())]
    assert len({cell.key for cell in planned}) == 6
    assert [cell.id.name for cell in planned[2:4]] == ["robot-nav/raw/dqn/0/plain", "robot-nav/flag/dqn/0/plain"]
    assert {cell.id.track for cell in planned} == {"shared", "plain", "tuned"}


def test_what_a_recipe_says_is_in_the_key_of_its_own_cells_alone(recipes) -> None:
    before = {cell.id.method: cell.key for cell in cells("tuned", recipes())}
    after = {cell.id.method: cell.key for cell in cells("tuned", recipes(FILE.replace("0.98", "0.99")))}
    assert before[RAW] == after[RAW]
    assert before[FLAG] != after[FLAG]


@pytest.mark.parametrize(
    ("text", "methods", "message"),
    [
        (FILE, (Choice("funnel"),), r"recipes\.yaml has no recipe for funnel on robot-nav with dqn"),
        (FILE.replace("gamma: 0.98", "gama: 0.98"), (RAW, FLAG), "no parameter 'gama'; did you mean 'gamma'"),
        (FILE.replace("hold: 20", "hold: 21"), (RAW,), "recipe for robot-nav: steps 2000 is no multiple of hold = 21"),
    ],
)
def test_a_recipe_that_does_not_fit_is_refused_before_anything_runs(recipes, text, methods, message) -> None:
    with pytest.raises(UsageError, match=message):
        check_cells(cells("tuned", recipes(text), methods))


@pytest.mark.parametrize("track", ["shared", "plain", "tuned"])
def test_tuned_alone_needs_recipes_and_has_them(recipes, track) -> None:
    with pytest.raises(UsageError, match="track tuned, and no other, needs a file of recipes"):
        cells(track, None if track == "tuned" else recipes())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "cannot read the recipes"),
        ("- 1", "has the key recipes"),
        ("{}", "has the key recipes"),
        ("recipes: {t: {dqn: {raw: {holds: 2}}}}", "recipes.t.dqn.raw.holds: Unexpected keyword argument"),
        ("recipes: {t: {dqn: {raw: {hold: 0}}}}", "recipes.t.dqn.raw.hold: should be at least 1"),
    ],
)
def test_wrong_files_are_refused_with_the_place(recipes, text, message) -> None:
    with pytest.raises(UsageError, match=message):
        recipes(text)


@pytest.mark.parametrize(
    ("hold", "message"),
    [
        ("10", "the task holds actions for 10 steps as it is"),
        ("7", "steps 2000 is no multiple of hold = 7"),
        ("x", "hold should be a whole number of steps, at least 1, got 'x'"),
    ],
)
def test_a_task_may_be_held_otherwise(hold, message) -> None:
    assert load_task("robot-nav[hold=20]").file.hold == 20
    with pytest.raises(UsageError, match=message):
        load_task(f"robot-nav[hold={hold}]")


def test_a_task_without_a_recipe_has_the_track_auto_unless_another_is_named(tmp_path: Path) -> None:
    (folder := tmp_path / "zz-bare").mkdir()
    (folder / "system.py").write_text(SYSTEM)
    (folder / "task.yaml").write_text(yaml.safe_dump({key: LINE[key] for key in LINE if key != "agents"}))
    choices = [parse_task(str(folder)), Choice("robot-nav")]
    own = plan_cells(choices, [RAW], None, [0], "smoke")
    assert [(cell.id.agent.name, cell.id.track) for cell in own] == [("dqn", "auto"), ("dqn", "shared")]
    named = plan_cells(choices[:1], [RAW], None, [0], "smoke", "plain")
    assert [cell.id.track for cell in named] == ["plain"]
