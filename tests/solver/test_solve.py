"""`stlbench solve` with tiny budgets: bad input, a whole solution, and the same call again."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import RescaleAction, TimeLimit
from helpers.pages import Page
from solver.conftest import FORMULA, POINT
from typer.testing import CliRunner

import stlbench
from stlbench.cli import app
from stlbench.errors import UsageError
from stlbench.simulation import referee
from stlbench.solver.contestants import Contestant, rank
from stlbench.solver.deliver import Delivery, sentence
from stlbench.solver.earlier import EarlierPolicy
from stlbench.solver.outlook import outlook
from stlbench.solver.problem import Problem
from stlbench.solver.run import _identified
from stlbench.solver.solution import Solution
from stlbench.solver.workspace import workspace_of
from stlbench.study.results import Results
from stlbench.study.run import run_study

HARD = "G[0,20] abs(theta) <= 0.04"
"""A fifth of the starts violate it at once, so that no training satisfies from all starts."""

DISTANCE = {"d": "abs(obs[place][0] - obs[goal])"}


def test_no_training_waits_for_matplotlib() -> None:
    loaded = "import sys, stlbench.solver.run; assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", loaded], check=True)


def say(*words: str) -> Any:
    return CliRunner().invoke(app, ["solve", *words, "--into", "out"])


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["CartPol-v1", FORMULA], "did you mean 'CartPole-v1'"),
        (["CartPole-v1", FORMULA, "--signal", "z=1"], "signal z is constant, 1;"),
        ([POINT, "G[0,9] height <= 1"], "signal height is constant, 0.5 in 16 episodes"),
        ([POINT, "G[0,9] steady <= 1"], "signal steady is constant, 3 in 16 episodes"),
        ([POINT, "G[0,9] fra <= 1"], "no signal 'fra'; did you mean 'far'"),
        (["CartPole-v1", "G[0,600] x <= 1"], "looks 600 steps ahead, and an episode of CartPole-v1 has 500"),
        (["zz_space/Nothing-v5", FORMULA], "environment zz_space/Nothing-v5 cannot be made"),
        (["CartPole", FORMULA], "no environment 'CartPole'; did you mean 'CartPole-v1'?"),
        (["CartPole-v99", FORMULA], "no environment 'CartPole-v99'; did you mean 'CartPole-v1'?"),
        (["zz_made:Quiter", "G[0,9] o0 <= 1"], "no environment 'zz_made:Quiter'; did you mean 'zz_made:Quitter-v0'?"),
        (["zz_made:Unseeded-v0", "G[0,9] far <= 1"], "reset takes a seed and options, `def reset(self, *, seed=None"),
        (["zz_made:Failing-v0", "G[0,9] place0 <= 1"], "Failing-v0 cannot be played: RuntimeError: motor is off"),
        (["CartPole-v1", FORMULA, "--signal", "z=x", "--signal", "z=theta"], "--signal z is given twice: x, and theta"),
        (["zz_space/nothing"], "there is no such folder"),
        (["zz_made:Quitter-v0", "G[0,9] o0 <= 1"], "the environment ends at once"),
        (
            ["zz_made:Sluggish-v0", "G[0,29] place0 <= 1", "--minutes", "0.1"],
            "0.1 minutes are too short: a step of the environment takes 2",
        ),
        (["CartPole-v1", "F[0,20] x >= 2", "--minutes", "0.0001"], "minutes are too short"),
        (["CartPole-v1", "F[0,20] x >= 2", "--seed", "-1"], "seed should be a whole number from 0 to 9, got -1"),
        (["CartPole-v1", "F[0,20] x >= 2", "--seed", "10"], "seed should be a whole number from 0 to 9, got 10"),
        (["CartPole-v1", FORMULA, "--minutes", "inf"], "minutes should be more than 0 and finite, got inf"),
        (["CartPole-v1", "G[0,20] abs(thta) <= 1"], "no signal 'thta'; did you mean 'theta'"),
        (["CartPole-v1", FORMULA, "--signal", "z=obs[4]"], "the observation has obs[0] to obs[3]"),
        (
            ["CartPole-v1", FORMULA, "--signal", "z=obs[1][2]"],
            "there is no obs[1][2]; the observation has obs[0] to obs",
        ),
        (["CartPole-v1", FORMULA, "--signal", "z=obs[²]"], "there is no obs[²]; the observation has obs[0] to obs[3]"),
        (["CartPole-v1", FORMULA, "--signal", "z"], "expected NAME=EXPRESSION"),
        (["CartPole-v1"], "has no formula of its own"),
        (
            ["hold-disk"],
            "hold-disk is no task, and an environment has no formula of its own; give one; did you mean 'h",
        ),
        (["hold-disc", "--signal", "z=x"], "is a task with its own signals"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.usefixtures("made")
def test_bad_input_is_one_line(words: list[str], problem: str) -> None:
    done = say(*words)
    assert done.exit_code == 2, done.output
    (error,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert problem in error
    assert done.stderr.splitlines()[-1] == error
    assert not Path("out/certificate.json").exists()


def test_a_formula_that_cannot_be_read_has_a_caret_below_the_place() -> None:
    assert say("CartPole-v1", "G[0,20 x").stderr.splitlines()[-2:] == ["    G[0,20 x", "           ^"]
    wrong = say("CartPole-v1", FORMULA, "--signal", "z=x +* 2").stderr.splitlines()
    assert wrong[-2:] == ["    x +* 2", "       ^"]


@pytest.mark.parametrize(
    ("environment", "options", "problem"),
    [
        (
            gymnasium.Env,
            {},
            r"environment should be an id or an environment, got <class 'gymnasium.core.Env'>; trainings",
        ),
        ("CartPole-v1", {"signals": "z=x"}, r"""signals should be a dict, {"theta": "atan2\(y, x\)"}, got 'z=x'"""),
        (
            "CartPole-v1",
            {"signals": {"z": 1.5}},
            "signal z should be an expression, or the number of an entry, got 1.5",
        ),
        ("CartPole-v1", {"minutes": "3"}, "minutes should be more than 0 and finite, got '3'"),
        ("CartPole-v1", {"confidence": "high"}, "a confidence is between 0 and 1, got 'high'"),
        ("CartPole-v1", {"time": "hours"}, "time: unknown 'hours'; there are: seconds, steps"),
        ("CartPole-v1", {"terminated": "violate"}, "terminated: unknown 'violate'; did you mean 'violated'"),
    ],
)
def test_bad_input_in_python(environment: Any, options: dict[str, Any], problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        stlbench.solve(environment, FORMULA, into="out", **options)


class Hidden(gymnasium.Wrapper[Any, Any, Any, Any]):
    """A layer that records no arguments."""


PENDULUM = gymnasium.make("Pendulum-v1")
SHORT = gymnasium.make("Pendulum-v1", max_episode_steps=150)
OTHER = gymnasium.make(EnvSpec("Pendulum-v1", "gymnasium.envs.classic_control:CartPoleEnv"))


@pytest.mark.parametrize(
    ("environment", "problem"),
    [
        (SHORT, "its time limit should be 200, got 150"),
        (TimeLimit(SHORT, 200), "its layers should be TimeLimit, PendulumEnv, got TimeLimit, TimeLimit, PendulumEnv"),
        (RescaleAction(PENDULUM, -1, 1), "its layers .*, got RescaleAction, TimeLimit, PendulumEnv;"),
        (Hidden(PENDULUM), "its layers .*, got Hidden, TimeLimit, PendulumEnv;"),
        (OTHER, "got CartPoleEnv"),
    ],
)
def test_an_environment_that_is_not_as_registered_is_refused(environment: Any, problem: str) -> None:
    rule = r"trainings make it anew: register it so in a module, `gymnasium.register\(.*\)`, and name it"
    with pytest.raises(UsageError, match=rf"^the environment is not Pendulum-v1 as registered: .*{problem}.*; {rule}"):
        stlbench.solve(environment, FORMULA, into="out")


@pytest.mark.usefixtures("made")
def test_one_that_is_as_registered_has_an_id() -> None:
    for keywords in ({"render_mode": "rgb_array_list"}, {"disable_env_checker": True}):
        assert _identified(gymnasium.make("Pendulum-v1", **keywords)) == ("Pendulum-v1", {})
    assert _identified(gymnasium.make("Pendulum-v1", g=5.0)) == ("Pendulum-v1", {"g": 5.0})
    assert _identified(gymnasium.make("zz_made:Layered-v0")) == ("zz_made:Layered-v0", {})
    assert _identified(gymnasium.make("shimmy:dm_control/cartpole-balance-v0"))[1] == {}


def test_what_draws_does_not_complain_of_a_missing_display(tmp_path: Path) -> None:
    look = "import gymnasium, pygame; from stlbench.task.gym_make import made; made('CartPole-v1', {}); pygame.init()"
    env = {name: value for name, value in os.environ.items() if name not in ("XDG_RUNTIME_DIR", "DISPLAY")}
    done = subprocess.run([sys.executable, "-c", look], env=env, capture_output=True, text=True, check=True)
    assert "XDG_RUNTIME_DIR" not in done.stderr


@pytest.fixture(autouse=True)
def without_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes a share of the minutes, whatever the budgets are. test_race.py has its rules."""
    monkeypatch.setattr("stlbench.solver.race._SUM_SHARE", 0.0)


def small(environment: str, formula: str | None, **signals: str) -> None:
    """Pose a problem, and choose methods and budgets of seconds, as a user may who edits the files."""
    workspace = workspace_of(Problem(environment, formula, signals), Path("out"))
    workspace.begin(15.0)
    for name in ("probe", "rung-1", "final"):
        workspace.budget(name, steps=640, seeds=1, deadline=300.0, checkpoints=2, random_starts=0)
    workspace.remember(methods=["funnel", "raw"])


@pytest.mark.parametrize(("probability", "told"), [(0.99, 1), (0.5, 3)])
def test_a_policy_that_satisfies_refutes_the_doubts(probability: float, told: int) -> None:
    workspace = workspace_of(Problem("Pendulum-v1", "F[0,2] x >= 1 & F[3,6] x <= -1", {}), Path("out"))
    assert any("too fast" in doubt for doubt in workspace.doubts)
    workspace.remember(notes=["the environment ignores seeds"], doubts=["too fast", "no witness was found"])
    delivery = cast(Any, SimpleNamespace(workspace=workspace))
    assert len(Delivery._notes(delivery, {"probability": probability})) == told


def test_a_certificate_in_words() -> None:
    facts = {"low": 0.9475, "confidence": 0.95, "satisfied": 961, "starts": 1000}
    said = "It satisfies from at least 94.7 % of the starts, 95 % confidence (961 of 1000 fresh starts)."
    assert sentence(facts) == said
    none = "Not learned: the policy satisfies from none of 1000 fresh starts."
    assert sentence(facts | {"satisfied": 0, "low": 0.0}) == none
    single = {"low": None, "confidence": None, "satisfied": 1, "starts": 1}
    assert sentence(single) == "The task has a single start, from which the policy satisfies."


@pytest.mark.slow
def test_a_whole_solution_and_the_same_call_again(monkeypatch: pytest.MonkeyPatch) -> None:
    small("CartPole-v1", HARD)
    monkeypatch.setattr("stlbench.solver.race.Race._plan_more", lambda *given: False)  # it would take all minutes
    solution = stlbench.solve("CartPole-v1", HARD, minutes=15.0, into="out", jobs=1)
    facts = json.loads(Path("out/certificate.json").read_text())
    assert solution.certificate == facts
    assert facts["confidence"] == 0.95
    assert facts["low"] <= facts["satisfied"] / facts["starts"] <= facts["high"]
    assert (facts["environment"], facts["formula"]) == ("CartPole-v1", HARD)
    race, final = Results.load("out/race"), Results.load("out/final")
    assert {(cell.id.budget, cell.id.seed, str(cell.id.method)) for cell in race} == {
        *(("probe", 100, "funnel"), ("rung-1", 101, "funnel"), ("rung-1", 101, "raw"))
    }
    best = max(race, key=rank)
    assert {(str(cell.id.method), cell.id.seed) for cell in final} == {
        (str(best.id.method), seed) for seed in (200, 201)
    }
    assert facts["cell"] in {max(final, key=rank).id.name, max(race, key=rank).id.name}
    for name in ("policy.npz", "policy.onnx", "page.html", "film.gif", "task/task.yaml"):
        assert Path("out", name).stat().st_size > 100, name
    text = solution.report()
    assert sentence(facts) in text
    page = Page(Path("out/page.html").read_text())
    asked = [
        "Answer",
        sentence(facts),
        "tried",
        "environment",
        "CartPole-v1",
        "formula",
        HARD,
        "an early end",
        "violated",
    ]
    at = page.text.index("Answer Overview")
    for part in asked[1:]:  # in this order; a note above may have one of these words too
        at = page.text.index(part, at)
    assert page.attributes("src")[0].startswith("data:image/gif;base64,")
    assert page.attributes("src")[1].startswith("data:image/png;base64,")
    assert "Retrained with fresh seeds. Share of the selection starts that satisfy: seed 200" in text
    runs = re.search("```python\n(.*?)```", text, re.DOTALL)
    assert runs is not None
    values: dict[str, Any] = {}
    exec(runs[1], values)  # as the text tells the user
    assert values["observation"].shape == (4,)
    monkeypatch.setattr("stlbench.solver.deliver.Delivery.write", lambda self: pytest.fail("was written again"))
    again = stlbench.solve("CartPole-v1", HARD, minutes=15.0, into="out", jobs=1)
    assert again.certificate == facts
    assert len(Results.load("out/race")) == 3


@pytest.mark.slow
def test_an_interrupted_race_delivers_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    small("CartPole-v1", HARD)
    calls = list[str]()

    def interrupted(*args: Any, **options: Any) -> Results:
        calls.append(options["budget"])
        if options["budget"] == "rung-1":
            raise KeyboardInterrupt
        return run_study(*args, **options)

    with monkeypatch.context() as patched:
        patched.setattr("stlbench.solver.trainer.run_study", interrupted)
        done = say("CartPole-v1", HARD, "--minutes", "15", "--jobs", "1")
    assert done.exit_code == 130
    assert "run the same command again to continue" in done.stderr
    assert calls == ["probe", "rung-1"]
    kept = Solution.load("out")
    assert kept.certificate["starts"] == 100
    assert (kept.certificate["budget"], kept.certificate["interrupted"]) == ("probe", True)
    assert "Interrupted: this is the best policy so far. The same command goes on." in kept.report()
    assert Path("out/policy.npz").stat().st_size > 100
    assert not Path("out/film.gif").exists()
    before = [result.provenance for result in Results.load("out/race")]
    monkeypatch.setattr("stlbench.solver.race.Race._plan_more", lambda *given: False)
    whole = stlbench.solve("CartPole-v1", HARD, minutes=15.0, into="out", jobs=1)
    assert not whole.certificate["interrupted"]
    assert "Interrupted" not in whole.report()
    assert before[0] in [result.provenance for result in Results.load("out/race")]


def test_another_solve_starts_from_the_policy_of_a_solution_or_says_why_not() -> None:
    workspace = workspace_of(Problem("CartPole-v1", HARD), Path("out"))
    workspace.budget("probe", steps=640, seeds=1, deadline=300.0, checkpoints=1, random_starts=0)
    study = {"tasks": [workspace.task.choice], "methods": ["raw"], "seeds": [0], "budget": "probe", "track": "auto"}
    (result,) = run_study(**study, results="out/race", jobs=1)
    seen = outlook(Path("out/race"), result, 200)
    assert 20 <= seen.lost <= 60  # theta begins between -0.05 and 0.05, and may not be beyond 0.04
    assert seen.satisfied + seen.lost <= seen.starts == 200
    for words, problem in (
        (["nothing"], "--from nothing: it has no solution; `stlbench solve` writes one"),
        (["out"], "--from out: it has no solution"),
    ):
        done = say("CartPole-v1", FORMULA, "--from", *words)
        assert (done.exit_code, done.stderr.count("\n"), problem in done.stderr) == (2, 1, True), done.stderr
    Path("out/certificate.json").write_text(json.dumps({"cell": result.id.name, "budget": "probe"}))
    start = EarlierPolicy.of(Path("out"))
    assert start.trained_by == Contestant("raw", "dqn")
    start.check(workspace.task)
    (again,) = run_study(**study, init=start.path, results="again", jobs=1)
    assert str(again.id.agent) == f"dqn[init={start.digest[:16]}]"
    assert Contestant.of(again) == start.trained_by
    words = ["Pendulum-v1", "G[0,20] x >= -2", "--from", "out", "--into", "other"]
    done = CliRunner().invoke(app, ["solve", *words])
    assert done.exit_code == 2
    assert done.stderr.splitlines()[-1].startswith("error: --from: its policy was trained with raw and dqn: ")


def test_an_interrupt_before_any_training_delivers_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    small("CartPole-v1", FORMULA)
    monkeypatch.setattr("stlbench.solver.trainer.run_study", interrupt)
    assert say("CartPole-v1", FORMULA, "--minutes", "15", "--jobs", "1").exit_code == 130
    assert not Path("out/certificate.json").exists()
    Path("out/race").mkdir()  # as a run leaves it that was killed before it made its ledger
    done = say("CartPole-v1", FORMULA, "--minutes", "15", "--jobs", "1")
    assert done.exit_code == 130
    assert done.stderr.splitlines()[-1] == "interrupted; run the same command again to continue"


def interrupt(*args: Any, **options: Any) -> Results:
    raise KeyboardInterrupt


def test_other_minutes_have_other_budgets() -> None:
    small("CartPole-v1", FORMULA)
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(2.0)
    assert set(workspace.task.file.budgets) == {"probe"}
    assert workspace.state["methods"] is None


@pytest.mark.usefixtures("made")
@pytest.mark.parametrize(("method", "agent"), [("raw", None), ("flag", None), ("tltl", "cma-es")])
@pytest.mark.parametrize("environment", [POINT, "hold-disc"])
def test_a_policy_acts_as_the_referee_lets_it(environment: str, method: str, agent: str | None) -> None:
    formula = "F[0,16] G[0,8] d <= 0.5" if environment == POINT else None
    workspace = workspace_of(Problem(environment, formula, DISTANCE if environment == POINT else {}), Path("out"))
    workspace.budget(
        "probe", steps=64 * workspace.task.file.hold, seeds=1, deadline=300.0, checkpoints=1, random_starts=0
    )
    agents = agent and [agent]
    study = {"tasks": [workspace.task.choice], "methods": [method], "seeds": [0], "budget": "probe", "track": "auto"}
    (result,) = run_study(**study, agents=agents, results="cells", jobs=1)
    assert result.measurement is not None, result.reason
    loaded = Results.load("cells").policy(result.id)
    start = loaded.task.starts.report_and_selection()[0][:1]
    expected = referee.record(loaded.task, loaded.method, loaded.policy, start).traces[0]
    Path("out/certificate.json").write_text(json.dumps({"cell": result.id.name, "budget": "probe"}))
    Path("cells").rename("out/race")
    with pytest.raises(UsageError, match=r"^out: its task runs .*; if you trust it, load it with run_code=True$"):
        Solution.load("out")
    policy = Solution.load("out", run_code=True).policy
    np.testing.assert_allclose(_played(policy, start), expected, atol=1e-6)
    with pytest.raises(UsageError, match="expected is 0"):
        policy(None, 1)


def _played(policy: Any, start: Any) -> Any:
    """The signals of an episode that a user steps."""
    task, samples = policy.task, []
    if task.file.environment is None:
        state = start[0]
        for t in range(task.file.steps):
            samples.append(task.system.signals(state))
            state = task.system.step(state[None], policy(state, t)[None])[0]
        for t in range(task.file.steps, task.file.steps + 3):  # an episode may be longer than the formula
            assert policy(state, t).shape == (len(task.actions.names),)
        return np.array([*samples, task.system.signals(state)])
    env = gymnasium.make(POINT)
    observation, info = env.reset(seed=int(start[0, 0]))
    for t in range(task.file.steps):
        samples.append(abs(float(observation["place"][0]) - float(observation["goal"][0])))
        observation, _, _, _, info = env.step(policy(observation, t, info))
    return np.array([*samples, abs(float(observation["place"][0]) - float(observation["goal"][0]))])[:, None]


def test_a_training_ends_at_the_first_checkpoint_after_its_seconds() -> None:
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    budget = {"steps": 2560, "seeds": 1, "deadline": 300.0, "checkpoints": 10, "random_starts": 0}
    workspace.budget("probe", **budget, seconds=1e-9)
    study = {"tasks": [workspace.task.choice], "methods": ["raw"], "seeds": [0], "budget": "probe", "track": "auto"}
    (result,) = run_study(**study, results="cells", jobs=1)
    assert result.measurement is not None, result.reason
    assert result.measurement.env_steps == 256
    assert len(result.measurement.curve) == 1
