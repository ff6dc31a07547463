"""What is loaded for many cells: of stlbench's own plugins, and of no others."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from stlbench.registry.choices import parse_choices
from stlbench.study import plan as module
from stlbench.study.plan import examples, plan_cells, preload
from stlbench_agents.dqn import DQN


def cells(tasks, methods, agents="dqn", seeds=(0, 1)):
    return plan_cells(parse_choices(tasks), parse_choices(methods), parse_choices(agents), seeds, "smoke")


def test_examples_have_each_task_method_and_agent_and_are_few():
    planned = cells("hold-disc,pendulum,overlap", "raw,flag,funnel", "dqn,dqn[gamma=0.9]")
    chosen = examples(planned)
    assert len(planned) == 36
    assert len(chosen) <= 3 + 3 + 2
    for part in ("task", "method", "agent"):
        assert {getattr(cell.id, part) for cell in chosen} == {getattr(cell.id, part) for cell in planned}


@pytest.fixture
def loaded(monkeypatch):
    """Agents that were preloaded, by their discount."""
    found = []
    monkeypatch.setattr(DQN, "preload", lambda self: found.append(self.gamma))
    return found


def test_agents_are_preloaded_and_methods_step_once(loaded, monkeypatch):
    stepped = []
    environment = module.BatchEnvironment
    monkeypatch.setattr(environment, "step", lambda self, action: stepped.append((self.task.name, action.shape)))
    preload(cells("hold-disc", "raw", "dqn[gamma=0.9]", [0]))
    assert loaded == [0.9]
    assert stepped == [("hold-disc", (2, 2))]


ENTRIES = "[stlbench.methods]\nthird = third_plugin:Third\n[stlbench.agents]\nthird-agent = third_plugin:Agent\n"
SOURCE = "import numpy as np\nnp.seterr(all='raise')\nfrom stlbench_methods.raw import Raw as Third\n"


def test_plugins_of_others_are_not_imported_and_what_fails_is_passed_over(site, loaded):
    site("third-plugin", ENTRIES, {"third_plugin.py": SOURCE})
    before = np.geterr()
    preload([*cells("hold-disc", "third", "dqn", [0]), *cells("hold-disc", "raw", "dqn[head=none]", [0])])
    assert "third_plugin" not in sys.modules
    assert np.geterr() == before
    assert len(loaded) == 1
