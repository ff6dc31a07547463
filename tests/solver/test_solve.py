"""`stlbench solve` with tiny budgets: bad input, a whole solution, and the same call again."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stlbench
from stlbench.cli import app
from stlbench.errors import UsageError
from stlbench.rollout import referee
from stlbench.solver.problem import Problem, pose
from stlbench.solver.race import Clock, Trainer, contestants, rank
from stlbench.solver.run import _folder
from stlbench.solver.solution import Solution
from stlbench.study.results import Results
from stlbench.study.run import run_study

FORMULA = "G[0,20] abs(theta) <= 0.15"

ENVIRONMENTS = '''
"""Made-up environments."""
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

class Quitter(gymnasium.Env):
    """Ends at its first step."""
    observation_space, action_space = Box(-1, 1, (2,)), Discrete(2)
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.uniform(-1, 1, 2).astype(np.float32), {}
    def step(self, action):
        return np.zeros(2, np.float32), 0.0, True, False, {}

class Point(gymnasium.Env):
    """A point and its goal, as a Dict. The height never changes."""
    observation_space = Dict({"place": Box(-2, 2, (2,)), "goal": Box(-1, 1, (1,)), "height": Box(0, 1, (1,))})
    action_space = Box(-1, 1, (1,))
    def _seen(self):
        return {"place": self.p.copy(), "goal": self.g, "height": np.full(1, 0.5, np.float32)}
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.p = self.np_random.uniform(-1, 1, 2).astype(np.float32)
        self.g = self.np_random.uniform(-1, 1, 1).astype(np.float32)
        return self._seen(), {}
    def step(self, action):
        self.p[0] = np.clip(self.p[0] + 0.1 * action[0], -2, 2)
        return self._seen(), 0.0, False, False, {}

gymnasium.register("Quitter-v0", Quitter, max_episode_steps=30)
gymnasium.register("Point-v0", Point, max_episode_steps=30)
'''

POINT = "zz_made:Point-v0"
DISTANCE = {"d": "abs(obs[place][0] - obs[goal])"}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments in a module of the working directory."""
    (tmp_path / "zz_made.py").write_text(ENVIRONMENTS)
    monkeypatch.syspath_prepend(str(tmp_path))


def say(*words: str) -> Any:
    return CliRunner().invoke(app, ["solve", *words, "--into", "out"])


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["CartPol-v1", FORMULA], "did you mean 'CartPole-v1'"),
        (["CartPole-v1", FORMULA, "--signal", "z=1"], "signal z is constant, 1;"),
        ([POINT, "G[0,9] height <= 1"], "signal height is constant, 0.5 in 64 episodes"),
        (["CartPole-v1", "G[0,600] x <= 1"], "looks 600 steps ahead, and an episode of CartPole-v1 has 500"),
        (["zz_made:Quitter-v0", "G[0,9] o0 <= 1"], "the environment ends at once"),
        (["CartPole-v1", FORMULA, "--minutes", "0.0001"], "minutes are too short"),
        (["CartPole-v1", "G[0,20] abs(thta) <= 1"], "no signal 'thta'; did you mean 'theta'"),
        (["CartPole-v1", "G[0,20 x"], "formula: line 1, column 8"),
        (["CartPole-v1", FORMULA, "--signal", "z=obs[4]"], "the observation has obs[0] to obs[3]"),
        (["CartPole-v1", FORMULA, "--signal", "z"], "expected NAME=EXPRESSION"),
        (["CartPole-v1"], "has no formula of its own"),
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


def small(environment: str, formula: str | None, **signals: str) -> None:
    """Pose a problem, and choose methods and budgets of seconds, as a user may who edits the files."""
    posed = pose(Problem(environment, formula, signals), Path("out"))
    posed.begin(1.0)
    for name in ("probe", "rung-1", "final"):
        posed.budget(name, steps=640, seeds=1, deadline=300.0, checkpoints=2, random_starts=0)
    posed.remember(methods=["funnel", "raw"])


@pytest.mark.slow
def test_a_whole_solution_and_the_same_call_again(monkeypatch: pytest.MonkeyPatch) -> None:
    small("CartPole-v1", FORMULA)
    solution = stlbench.solve("CartPole-v1", FORMULA, minutes=1.0, into="out", jobs=1)
    facts = json.loads(Path("out/certificate.json").read_text())
    assert solution.certificate == facts
    assert facts["confidence"] == 0.95
    assert facts["low"] <= facts["satisfied"] / facts["starts"] <= facts["high"]
    race, final = Results.load("out/race"), Results.load("out/final")
    assert {(cell.id.budget, cell.id.seed, str(cell.id.method)) for cell in race} == {
        *(("probe", 100, "funnel"), ("rung-1", 101, "funnel"), ("rung-1", 101, "raw"))
    }
    best = max((each for each in race if each.id.budget == "rung-1"), key=rank)
    assert {(str(cell.id.method), cell.id.seed) for cell in final} == {
        (str(best.id.method), seed) for seed in (200, 201)
    }
    assert facts["cell"] == max(final, key=rank).id.name
    for name in ("policy.npz", "policy.onnx", "page.html", "film.gif", "task/task.yaml"):
        assert Path("out", name).stat().st_size > 100, name
    text = solution.report()
    assert "It satisfies from at least" in text
    runs = re.search("```python\n(.*?)```", text, re.DOTALL)
    assert runs is not None
    values: dict[str, Any] = {}
    exec(runs[1], values)  # as the text tells the user
    assert values["observation"].shape == (4,)
    monkeypatch.setattr("stlbench.solver.deliver.Delivery.write", lambda self: pytest.fail("was written again"))
    again = stlbench.solve("CartPole-v1", FORMULA, minutes=1.0, into="out", jobs=1)
    assert again.certificate == facts
    assert len(Results.load("out/race")) == 3


@pytest.mark.slow
def test_an_interrupted_race_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    small("CartPole-v1", FORMULA)
    calls = list[str]()

    def interrupted(*args: Any, **options: Any) -> Results:
        calls.append(options["budget"])
        if options["budget"] == "rung-1":
            raise KeyboardInterrupt
        return run_study(*args, **options)

    with monkeypatch.context() as patched:
        patched.setattr("stlbench.solver.race.run_study", interrupted)
        done = say("CartPole-v1", FORMULA, "--minutes", "1", "--jobs", "1")
    assert done.exit_code == 130
    assert "say the same command again" in done.stderr
    assert calls == ["probe", "rung-1"]
    posed = pose(Problem("CartPole-v1", FORMULA), Path("out"))
    posed.begin(1.0)
    assert set(posed.task.file.budgets) == {"probe", "rung-1", "final"}
    before = [result.provenance for result in Results.load(posed.folder / "race")]
    best = Trainer(posed, Clock(1.0), lambda text: None, False, jobs=1).race()
    assert best.measurement is not None
    assert before[0] in [result.provenance for result in Results.load(posed.folder / "race")]


def test_another_problem_needs_another_folder() -> None:
    pose(Problem("CartPole-v1", FORMULA), Path("out"))
    with pytest.raises(UsageError, match="out has another problem, CartPole-v1 G"):
        pose(Problem("CartPole-v1", "G[0,20] abs(x) <= 1"), Path("out"))


def test_each_problem_has_a_folder_of_its_own() -> None:
    first, second = Problem("CartPole-v1", FORMULA), Problem("CartPole-v1", "G[0,20] abs(x) <= 1")
    pose(first, _folder(first))
    assert _folder(first) == Path("solved/cartpole-v1")
    assert _folder(second) == Path("solved/cartpole-v1-2")


def test_other_minutes_have_other_budgets() -> None:
    small("CartPole-v1", FORMULA)
    posed = pose(Problem("CartPole-v1", FORMULA), Path("out"))
    posed.begin(2.0)
    assert set(posed.task.file.budgets) == {"probe"}
    assert posed.state["methods"] is None


def test_the_task_file_of_an_environment() -> None:
    signals = {"theta": "atan2(obs[1], obs[0])"}
    posed = pose(
        Problem("Pendulum-v1", "G[2,5] abs(theta) <= 0.2 & F[0,10] omega > 1", signals, "seconds"), Path("out")
    )
    content = yaml.safe_load(Path("out/task/task.yaml").read_text())
    assert content["environment"] == {"id": "Pendulum-v1", "names": ["x", "y", "omega"]}
    assert (content["steps"], content["hold"], content["sampling_time"]) == (200, 1, 0.05)
    assert content["formula"] == "G[40,100] abs(theta) <= 0.2 & F[0,200] omega > 1"
    assert content["terminated"] == "hold"
    assert content["signals"]["theta"] == {"low": -3.142, "high": 3.142, "expression": "atan2(y, x)"}
    assert content["signals"]["omega"] == {"low": -8.0, "high": 8.0}
    assert posed.notes == ()


def test_what_is_trivial_or_impossible_is_told() -> None:
    trivial = pose(Problem("Pendulum-v1", "G[0,5] abs(omega) <= 8.5"), Path("out"))
    assert trivial.notes[0].partition(" %")[0] == "trivial: by the action zero 100"
    impossible = pose(Problem("Pendulum-v1", "F[0,5] omega >= 9"), Path("other"))
    assert impossible.notes == ("impossible: 'omega >= 9' holds nowhere within the ranges of the signals",)


def test_a_long_formula_holds_actions() -> None:
    posed = pose(Problem("MountainCarContinuous-v0", "F position >= 0.45"), Path("out"))
    assert (posed.task.file.steps, posed.task.file.hold) == (1000, 5)


def test_methods_that_race() -> None:
    assert contestants(pose(Problem("CartPole-v1", FORMULA), Path("out")).task)[:2] == ("funnel", "raw")
    again = pose(Problem("Pendulum-v1", "G[0,50] F[0,20] x >= 0"), Path("other")).task
    assert contestants(again)[0] == "flag"
    assert len(contestants(again)) <= 4


@pytest.mark.usefixtures("made")
@pytest.mark.parametrize("method", ["raw", "flag"])
@pytest.mark.parametrize("environment", [POINT, "hold-disc"])
def test_a_policy_acts_as_the_referee_lets_it(environment: str, method: str) -> None:
    formula = "F[0,16] G[0,8] d <= 0.5" if environment == POINT else None
    posed = pose(Problem(environment, formula, DISTANCE if environment == POINT else {}), Path("out"))
    posed.budget("probe", steps=64 * posed.task.file.hold, seeds=1, deadline=300.0, checkpoints=1, random_starts=0)
    study = {"tasks": [posed.task.choice], "methods": [method], "seeds": [0], "budget": "probe", "track": "auto"}
    (result,) = run_study(**study, results="cells", jobs=1)
    assert result.measurement is not None, result.reason
    loaded = Results.load("cells").policy(result.id)
    start = loaded.task.starts.report_and_selection()[0][:1]
    expected = referee.record(loaded.task, loaded.method, loaded.policy, start).traces[0]
    Path("out/certificate.json").write_text(json.dumps({"cell": result.id.name}))
    Path("cells").rename("out/final")
    with pytest.raises(UsageError, match=r"^out: its task runs .*; if you trust it, load it with run_code=True$"):
        Solution.load("out")
    policy = Solution.load("out", run_code=True).policy
    np.testing.assert_allclose(_played(policy, start), expected, atol=1e-6)
    with pytest.raises(UsageError, match="expected is 0"):
        policy(None, 3)


def _played(policy: Any, start: Any) -> Any:
    """The signals of an episode that a user steps."""
    task, samples = policy.task, []
    if task.file.environment is None:
        state = start[0]
        for t in range(task.file.steps):
            samples.append(task.system.signals(state))
            state = task.system.step(state[None], policy(state, t)[None])[0]
        return np.array([*samples, task.system.signals(state)])
    env = gymnasium.make(POINT)
    observation, info = env.reset(seed=int(start[0, 0]))
    for t in range(task.file.steps):
        samples.append(abs(float(observation["place"][0]) - float(observation["goal"][0])))
        observation, _, _, _, info = env.step(policy(observation, t, info))
    return np.array([*samples, abs(float(observation["place"][0]) - float(observation["goal"][0]))])[:, None]
