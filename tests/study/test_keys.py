"""What is in a key, and which part of it has changed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.walk_task import walk

from stlbench.registry.choices import parse_choice
from stlbench.registry.fingerprint import Code
from stlbench.study import cell as keys
from stlbench.study.plan import plan_cells
from stlbench.task.view import FormulaView


def planned(track=None):
    task, method, agent = map(parse_choice, ("hold-disc", "raw", "dqn"))
    (cell,) = plan_cells([task], [method], [agent], [0], "smoke", track)
    return cell


def changed(before, after):
    return [name for (name, one), (_, other) in zip(before.parts, after.parts, strict=True) if one != other]


@pytest.mark.parametrize("part", ["harness", "task", "method", "agent"])
def test_a_raised_revision_changes_its_part_alone(monkeypatch, part):
    before = planned()
    assert [name for name, _ in before.parts] == list(keys.PARTS)
    if part == "harness":
        monkeypatch.setattr(keys, "HARNESS", keys.HARNESS + 1)
    else:
        raised = property(lambda plugin: 1 + (plugin.kind == f"{part}s"))
        monkeypatch.setattr(keys.plugins.Plugin, "revision", raised)
    after = planned()
    assert after.key != before.key
    assert changed(before, after) == [part]


def test_a_raised_revision_of_the_view_changes_tasks_that_show_the_formula(monkeypatch):
    before = planned(), planned("auto")
    monkeypatch.setattr(FormulaView, "revision", FormulaView.revision + 1)
    after = planned(), planned("auto")
    assert [changed(*pair) for pair in zip(before, after, strict=True)] == [[], ["task"]]


def test_the_source_of_own_code_is_no_part(monkeypatch):
    """It can be moved and reworded."""
    before, code_of = planned(), keys.code_of

    def moved(module, *, packages=True):
        return Code((("stlbench.elsewhere", "edited"),), code_of(module, packages=packages).packages)

    monkeypatch.setattr(keys, "code_of", moved)
    assert planned().key == before.key


def test_the_versions_of_what_plugins_import_are_a_part_of_their_own(monkeypatch):
    before, code_of = planned(), keys.code_of
    assert "numpy" in {name for code in before.code for name, _ in code.packages}

    def newer(module, *, packages=True):
        code = code_of(module, packages=packages)
        return Code(code.files, tuple((name, f"{version}.1") for name, version in code.packages))

    monkeypatch.setattr(keys, "code_of", newer)
    after = planned()
    assert after.key != before.key
    assert changed(before, after) == ["packages"]


def test_the_version_of_stlbench_is_no_part(monkeypatch):
    """A release in which nothing that trains or scores has changed keeps all results."""
    before, find = planned().key, keys.plugins.find

    def released(kind, name):
        return replace(find(kind, name), version="99")

    monkeypatch.setattr(keys.plugins, "find", released)
    assert planned().key == before


def test_the_cell_knows_the_files_of_its_code():
    cell = planned()
    names = {name for code in cell.code for name, _ in code.files}
    modules = {"stlbench_methods.raw", "stlbench_agents.dqn", "stlbench_tasks.hold_disc"}
    assert names >= {"stlbench.simulation.referee", *modules}
    assert {f"stlbench_tasks/hold_disc/{file}" for file in ("by_hand.yaml", "task.yaml")} <= names
    assert all(code.changed is None for code in cell.code)


UNTIL = "x >= -5 U[0,4] x >= 1"


@pytest.mark.parametrize(
    ("changes", "changed"),
    [
        ({"terminated": "violated", "formula": UNTIL}, True),
        ({"terminated": "interval", "formula": "G[0,4] !(x >= 0 R[0,4] x >= 1)"}, True),
        ({"terminated": "violated", "formula": "F[0,4] (x >= 0 S[0,2] x >= 1)"}, True),
        ({"terminated": "violated", "protocols": {"other": {"title": "another", "formula": UNTIL}}}, True),
        ({"terminated": "violated", "formula": "F[0,4] x >= 1"}, False),
        ({"formula": UNTIL}, False),
    ],
)
def test_ranges_are_in_the_keys_of_early_ends_with_an_until_alone(monkeypatch, changes, changed):
    task = replace(walk(**changes), choice=parse_choice("hold-disc"))
    before = keys.task_part(task, "smoke").digest
    monkeypatch.setattr(keys, "_RANGES", keys._RANGES + 1)
    assert (keys.task_part(task, "smoke").digest != before) == changed
