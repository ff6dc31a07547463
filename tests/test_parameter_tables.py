"""The tables of parameters and of options in the documentation, as mkdocs makes them."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import parse_choice

DOCS = Path(__file__).parents[1] / "docs"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"hooks/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def hook() -> ModuleType:
    return load("parameter_tables")


def test_a_command_has_its_description_and_its_options() -> None:
    page = load("option_tables").on_page_markdown("# Here\n<!-- command: results remove -->\n", page=None)
    title, *lines = page.splitlines()
    assert (title, lines[1]) == ("# Here", "")
    assert "| `RESULTS` | required |" in page
    assert "| `--json` |  | Print JSON" in page
    assert "Example" not in page
    with pytest.raises(KeyError, match="fly"):
        load("option_tables").section("fly")


def test_options_of_which_one_is_chosen_have_default_and_range() -> None:
    rows = load("option_tables").section("score")
    assert "| `--policy <selected|final>` | selected |" in rows
    assert re.search(r"^\| `--seed N` \| 0 \| .+ `x>=0` \|$", rows, re.MULTILINE)


def test_the_page_of_tasks_has_what_each_task_file_says() -> None:
    page = (DOCS / "reference/tasks.md").read_text(encoding="utf-8")
    text = load("task_notes").on_page_markdown(page)
    for name in plugins.available("tasks"):
        assert f"**`{name}`**: " in text or not (DOCS.parent / "tasks/stlbench_tasks" / name.replace("-", "_")).exists()
    assert "**`annulus`**: Stay in a ring, `G[" in text
    assert "No robustness is above 1.5.\n\nBy hand:\n\n- `nested`: The same formula with an inner window" in text


def test_a_row_by_hand(hook: ModuleType) -> None:
    rows = hook.table("agents", "td3").splitlines()
    assert rows[0] == "| parameter | type | default | meaning |"
    assert "| `tau` | float, >= 0, &lt;= 1 | `0.01` | weight of the online networks in an update of" in rows[11]


def test_all_places_of_the_agents_page_are_filled(hook: ModuleType) -> None:
    text = hook.on_page_markdown((DOCS / "reference/agents.md").read_text(encoding="utf-8"), page=None)
    assert "<!--" not in text
    assert text.count("| parameter | type | default | meaning |") == 9
    for line in re.findall(r"^\| `.*", text, re.MULTILINE):
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        assert len(cells) == 4
        assert all(cells), line


@pytest.mark.parametrize("page", sorted((DOCS / "methods").glob("*.md")), ids=lambda page: page.stem)
def test_the_table_of_a_method_says_what_each_parameter_means(hook: ModuleType, page: Path) -> None:
    text = hook.on_page_markdown(page.read_text(encoding="utf-8"))
    table = text[text.index("| parameter | type | default | meaning |") :]
    found = re.findall(r"^\| `(\w+)` \| .+? \| `.+?` \| .+ \|$", table, re.MULTILINE)
    assert {*found} == {*plugins.parameters(plugins.find("methods", page.stem))}


@pytest.mark.parametrize("name", ["dqn", "td3", "sb3-ppo"])
def test_a_default_can_be_said_as_it_is_shown(hook: ModuleType, name: str) -> None:
    for row in hook.table("agents", name).splitlines()[2:]:
        key, _, default, _ = (cell.strip(" `") for cell in row.strip("|").split("|"))
        if default != "None":
            plugins.check("agents", parse_choice(f"{name}[{key}={default}]"))


def test_a_plugin_that_is_not_there_stops_the_build(hook: ModuleType) -> None:
    with pytest.raises(UsageError, match="no agent 'ddqn'"):
        hook.on_page_markdown("<!-- parameters: agents ddqn -->")
