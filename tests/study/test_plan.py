"""Cells: their order, and what is part of a key and what is not."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest
from helpers.line_task import SYSTEM

from stlbench.errors import UsageError
from stlbench.registry.choices import parse_choices
from stlbench.study import plan as planning
from stlbench.study.cell import derive_seed
from stlbench.study.plan import check_cells, plan_cells
from stlbench.task import load_task
from stlbench.task.file import BestKnown

ENTRIES = """
[stlbench.methods]
zz-pay = zz_lab.pay:Pay
zz-more = zz_lab.more:More
[stlbench.tasks]
zz-line = zz_lab.line.system:Line
zz-long = zz_lab.long.system:Line
[stlbench.agents]
zz-agent = zz_lab.agent:Agent
"""

TASK = """
title: A line
source: made up
formula: G[0,4] (x <= 1)
sampling_time: 0.1
steps: 4
signals:
  x: {low: -2, high: 2, unit: m}
actions:
  v: {low: -1, high: 1, count: 3}
initial:
  box: {x: [-1, 1]}
agents:
  zz-agent: {rate: 0.1}
budgets:
  smoke: {steps: 40, seeds: 2, deadline: 60, checkpoints: 2}
  paper: {steps: 4000, seeds: 5}
"""


METHOD = """
from stlbench.contract import RewardMethod
class {name}(RewardMethod):
    def __init__(self, specification, *, beta: float = 1.0): ...
    def arrival(self, signals, t): ...
"""

AGENT = """
from stlbench import contract
class Agent(contract.Agent):
    def __init__(self, *, rate: float): ...
    def train(self, training): ...
"""

FILES = {f"zz_lab/{name.lower()}.py": METHOD.format(name=name) for name in ("Pay", "More")} | {"zz_lab/agent.py": AGENT}
FILES |= {f"zz_lab/{folder}__init__.py": "" for folder in ("", "line/", "long/")}
FILES |= {f"zz_lab/{folder}/system.py": SYSTEM for folder in ("line", "long")}
FILES |= {"zz_lab/line/task.yaml": TASK, "zz_lab/long/task.yaml": TASK.replace("seeds: 2", "seeds: 3")}


@pytest.fixture
def lab(site):
    return site("acme-lab", ENTRIES, FILES)


def plan(tasks="zz-line", methods="zz-pay", agents="zz-agent", seeds=None, budget="smoke"):
    return plan_cells(parse_choices(tasks), parse_choices(methods), parse_choices(agents), seeds, budget)


def keys(**words):
    return [cell.key for cell in plan(**words)]


@pytest.mark.usefixtures("lab")
def test_the_first_seed_of_everything_comes_first():
    cells = plan(tasks="zz-line,zz-long", methods="zz-pay[beta=2],zz-more")
    pairs = [f"{task}/{method}/zz-agent" for task in ("zz-line", "zz-long") for method in ("zz-pay[beta=2]", "zz-more")]
    names = [f"{pair}/{seed}" for seed in (0, 1) for pair in pairs]
    names += [f"{pair}/2" for pair in pairs[2:]]  # the budget of zz-long has three seeds
    assert [cell.id.name for cell in cells] == names
    assert len({cell.key for cell in cells}) == len(cells)


@pytest.mark.usefixtures("lab")
def test_planning_imports_no_method_and_no_agent():
    plan()
    assert not {"zz_lab.pay", "zz_lab.agent"} & set(sys.modules)


@pytest.mark.usefixtures("lab")
def test_what_the_user_says_is_part_of_the_key_however_it_is_written():
    """More seeds keep the keys of the first, and repetitions are planned once."""
    apart = [{}, {"methods": "zz-pay[beta=2]"}, {"agents": "zz-agent[rate=0.2]"}, {"budget": "paper"}]
    apart += [{"tasks": "zz-long"}]
    assert len({keys(seeds=[0], **words)[0] for words in apart}) == len(apart)
    assert keys(agents="zz-agent[rate=0.2]") == keys(agents=" zz-agent[ rate=0.2 ]")
    assert keys(seeds=range(4))[:2] == keys(seeds=range(2)) == keys()
    assert plan(tasks="zz-line,zz-line", methods="zz-pay,zz-pay") == plan()
    named = plan_cells(parse_choices("zz-line"), parse_choices("zz-pay"), None, None, "smoke")
    assert named == plan()  # the first agent that the task has a recipe for


def test_an_ablation_is_a_task_of_its_own(lab):
    edit(lab, "line/task.yaml", "initial:", "training: {cuts: [2]}\ninitial:")
    whole, ablated = plan(tasks="zz-line,zz-line[without=cuts]", seeds=[0])
    assert ablated.id.name == "zz-line[without=cuts]/zz-pay/zz-agent/0"
    assert whole.key != ablated.key
    edit(lab, "line/task.yaml", "training: {cuts: [2]}\n", "")
    assert keys(seeds=[0]) == [ablated.key]


def edit(root, file, old, new):
    text = (root / "zz_lab" / file).read_text()
    assert old in text
    (root / "zz_lab" / file).write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("line/task.yaml", "x <= 1", "x <= 1.5"),
        ("line/task.yaml", "sampling_time: 0.1", "sampling_time: 0.2"),
        ("line/task.yaml", "high: 2", "high: 3"),
        ("line/task.yaml", "rate: 0.1", "rate: 0.3"),
        ("line/task.yaml", "steps: 40,", "steps: 44,"),
        ("line/task.yaml", "checkpoints: 2", "checkpoints: 3"),
        ("line/system.py", "self.dt * action", "2 * self.dt * action"),
        ("pay.py", "1.0", "2.0"),
        ("agent.py", "): ...", "): pass"),
    ],
)
def test_an_edit_that_can_change_the_result_is_a_new_key(lab, file, old, new):
    before = keys(seeds=[0])
    edit(lab, file, old, new)
    assert not set(before) & set(keys(seeds=[0]))


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("line/task.yaml", "title: A line", "title: The line  # as it should be"),
        ("line/task.yaml", "deadline: 60", "deadline: 90"),
        ("line/task.yaml", "seeds: 2", "seeds: 9"),
        ("line/task.yaml", "steps: 4000", "steps: 8000"),
        ("line/task.yaml", "budgets:", "  zz-other: {rate: 7}\nbudgets:"),
        ("more.py", "1.0", "2.0"),
    ],
)
def test_an_edit_that_cannot_change_the_result_keeps_the_key(lab, file, old, new):
    before = keys(seeds=[0])
    edit(lab, file, old, new)
    assert keys(seeds=[0]) == before


def test_the_version_of_the_distribution_is_part_of_the_key(site):
    site("acme-lab", ENTRIES, FILES)
    before = keys(seeds=[0])
    site("acme-lab", ENTRIES, FILES, folder="newer", version="1.3")
    assert not set(before) & set(keys(seeds=[0]))


@pytest.mark.usefixtures("lab")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"tasks": "zz-lime"}, "no task 'zz-lime'; did you mean 'zz-line'?"),
        ({"methods": "zz-pai"}, "no method 'zz-pai'; did you mean 'zz-pay'?"),
        ({"agents": "zz-agents"}, "no agent 'zz-agents'; did you mean 'zz-agent'?"),
        ({"seeds": []}, "at least one seed is needed, none of them negative, got []"),
        ({"budget": "papers"}, "task zz-line has no budget 'papers'; did you mean 'paper'?"),
    ],
)
def test_unknown_names_are_usage_errors(words, message):
    with pytest.raises(UsageError) as caught:
        plan(**words)
    assert message in str(caught.value)


@pytest.mark.usefixtures("lab")
def test_check_finds_wrong_parameters_before_anything_runs():
    check_cells(plan(methods="zz-pay[beta=2],zz-more", agents="zz-agent[rate=0.2]"))
    with pytest.raises(UsageError, match=r"zz-pay\[beta=x\]: beta should be a number, got 'x'"):
        check_cells(plan(methods="zz-more,zz-pay[beta=x]"))
    with pytest.raises(UsageError, match="no parameter 'rat'; did you mean 'rate'"):
        check_cells(plan(agents="zz-agent[rat=1]"))


def test_check_reads_the_recipe_too(lab):
    edit(lab, "line/task.yaml", "rate: 0.1", "rate: fast")
    with pytest.raises(UsageError, match="zz-agent: rate should be a number, got 'fast' in the recipe"):
        check_cells(plan())


def test_seeds_are_derived_from_named_parts():
    # sha256 of '["starts", "hold-disc", 3]' begins with these 8 bytes
    assert derive_seed("starts", "hold-disc", 3) == 0xF647709EC924A792 >> 1
    assert 0 <= derive_seed() < 2**63
    assert derive_seed("a", 1) != derive_seed("a", "1") != derive_seed("a1")
    assert derive_seed("ab", "c") != derive_seed("a", "bc")


@pytest.mark.parametrize("words", [{"plane": None}, {"best_known": BestKnown(robustness=0.5)}])
def test_what_only_people_read_is_not_part_of_the_key(monkeypatch, words):
    task = load_task("hold-disc")

    def key():
        (cell,) = plan_cells(parse_choices("hold-disc"), parse_choices("raw"), parse_choices("dqn"), [0], "smoke")
        return cell.key

    before = key()
    other = replace(task, file=task.file.model_copy(update=words))
    monkeypatch.setattr(planning, "load_task", lambda name: other)
    assert other.file != task.file
    assert key() == before


def test_how_an_environment_is_drawn_is_not_part_of_the_key_and_how_it_is_made_is(monkeypatch):
    pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
    task = load_task("hopper")

    def key(**changes):
        environment = task.file.environment.model_copy(update=changes)
        other = replace(task, file=task.file.model_copy(update={"environment": environment}))
        monkeypatch.setattr(planning, "load_task", lambda name: other)
        (cell,) = plan_cells(parse_choices("hopper"), parse_choices("flag"), parse_choices("td3"), [0], "smoke")
        return cell.key

    assert key(drawn={}) == key()
    assert key(kwargs={}) != key()
