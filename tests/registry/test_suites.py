"""Tasks of suites by their names, and the addresses that users write."""

from __future__ import annotations

import pytest

from stlbench.contract import System
from stlbench.errors import UsageError
from stlbench.registry import folders, plugins, suites
from stlbench.registry.choices import Choice
from stlbench.task import load_task
from stlbench.testing import check_suite

NAME = "suite-unicycle-reach-stay-1"


def test_a_name_and_an_address_mean_the_same_task() -> None:
    assert folders.parse_task("suite:unicycle/reach-stay/1") == Choice(NAME) == folders.parse_task(NAME)
    assert load_task("suite:unicycle/reach-stay/1").file == load_task(NAME).file
    assert folders.parse_task("suite:unicycle/reach-stay/1[hold=1]") == Choice(NAME, (("hold", "1"),))


def test_an_address_of_several_tasks() -> None:
    names = [choice.name for choice in folders.parse_tasks("suite:unicycle/reach-stay,patrol,suite:dev")]
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
    assert isinstance(plugin, suites.SuitePlugin)
    assert plugin.is_own
    assert plugin.revision == 1
    assert issubclass(plugin.load(), System)
    assert NAME not in plugins.available("tasks")
