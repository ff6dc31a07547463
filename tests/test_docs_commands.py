"""What the documentation shows is so: commands parse, tables name what there is, the examples of plugins run.

The commands run in tests/docs, with words in place of some; here they are parsed as they are.
"""

from __future__ import annotations

import doctest
import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from itertools import takewhile
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from helpers.command_lines import parsed

from stlbench.cli import app
from stlbench.contract import Outcome
from stlbench.registry import choices, plugins
from stlbench.registry.choices import Choice
from stlbench.registry.named_tasks import task_of
from stlbench.study.plan import plan_cells
from stlbench.study.trial import run_cell
from stlbench.task import load_task
from stlbench.task.file import Budget, TaskFile
from stlbench.testing import check_log, check_task

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), *ROOT.glob("*.md"), *ROOT.glob("plugins/example/*.md")])
BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ELSEWHERE = {"verdict", "my-reward"}
"""Methods that pages speak of and that are not installed here."""


def blocks(page: Path, *languages: str) -> list[str]:
    return [text for language, text in BLOCK.findall(page.read_text(encoding="utf-8")) if language in languages]


def commands() -> Iterator[tuple[str, str]]:
    """Page and command of every line "$ stlbench ..."."""
    for page in PAGES:
        for text in blocks(page, "console"):
            for line in text.replace("\\\n", " ").splitlines():
                if line.startswith("$ stlbench"):
                    yield str(page.relative_to(ROOT)), line.removeprefix("$ ")


def rows(page: str, heading: str) -> dict[str, list[str]]:
    """The table below a heading: first cell without backquotes -> the other cells."""
    after = (DOCS / page).read_text(encoding="utf-8").partition(f"\n{heading}\n")[2].splitlines()
    start = next(number for number, line in enumerate(after) if line.startswith("|"))
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in takewhile(lambda line: line.startswith("|"), after[start:])]
    return {first.strip().strip("`"): [cell.strip() for cell in rest] for first, *rest in cells[2:]}


def test_there_are_commands() -> None:
    assert len(set(commands())) >= 20


@pytest.mark.parametrize(("page", "line"), sorted(set(commands())), ids=lambda text: text.partition("#")[0].strip())
def test_a_command_parses(page: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(FROM_OTHERS["gym-pendulum"], tmp_path / "my-task")  # what pages call it
    monkeypatch.chdir(tmp_path)
    words = shlex.split(line, comments=True)[1:]
    options = parsed(words)
    if words[0] == "run":
        for choice in choices.parse_choices(str(options["methods"] or "funnel,flag")):
            if choice.name not in ELSEWHERE:
                plugins.check("methods", choice)
        for choice in choices.parse_choices(str(options["agents"] or "dqn")):
            plugins.check("agents", choice)


def test_every_command_is_in_the_reference() -> None:
    text = (DOCS / "reference/command-line.md").read_text(encoding="utf-8")
    places = set(re.findall(r"^<!-- command: (.+) -->$", text, re.MULTILINE))
    assert places == set(leaves(typer.main.get_command(app)))


def leaves(command: Any, path: str = "") -> Iterator[str]:
    """The names of all commands, such as "run" and "show cell"."""
    for name, each in command.commands.items():
        yield from leaves(each, f"{path}{name} ") if hasattr(each, "commands") else [f"{path}{name}"]


def test_the_keys_of_a_task_file() -> None:
    table = rows("howto/task.md", "## The task file")
    assert set(table) == set(TaskFile.model_fields)
    for key, field in TaskFile.model_fields.items():
        assert (table[key][0] == "required") == field.is_required(), key
        if isinstance(field.default, int):
            assert table[key][0] == str(field.default), key
    budget = {key: field.default for key, field in Budget.model_fields.items() if not field.is_required()}
    for key, default in budget.items():
        shown = str(default).lower() if isinstance(default, bool) else f"{default:g}" if default is not None else ""
        assert f"{key} = {shown}".removesuffix(" = ") in table["budgets"][1]


def test_built_in_plugins_are_named() -> None:
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    for kind in plugins.KINDS:
        for name, plugin in plugins.available(kind).items():
            assert f"`{name}`" in text or plugin.distribution != plugins.OWN


@pytest.mark.parametrize(
    ("page", "least"), [("howto/environment.md", 15), ("howto/monitor.md", 6), ("explanation/robustness.md", 8)]
)
def test_the_examples_of_a_page(page: str, least: int) -> None:
    result = doctest.testfile(str(DOCS / page), module_relative=False)
    assert result.attempted >= least
    assert result.failed == 0


FROM_OTHERS = {name: ROOT / "examples" / name for name in ("gym-pendulum", "dm-balance")}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "library"), [("gym-pendulum", "gymnasium"), ("dm-balance", "shimmy")])
def test_the_examples_on_environments_follow_the_rules(name: str, library: str) -> None:
    pytest.importorskip(library, reason=f"the example needs {library}")
    check_task(task_of(str(FROM_OTHERS[name])))


@pytest.mark.slow
def test_the_python_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    page = DOCS / "howto/python.md"
    monkeypatch.chdir(tmp_path)
    (study,) = blocks(page, "yaml")
    (tmp_path / "study.yaml").write_text(study, encoding="utf-8")
    names: dict[str, Any] = {"__name__": "__main__"}
    for text in blocks(page, "python"):
        exec(text, names)
    printed = capsys.readouterr().out
    assert printed.startswith("<Results of 2 cells in first: 2 done>\n")
    assert printed.endswith(f"('x', 'y') {names['traces'].samples.shape}\n")
    assert len(names["table"]) == 2


def install(site: Callable[..., Path], page: str, file: str, **others: str) -> None:
    """The distribution of a page: its first table of TOML, and its first code of Python in a file; with other files."""
    (entries, *_), (code, *_) = (blocks(DOCS / f"howto/{page}.md", language) for language in ("toml", "python"))
    text = re.sub(r'\[project\.entry-points\."(.*)"\]', r"[\1]", entries).replace('"', "")
    site("docs-example", text, {file: code, **others})


def test_the_examples_of_task_and_agent_run_together(site: Callable[..., Path], tmp_path: Path) -> None:
    system, task = (blocks(DOCS / "howto/task.md", language)[0] for language in ("python", "yaml"))
    own = task.replace("agents:\n", "agents:\n  random-search: {copies: 8}\n")
    others = {"cart-reach/system.py": system, "cart-reach/task.yaml": own}
    install(site, "agent", "my_agents/random_search.py", **others)
    loaded = load_task(str(tmp_path / "cart-reach"))
    assert str(loaded.formula) == "F[0,40] G[0,10] abs(x - 1) <= 0.2"
    check_task("cart-reach")
    methods, agents = choices.parse_choices("raw"), choices.parse_choices("dqn,random-search[copies=4]")
    for cell in plan_cells(choices.parse_choices("cart-reach"), methods, agents, [0], "smoke"):
        result = run_cell(cell)
        assert result.measurement is not None
        assert result.measurement.env_steps == 3200
        assert [point.steps for point in result.measurement.curve][-1] == 3200
        assert set(result.measurement.selected) == {"formula", "rest"}


HELD = {
    "title": "Keep the tip of a pole in the middle",
    "source": "Gymnasium's CartPole-v1",
    "formula": "G[0,100] abs(tip) <= 1",
    "sampling_time": 0.02,
    "steps": 100,
    "signals": {"tip": {"low": -3, "high": 3, "unit": "m"}},
    "parameters": {"length": 1.0},
}
"""A task file for the class on the page."""


def test_the_examples_on_an_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(plugins._ADDED, "tasks", {})
    page = DOCS / "howto/environment.md"
    steady, several = blocks(page, "yaml")
    held = yaml.safe_dump(HELD | {"agents": {"dqn": {}}, "budgets": yaml.safe_load(steady)["budgets"]})
    system = next(text for text in blocks(page, "python") if "GymTask" in text)
    for name, files in (
        ("steady-pole", {"task.yaml": steady}),
        ("held-pole", {"task.yaml": held, "system.py": system}),
    ):
        (tmp_path / name).mkdir()
        for file, text in files.items():
            (tmp_path / name / file).write_text(text, encoding="utf-8")
        check_task(str(tmp_path / name))
        (cell,) = plan_cells([Choice(name)], choices.parse_choices("raw"), None, [0], "smoke")
        result = run_cell(cell)
        assert result.measurement is not None
        assert set(result.measurement.selected) == {"formula", "random"}
    assert TaskFile.model_validate(yaml.safe_load(steady) | yaml.safe_load(several)).environment


def test_the_example_of_a_log(site: Callable[..., Path]) -> None:
    install(site, "log", "my_logs/lines.py")
    check_log("lines")


def test_the_example_of_an_executor(site: Callable[..., Path]) -> None:
    install(site, "executor", "my_executors/inline.py")
    executor = plugins.build("executors", choices.parse_choice("inline"), defaults={"jobs": 2})
    done, raised = executor.run(int, ["3", "x"], [1, 1])
    assert done == Outcome(0, "done", 3)
    assert (raised.status, raised.reason.partition(":")[0]) == ("raised", "ValueError")
