"""`stlbench new`: what is written works as it is, keeps the contract, and is clean; nothing is overwritten."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.registry import plugins
from stlbench.study.study import json_schema
from stlbench.task import load_task
from stlbench.testing import check_task

ROOT = Path(__file__).parents[2]
KINDS = ("method", "task", "agent")


def new(*words: object) -> str:
    done = CliRunner().invoke(app, ["new", *map(str, words)])
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.mark.parametrize(
    "kind", ["method", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("task", "agent"))]
)
def test_its_own_tests_pass_where_it_is_installed(kind: str, tmp_path: Path, site: Callable[..., Path]) -> None:
    listed = new(kind, "zz-two-words", "--into", tmp_path / "made").splitlines()
    folder = tmp_path / "made" / "zz-two-words"
    written = [path for path in folder.rglob("*") if path.is_file()]
    assert sorted(listed[:-1]) == sorted(map(str, written))
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    ((group, entries),) = project["entry-points"].items()
    assert group == f"stlbench.{kind}s"
    lines = "\n".join(f"{name} = {value}" for name, value in entries.items())
    files = {str(path.relative_to(folder / "src")): path.read_text() for path in (folder / "src").rglob("*.*")}
    site(project["name"], f"[{group}]\n{lines}\n", files, folder="installed")
    assert plugins.find(f"{kind}s", "zz-two-words").load().__doc__
    (tests,) = (folder / "tests").glob("*.py")
    names: dict[str, Callable[[], None]] = {}
    exec(tests.read_text(), names)
    found = [name for name in names if name.startswith("test_")]
    assert len(found) == 2
    for name in found:
        names[name]()


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """One of each kind."""
    for kind in KINDS:
        new(kind, f"zz-{kind}", "--into", tmp_path)
    return tmp_path


@pytest.mark.slow
def test_it_is_clean(made: Path) -> None:
    for kind in KINDS:
        for words in (("check",), ("format", "--check")):
            command = (sys.executable, "-m", "ruff", *words, "--no-cache", ".")
            done = subprocess.run(command, cwd=made / f"zz-{kind}", capture_output=True, text=True)
            assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_its_annotations_hold(made: Path) -> None:
    sources = [made / f"zz-{kind}" / "src" for kind in KINDS]
    packages = [word for kind in KINDS for word in ("-p", f"stlbench_{kind}_zz_{kind}")]
    environment = os.environ | {"MYPYPATH": os.pathsep.join(map(str, [*sources, ROOT]))}
    command = (sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", *packages)
    done = subprocess.run(command, cwd=made, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_nothing_is_overwritten(made: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in made.rglob("*")}
    done = CliRunner().invoke(app, ["new", "agent", "zz-method", "--into", str(made)])
    assert done.exit_code == 2
    assert done.stderr == f"error: {made / 'zz-method'} is there already; nothing was written\n"
    assert {path: path.stat().st_mtime_ns for path in made.rglob("*")} == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("method", "funnel"), "the name 'funnel' is taken by method 'funnel' of stlbench-rl "),
        (("task", "../x"), "'../x': a name begins with a-z and has a-z and 0-9, with single - between them"),
        (("task", "zz-made", "--environment", "CartPoel-v1"), "no environment 'CartPoel-v1'; did you mean"),
        (("task", "zz-made", "--environment", "CarRacing-v3"), "its observation has 27648 numbers, more than the 500"),
        (("agent", "zz-made", "--environment", "CartPole-v1"), "--environment is for a task; agent was asked for"),
    ],
)
def test_a_bad_name_or_environment_is_one_line(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    done = CliRunner().invoke(app, ["new", *words, "--into", str(tmp_path / "made")])
    assert done.exit_code == 2
    line = done.stderr.splitlines()[-1]  # before it, Box2D warns of itself where it is first imported
    assert line.startswith(f"error: {said}")
    assert len(line) < 250
    assert not (tmp_path / "made").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("identifier", "agent"),
    [
        *(("CartPole-v1", "dqn"), ("Pendulum-v1", "td3"), ("gymnasium_robotics:FetchReach-v4", "td3")),
        *(("Hopper-v5", "td3"), ("HalfCheetah-v5", "td3"), ("shimmy:dm_control/cartpole-balance-v0", "td3")),
    ],
)
def test_a_task_on_an_environment_keeps_the_contract_as_it_is(
    identifier: str, agent: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    new("task", "zz-made", "--into", tmp_path, "--environment", identifier)
    task = load_task(str(tmp_path / "zz-made"))
    assert task.own_agent == agent
    check_task(str(tmp_path / "zz-made"))


def test_the_first_line_of_a_task_file_names_the_schema_beside_it(made: Path, tmp_path: Path) -> None:
    new("task", "zz-wrapped", "--into", tmp_path, "--environment", "CartPole-v1")
    for path in (made / "zz-task/src/stlbench_task_zz_task/task.yaml", tmp_path / "zz-wrapped/task.yaml"):
        first, _, rest = path.read_text().partition("\n")
        schema = path.parent / first.removeprefix("# yaml-language-server: $schema=")
        assert json.loads(schema.read_text()) == json_schema("task")
        assert yaml.safe_load(rest)["formula"]


@pytest.mark.slow
def test_what_has_no_ends_is_scaled_by_what_was_seen(tmp_path: Path) -> None:
    new("task", "zz-made", "--into", tmp_path, "--environment", "Hopper-v5")
    text = (tmp_path / "zz-made" / "task.yaml").read_text()
    assert text.splitlines()[1].startswith("# The environment gives some entries no ends, or leaves them. Twenty")
    content = yaml.safe_load(text)
    scale, signals = content["environment"]["scale"], content["signals"]
    assert list(scale) == list(signals)
    assert scale["z"] == 2  # its height, 1.25 m
    assert all((ends["low"], ends["high"]) == (-2 * scale[name], 2 * scale[name]) for name, ends in signals.items())
    new("task", "zz-again", "--into", tmp_path, "--environment", "Hopper-v5")
    assert (tmp_path / "zz-again" / "task.yaml").read_text() == text


LEVER = """
import gymnasium, numpy as np
class Lever(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(np.array([-np.inf] * 4 + [0]), np.inf, (5,), np.float64)
    action_space = gymnasium.spaces.MultiDiscrete([3, 3])
    def seen(self): return np.array([self.x, 0.5, 1e-6 * self.x, 0, 7])
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = float(self.np_random.uniform(-0.5, 0.5)) if seed != 15 else 4.0
        return self.seen(), {}
    def step(self, action):
        self.x *= 0.9
        return self.seen(), 0.0, False, False, {}
gymnasium.register("Lever-v0", Lever, max_episode_steps=20)
"""


def test_what_hardly_moves_at_random_is_scaled_by_what_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Magnitudes 4, .5, 4e-6, 0 and 7: the median of those that move at all is 2.25, and a tenth of it the least.

    4 is seen in one episode of twenty; the last entry has a lower end. The actions are a grid, as `dqn` needs them.
    """
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "zz_lever.py").write_text(LEVER)
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    new("task", "zz-lever-task", "--into", tmp_path, "--environment", "zz_lever:Lever-v0")
    content = yaml.safe_load((tmp_path / "zz-lever-task/task.yaml").read_text())
    assert list(content["environment"]["scale"].values()) == [5, 0.5, 0.5, 0.5, 10]
    assert content["signals"]["o2"] == {"low": -1, "high": 1}
    assert content["signals"]["o4"] == {"low": 0, "high": 20}
    assert load_task(str(tmp_path / "zz-lever-task")).own_track == "auto"  # it has no recipe


def test_a_module_in_the_working_directory_is_found_for_the_user_who_names_it(tmp_path: Path) -> None:
    """A task folder names no module of the working directory, unless the user has put that on the path."""
    (tmp_path / "zz_here.py").write_text(LEVER)
    stlbench = Path(sys.executable).with_name("stlbench")

    def said(*words: str, **environment: str) -> str:
        shown = dict(cwd=tmp_path, env=os.environ | environment, capture_output=True, text=True)
        done = subprocess.run([stlbench, *words], **shown)  # type: ignore[call-overload]
        return str(done.stdout + done.stderr)

    then = said("new", "task", "zz-here", "--environment", "zz_here:Lever-v0")
    assert then.splitlines()[-1] == "now: change zz-here/task.yaml, and PYTHONPATH=. stlbench check ./zz-here"
    assert "No module named 'zz_here'; set PYTHONPATH=. if it lies here\n" in said("check", "./zz-here")
    assert "rules are kept" in said("check", "./zz-here", PYTHONPATH=".")


def test_what_leaves_its_ends_is_scaled_by_what_was_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The space says [-1, 1] for both; x reaches 4 at its first step, and the other entry stays there."""
    monkeypatch.syspath_prepend(tmp_path)
    text = LEVER.replace("np.array([-np.inf] * 4 + [0]), np.inf, (5,)", "-1, 1, (2,)")
    text = text.replace(", 1e-6 * self.x, 0, 7", "")
    (tmp_path / "zz_liar_lever.py").write_text(text.replace("Lever-v0", "LiarLever-v0"))
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    words = "new", "task", "zz-liar", "--into", str(tmp_path), "--environment", "zz_liar_lever:LiarLever-v0"
    (line,) = [line for line in CliRunner().invoke(app, words).stderr.splitlines() if "outside" in line]
    said = "an observation outside its space at step 0: 'o0' is 4, outside -1 to 1; its range is by what 20 episodes"
    assert line.startswith(f"warning: environment zz_liar_lever:LiarLever-v0: the environment returned {said}")
    content = yaml.safe_load((tmp_path / "zz-liar/task.yaml").read_text())
    assert content["environment"]["scale"] == {"o0": 5}
    assert content["signals"] == {"o0": {"low": -10, "high": 10}, "o1": {"low": -1, "high": 1}}


def test_the_command_that_comes_next_can_be_pasted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "a b"
    assert new("method", "zz-one", "--into", folder).splitlines()[-1].startswith(f"now: cd '{folder}/zz-one' && pip ")
    words = "task", "zz-pole", "--environment", "CartPole-v1", "--into"
    assert new(*words, folder).endswith(f"and stlbench check '{folder}/zz-pole'\n")
    assert new(*words, "a b/c").endswith("and stlbench check './a b/c/zz-pole'\n")
    assert new(*words, "c").endswith("and stlbench check ./c/zz-pole\n")
