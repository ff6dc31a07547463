"""Tasks of suites by their names, and the addresses that users write."""

from __future__ import annotations

from typing import Any

import pytest

from stlbench.contract import System
from stlbench.errors import UsageError
from stlbench.registry import named_tasks, plugins
from stlbench.registry.choices import Choice
from stlbench.task import load_task
from stlbench.testing import check_suite

NAME = "suite-unicycle-reach-stay-1"


def test_a_name_and_an_address_mean_the_same_task() -> None:
    assert named_tasks.parse_task("suite:unicycle/reach-stay/1") == Choice(NAME) == named_tasks.parse_task(NAME)
    assert load_task("suite:unicycle/reach-stay/1").file == load_task(NAME).file
    assert named_tasks.parse_task("suite:unicycle/reach-stay/1[hold=1]") == Choice(NAME, (("hold", "1"),))


def test_an_address_of_several_tasks() -> None:
    names = [choice.name for choice in named_tasks.parse_tasks("suite:unicycle/reach-stay,patrol,suite:dev")]
    assert names[:4] == [f"suite-unicycle-reach-stay-{n}" for n in range(4)]
    assert names[4] == "patrol"
    assert len(names) == len(set(names)) > 50


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("suite:unicycle/reach-stay", "'suite:unicycle/reach-stay': one task is expected, these are 4"),
        ("suite:unicycle/reach-sty/1", "suite suite has no 'unicycle/reach-sty/1'; did you mean"),
        ("suite:unicycle/reach-stay/99", "suite suite has no 'unicycle/reach-stay/99'"),
        ("suit:dev", "no suite 'suit'; did you mean 'suite'?"),
        ("suite-unicycle-nothing-1", "no task 'suite-unicycle-nothing-1'"),
    ],
)
def test_what_names_no_task(address: str, message: str) -> None:
    with pytest.raises(UsageError) as error:
        load_task(address)
    assert str(error.value).startswith(message)


@pytest.mark.slow
def test_it_keeps_the_contract() -> None:
    """Its names and splits, and the first task of dev, core and hard."""
    check_suite("suite")


def test_the_plugin_of_a_task() -> None:
    """It is of the suite's distribution and revision, and is not listed among tasks."""
    plugin = plugins.find("tasks", NAME)
    assert isinstance(plugin, plugins.SuitePlugin)
    assert plugin.is_own
    assert plugin.revision == 1
    assert issubclass(plugin.load(), System)
    assert NAME not in plugins.available("tasks")


BROKEN = """
from stlbench.contract import Suite, SuiteTask
class One(Suite):
    names, splits = {names}, {splits}
    def task(self, name): return {task}
"""


@pytest.mark.parametrize(
    ("names", "splits", "task", "said"),
    [
        ("7", "{}", "7", "suite 'zz' of acme 1.2: its names is 7, the contract says a sequence"),
        ("[7]", "{}", "7", "suite 'zz' of acme 1.2: its names have 7, the contract says parts of a-z, 0-9 and -"),
        ("['../a']", "{}", "7", "suite 'zz' of acme 1.2: its names have '../a', the contract says parts of"),
        ("['a']", "7", "7", "suite 'zz' of acme 1.2: its splits is 7, the contract says a mapping"),
        ("['a']", "{'dev': ['b']}", "7", "suite 'zz' of acme 1.2: its split 'dev' has what is none of its names"),
        ("property(lambda self: 1 / 0)", "{}", "7", "suite 'zz' of acme 1.2 cannot be asked for its tasks: Zero"),
        ("['a']", "{}", "7", "task 'zz-a' of acme 1.2 (zz_suite:One): PluginError: suite 'zz' of acme 1.2: task('a')"),
    ],
)
def test_a_suite_that_breaks_its_contract_is_named_with_the_rule(
    site: Any, names: str, splits: str, task: str, said: str
) -> None:
    text = BROKEN.format(names=names, splits=splits, task=task)
    site("acme", "[stlbench.suites]\nzz = zz_suite:One\n", {"zz_suite.py": text})
    with pytest.raises(plugins.PluginError) as caught:
        plugins.find("tasks", "zz-a").load()
    assert str(caught.value).startswith(said)
