"""A problem becomes a task: its folder, its file, its signals, and what is known of it before any training."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import pytest
import yaml
from helpers.line_task import line
from solver.conftest import FORMULA, POINT

from stlbench import stl
from stlbench.cli.show_task import _schedule
from stlbench.contract import ActionGrid
from stlbench.errors import UsageError
from stlbench.simulation.baselines import in_pieces, replay
from stlbench.solver.problem import Problem, _expression, code_beside, content_of
from stlbench.solver.run import _folder, _identified
from stlbench.solver.solution import Acting
from stlbench.solver.tries import Nearest, check_speed, of_course
from stlbench.solver.workspace import workspace_of
from stlbench.task import load_task
from stlbench.task.gym_sketch import sketch
from stlbench.task.reading import dump_yaml, load_yaml
from stlbench.tracks.auto import automatic

EXAMPLE = Path(__file__).parents[2] / "examples" / "gym-pendulum" / "task.yaml"


def test_each_problem_has_a_folder_of_its_own() -> None:
    first, second = Problem("CartPole-v1", FORMULA), Problem("CartPole-v1", "G[0,20] abs(x) <= 1")
    workspace_of(first, _folder(first))
    assert _folder(first) == Path("solved/cartpole-v1")
    assert _folder(second) == Path("solved/cartpole-v1-2")
    with pytest.raises(UsageError, match="solved/cartpole-v1 has another problem, CartPole-v1 G"):
        workspace_of(second, _folder(first))


@pytest.mark.parametrize("name", [".", "..", "./任务"])
def test_a_problem_without_letters_has_a_folder_too(name: str) -> None:
    assert _folder(Problem(name, None)) == Path("solved/task")


def test_code_beside_a_task_is_copied_as_it_is() -> None:
    home = Path("two-parts")
    (home / "parts.py").mkdir(parents=True)
    (home / "task.yaml").write_bytes(EXAMPLE.read_bytes())
    (home / "notes.py").write_bytes(b"# -*- coding: latin-1 -*-\r\nname = '\xe9'\n")
    assert code_beside(Problem("./two-parts", None)) == {"notes.py": (home / "notes.py").read_bytes()}


@pytest.mark.parametrize("text", ["obs[1][0]", "obs[1][77]", "obs[x]", "obs[²]", "obs[٣]"])
def test_an_array_has_one_index_of_ascii_digits(text: str) -> None:
    with pytest.raises(
        UsageError, match=re.escape(f"signal z: there is no {text}; the observation has obs[0] to obs[3]")
    ):
        _expression("z", text, ["a", "b", "c", "d"])
    assert _expression("z", "obs[3] + obs[0]", ["a", "b", "c", "d"]) == "d + a"
    assert _expression("z", "obs[g][1] + obs[g]", {"g": ["g0", "g1"]}) == "g1 + g0"


def test_the_task_file_of_an_environment() -> None:
    signals = {"theta": "atan2(obs[1], obs[0])"}
    workspace = workspace_of(
        Problem("Pendulum-v1", "G[2,5] abs(theta) <= 0.2 & F[0,10] omega > 1", signals, "seconds"), Path("out")
    )
    content = yaml.safe_load(Path("out/task/task.yaml").read_text())
    assert content["environment"] == {"id": "Pendulum-v1", "names": ["x", "y", "omega"]}
    assert (content["steps"], content["hold"], content["sampling_time"]) == (200, 1, 0.05)
    assert content["formula"] == "G[40,100] abs(theta) <= 0.2 & F[0,200] omega > 1"
    assert content["terminated"] == "hold"
    assert content["signals"]["theta"] == {"low": -3.142, "high": 3.142, "expression": "atan2(y, x)"}
    assert content["signals"]["omega"] == {"low": -8.0, "high": 8.0}
    notes = ("a step is 0.05 s, by the environment's dt",)
    assert workspace.notes == notes
    note = workspace.search(600)
    assert re.match("no witness was found: [0-9]+ episodes of held actions", str(note))
    assert (workspace.notes, workspace.doubts, workspace.search(600)) == (notes, (note,), None)
    long = workspace_of(Problem("MountainCarContinuous-v0", "F position >= 0.45"), Path("other"))
    assert (long.task.file.steps, long.task.file.hold) == (1000, 5)


@pytest.mark.usefixtures("made")
def test_signals_from_the_info() -> None:
    workspace_of(
        Problem(POINT, "F[0,9] reached > 0.5 | G[0,9] near <= 1", {"near": "far + abs(obs[goal])"}), Path("out")
    )
    content = yaml.safe_load(Path("out/task/task.yaml").read_text())
    assert content["signals"]["reached"] == {"low": 0.0, "high": 1.0}
    near = content["signals"]["near"]
    assert (near["expression"], near["low"]) == ("far + abs(goal)", 0.0)
    assert 3 < near["high"] <= 11


@pytest.mark.usefixtures("made")
def test_a_policy_asks_for_the_info_that_signals_need() -> None:
    task = workspace_of(Problem(POINT, "F[0,9] far <= 0.1"), Path("out")).task
    observation, _ = gymnasium.make(POINT).reset(seed=0)
    acting = Acting(cast(Any, (task, None, None)))
    with pytest.raises(
        UsageError, match=r"^signals: 'far' is an entry of the info; pass .*, policy\(obs.*, t, info\)$"
    ):
        acting(observation, 0)
    with pytest.raises(UsageError, match=r"no 'far': the observation has .*, the info nothing"):
        acting(observation, 0, {})


@pytest.mark.usefixtures("made")
def test_words_in_an_observation_are_left_out() -> None:
    workspace = workspace_of(Problem("zz_made:Talker-v0", "F[0,9] abs(place) <= 0.1"), Path("out"))
    assert workspace.task.source.observed.size == 1
    assert workspace.task.source.observed.flat({"place": np.array([0.5]), "word": "go"}).tolist() == [0.5]


@pytest.mark.parametrize(
    ("by", "plain"),
    [
        (np.float64(5.0), 5.0),
        (np.bool_(True), True),
        (np.array([[1, 2]], np.float32), [[1.0, 2.0]]),
        ({"low": (np.int64(1), None)}, {"low": [1, None]}),
    ],
)
@pytest.mark.usefixtures("made")
def test_numbers_of_numpy_are_plain_in_a_task_file(by: object, plain: object) -> None:
    identifier, keywords = _identified(gymnasium.make("zz_made:Moved-v0", by=by))
    assert repr(keywords) == repr({"by": plain})
    content = content_of(Problem(identifier, "G[0,9] place0 <= 1", keywords=keywords))
    assert load_yaml(dump_yaml(content), "it")["environment"]["kwargs"] == keywords


@pytest.mark.parametrize("by", [np.float32, np.dtype("float32"), {1}, {1: 2}, len, 1j, np.longdouble(1)])
@pytest.mark.usefixtures("made")
def test_an_argument_that_no_task_file_has_is_named(by: object) -> None:
    rule = "a task file has numbers, texts, and lists and mappings of them; trainings make it anew"
    with pytest.raises(UsageError, match=rf"^the environment's argument by is [^\n]+, {rule}"):
        _identified(gymnasium.make("zz_made:Moved-v0", by=by))


@pytest.mark.parametrize(
    ("keywords", "formula", "said"),
    [
        ({"dt": 1}, "F[0,2] ", "a step is 1 s, by the environment's dt"),
        ({"dt": 0.5, "fps": 10}, "F[0,4] ", "a step is 0.5 s, by the environment's dt"),
        ({"fps": 10}, "F[0,20] ", "a step is 0.1 s, by the environment's render_fps of 10"),
        ({"dt": True, "fps": 10}, "F[0,20] ", "a step is 0.1 s, by the environment's render_fps of 10"),
    ],
)
@pytest.mark.usefixtures("made")
def test_seconds_are_steps_of_the_environment(keywords: dict[str, float], formula: str, said: str) -> None:
    content = content_of(Problem("zz_made:Timed-v0", "F[0,2] place0 >= 1", time="seconds", keywords=keywords))
    assert content["formula"].startswith(formula)
    assert content["notes"] == said


@pytest.mark.parametrize("dt", [1, np.int64(1), np.float32(0.5)])
@pytest.mark.usefixtures("made")
def test_a_step_of_any_real_number_counts(dt: float) -> None:
    assert sketch("zz_made:Timed-v0", {"dt": dt})["sampling_time"] == float(dt)


@pytest.mark.parametrize("keywords", [{}, {"dt": 0}, {"dt": -1.0}, {"dt": "1"}])
@pytest.mark.usefixtures("made")
def test_seconds_are_refused_where_the_environment_says_none(keywords: dict[str, Any]) -> None:
    problem = Problem("zz_made:Timed-v0", "F[0,1] place0 >= 1", time="seconds", keywords=keywords)
    with pytest.raises(
        UsageError, match=r"^environment zz_made:Timed-v0 does not say the seconds of a step, .* `dt = "
    ):
        content_of(problem)
    assert content_of(Problem(**vars(problem) | {"time": "steps"}))["formula"].startswith("F[0,1] ")


@pytest.mark.usefixtures("made")
def test_a_witness_is_kept_and_satisfies() -> None:
    workspace = workspace_of(Problem(POINT, "F[0,29] abs(place0) <= 0.1"), Path("out"))
    assert "a witness exists" in str(workspace.search(600))
    found = json.loads(Path("out/witness.json").read_text())
    env = gymnasium.make(POINT)
    place = env.reset(seed=int(found["start"][0]))[0]["place"][0]
    nearest = abs(place)
    for step in range(29):
        action = found["actions"][step * len(found["actions"]) // 29]
        nearest = min(nearest, abs(float(env.step(np.array(action))[0]["place"][0])))
    assert nearest <= 0.1
    assert found["robustness"] == pytest.approx(0.1 - nearest, abs=1e-6)


@pytest.mark.usefixtures("made")
def test_witnesses_give_a_schedule_that_they_satisfy() -> None:
    formula = "F[0,15] (x >= 0.5 & F[0,14] x <= 0)"
    workspace = workspace_of(Problem(POINT, formula, {"x": "obs[place][0]"}), Path("out"))
    assert "a witness exists" in str(workspace.search(600))
    schedule = workspace.task.file.schedules["witness"]
    assert [str(choice) for choice in workspace.choices] == ["task[schedule=witness]", "task"]
    assert load_task(workspace.choices[0]).file.followed == schedule != workspace.task.file.followed
    task, found = workspace.task, json.loads(Path("out/witness.json").read_text())
    actions = np.array(found["actions"])[in_pieces(task.file.decisions, len(found["actions"]))]
    trace = replay(task, actions[None], np.array([found["start"]])).traces
    assert stl.satisfied(schedule, trace, task.signals).all()


@pytest.mark.usefixtures("made")
def test_what_is_too_fast_is_told() -> None:
    """The point goes at most 0.1 in a step: it takes at least 5 from the one place to the other."""
    signals, here, there = {"x": "obs[place][0]"}, "x >= 0.5 & x <= 0.7", "x >= -0.2 & x <= 0"
    slow = workspace_of(Problem(POINT, f"F[0,10] ({here}) & F[10,30] ({there})", signals), Path("slow"))
    assert not [note for note in slow.doubts if "too fast" in note]
    fast = workspace_of(Problem(POINT, f"F[9,10] ({here}) & F[11,12] ({there})", signals), Path("fast"))
    (note,) = (note for note in fast.doubts if "too fast" in note)
    ends = f"from '{here}' in 9..10 to '{there}' in 11..12"
    found = re.fullmatch(
        rf"perhaps too fast: {re.escape(ends)}; with actions held at random such a way takes (\d+) steps more", note
    )
    assert found is not None, note
    assert 2 <= int(found[1]) <= 8


def test_what_is_trivial_or_impossible_is_told() -> None:
    trivial = workspace_of(Problem("Pendulum-v1", "G[0,5] abs(omega) <= 8.5"), Path("out"))
    assert trivial.notes[0].partition(" %")[0] == "trivial: by the action zero 100"
    doubtful = workspace_of(Problem("CartPole-v1", "F[0,5] v >= 20"), Path("other"))
    reason = "impossible, if the ranges that random actions show are right: 'v >= 20' never holds: v is from"
    assert doubtful.doubts[0].startswith(reason)
    assert "no witness was found" in str(doubtful.search(60))


@pytest.mark.parametrize(("speed", "told"), [(1.0, "one fixed sequence of actions 100 % of the starts"), (-1.0, None)])
def test_a_fixed_sequence_that_suffices_is_told(speed: float, told: str | None) -> None:
    task = line(formula="F[0,8] x >= 1")
    assert isinstance(task.actions, ActionGrid)
    action = task.actions.nearest(np.array([[speed]]))
    found = of_course(task, Nearest(0.1, 1, ((speed,),), np.empty((9, 1)), action[None]))
    assert told in str(found) if told else found is None


@pytest.mark.usefixtures("made")
def test_an_environment_that_ignores_seeds_is_told() -> None:
    forgetful = workspace_of(Problem("zz_made:Forgetful-v0", "F[0,9] abs(place0) <= 0.1"), Path("out"))
    assert forgetful.notes == (
        "the environment ignores seeds: no episode can be repeated, so no counterexample is searched",
    )
    assert not forgetful.state["repeatable"]
    assert workspace_of(Problem(POINT, "F[0,9] abs(place0) <= 0.1"), Path("other")).state["repeatable"]


def test_a_formula_may_look_one_step_ahead() -> None:
    assert workspace_of(Problem("Pendulum-v1", "F[0,1] x >= 0.5"), Path("out")).task.file.steps == 1


@pytest.mark.usefixtures("made")
def test_a_slow_environment_is_played_for_the_seconds_alone() -> None:
    sluggish = importlib.import_module("zz_made").Sluggish
    before = sluggish.taken
    sketch("zz_made:Sluggish-v0", {}, 0.0)
    assert sluggish.taken - before == 20


def test_how_long_a_slow_environment_takes_is_said_before_the_first_look() -> None:
    task, said = load_task("reach-stay"), list[str]()
    each = task.file.steps
    check_speed(task, 0.0001 * each, 10, said.append)
    assert said == []
    check_speed(task, 0.1 * each, 1000, said.append)
    assert said == ["a step of the environment takes 100 ms, so the first look takes about 2 h 26 min"]
    with pytest.raises(UsageError, match=r"^10 minutes are too short: a step of the environment takes 100 ms; about"):
        check_speed(task, 0.1 * each, 10, said.append)


@pytest.mark.parametrize(
    ("environment", "formula", "steps"),
    [
        ("Pendulum-v1", "F[0,0.5] x >= 0.9", "F[0,10] x >= 0.9"),
        ("MountainCar-v0", "F[0,2] position >= 0", "F[0,60] position >= 0"),  # 30 steps a second
        ("MountainCar-v0", "F[0.1,0.5] position >= 0", "F[3,15] position >= 0"),
    ],
)
def test_seconds_may_be_fractions_and_a_rate_may_be_no_round_number(environment: str, formula: str, steps: str) -> None:
    assert content_of(Problem(environment, formula, time="seconds"))["formula"] == steps


def test_arguments_stay_what_they_are_in_the_file_of_a_problem(tmp_path: Path) -> None:
    given = {"healthy_z_range": [0.2, float("inf")], "reset_noise_scale": {1: "1e3"}}
    environment = {"id": "Hopper-v5", "kwargs": given, "names": ["z", *(f"o{place}" for place in range(10))]}
    signals, home = {"z": {"low": 0, "high": 2}}, tmp_path / "hopper-kwargs"
    home.mkdir()
    content = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8")) | {"environment": environment, "signals": signals}
    (home / "task.yaml").write_text(dump_yaml(content | {"formula": "G[0,5] z >= 0.5", "plane": None}))
    written = dump_yaml(content_of(Problem(str(home), None)))
    assert load_yaml(written, "here")["environment"]["kwargs"] == given


def test_schedules_by_hand_are_left_out(tmp_path: Path) -> None:
    """They are of the task's own formula, and the track derives one of the formula that is solved."""
    text = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    text["schedule"], text["schedules"] = "G[0,5] abs(theta) <= 3", {"late": "G[3,5] abs(theta) <= 3"}
    home = tmp_path / "by-hand"
    home.mkdir()
    (home / "task.yaml").write_text(yaml.safe_dump(text))
    content = content_of(Problem(str(home), "F[0,50] abs(theta) <= 0.5"))
    assert not {"schedule", "schedules"} & content.keys()
    assert load_task(str(home)).file.schedules["late"] == stl.parse("G[3,5] abs(theta) <= 3")


def test_a_schedule_by_hand_is_shown_where_none_is_derived(tmp_path: Path) -> None:
    text = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    text |= {"formula": "G[0,190] F[0,5] omega >= 0", "schedules": {"late": "G[5,195] omega >= 0"}}
    text["signals"]["omega"] = {"low": -8, "high": 8}
    home = tmp_path / "recurring"
    home.mkdir()
    (home / "task.yaml").write_text(yaml.safe_dump(text))
    own, late = (automatic(load_task(f"{home}{choice}"), "td3") for choice in ("", "[schedule=late]"))
    assert "visits" in str(_schedule(own))
    shown = _schedule(late)
    assert isinstance(shown, dict)
    assert [(window["begin"], window["end"]) for window in shown["windows"]] == [(5, 195)]
