"""What is said of agents' parameters, who reads it, and what is said where a library is missing."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from dataclasses import FrozenInstanceError, fields
from pathlib import Path
from typing import Any

import pytest
from helpers.line_task import Probe, line

from stlbench.contract import Unsuitable
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, declared, field_docs
from stlbench.simulation.environment import BatchEnvironment
from stlbench.study.cell import Cell
from stlbench.study.plan import check_cells, plan_cells
from stlbench.study.trial import run_cell
from stlbench_agents.dqn import DQN
from stlbench_agents.sb3 import SB3DQN, SB3PPO, SB3SAC, SB3TD3, SB3Agent

OWN = sorted(name for name, plugin in plugins.available("agents").items() if plugin.distribution == plugins.OWN)
PAGE = Path(__file__).parents[2] / "docs/reference/agents.md"


@pytest.mark.parametrize("name", OWN)
def test_every_parameter_has_a_type_a_default_and_a_docstring(name: str) -> None:
    kind = plugins.find("agents", name).load()
    parameters, docs = declared(kind), field_docs(kind)
    assert len(parameters) >= (3 if kind.plans or not kind.discounts else 10)
    for key, parameter in parameters.items():
        assert parameter.default is not inspect.Parameter.empty, key
        assert docs[key], key
        assert bool(parameter.limits) == bool(re.search(r"\b(int|float)\b", parameter.text)), key


@pytest.mark.parametrize("name", OWN)
def test_the_page_shows_every_agents_parameters(name: str) -> None:
    section = PAGE.read_text(encoding="utf-8").partition(f"\n## {name}\n")[2].partition("\n## ")[0]
    assert f"\n<!-- parameters: agents {name} -->\n" in section or name == "dqn-per-robot"


def test_a_recipe_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        DQN().gamma = 0.5  # type: ignore[misc]


def test_agents_on_grids_share_names_types_and_ranges() -> None:
    """`dqn` and `sb3-dqn` are compared: what is called the same is the same kind of thing."""
    ours, theirs = declared(DQN), declared(SB3DQN)
    both = ours.keys() & theirs.keys()
    assert len(both) >= 12
    for key in both:
        assert (ours[key].text, ours[key].limits) == (theirs[key].text, theirs[key].limits), key


OURS = {"net_arch", "copies", "learning_rate", "learning_rate_final", "exploration_noise", "ent_coef_initial"}
"""Fields that reach SB3 under another name or in another form; tested one by one."""
SB3_AGENTS: list[SB3Agent] = [
    SB3DQN(batch_size=7, buffer_size=800, learning_starts=9, gradient_steps=3, gamma=0.5, n_steps=2, tau=0.3,
           target_update_interval=99, exploration_initial_eps=0.9, exploration_final_eps=0.2, exploration_fraction=0.4,
           max_grad_norm=3.0),
    SB3TD3(batch_size=7, buffer_size=800, learning_starts=9, gradient_steps=3, gamma=0.5, n_steps=2, tau=0.3,
           policy_delay=4, target_policy_noise=0.3, target_noise_clip=0.4),
    SB3SAC(batch_size=7, buffer_size=800, learning_starts=9, gradient_steps=3, gamma=0.5, n_steps=2, tau=0.3),
    SB3PPO(n_steps=14, batch_size=7, n_epochs=3, gamma=0.5, gae_lambda=0.6, clip_range=0.3, ent_coef=0.2),
]  # fmt: skip


def environment(agent: SB3Agent) -> BatchEnvironment:
    task = line() if isinstance(agent, SB3DQN) else line(actions={"v": {"low": -1, "high": 2}})
    return BatchEnvironment(task, Probe(task.specification), agent.copies, seed=0)


@pytest.mark.parametrize("agent", SB3_AGENTS, ids=lambda agent: type(agent).__name__)
def test_every_parameter_reaches_sb3(agent: SB3Agent) -> None:
    options = agent.options(environment(agent))
    names = {field.name for field in fields(agent)} - OURS
    assert {name: options[name] for name in names} == {name: getattr(agent, name) for name in names}
    assert set(options) <= set(inspect.signature(agent.algorithm()).parameters)
    model: Any = agent.model(environment(agent), seed=1)
    for name in names - {"target_update_interval", "buffer_size", "clip_range", "n_steps"}:
        assert getattr(model, name) == getattr(agent, name), name
    assert model.policy_kwargs["net_arch"] == [64, 64]


def test_what_reaches_sb3_in_another_form() -> None:
    td3 = SB3TD3(exploration_noise=0.7)
    noise = td3.options(environment(td3))["action_noise"]
    assert noise._sigma.tolist() == [0.7]
    sac = SB3SAC(ent_coef_initial=0.25)
    assert sac.options(environment(sac))["ent_coef"] == "auto_0.25"
    dqn = SB3DQN(target_update_interval=1, copies=5)
    assert dqn.options(environment(dqn))["target_update_interval"] == 5


def hold_disc_by(agent: str) -> Cell:
    (cell,) = plan_cells([Choice("hold-disc")], [Choice("raw")], [Choice(agent)], [0], "smoke")
    return cell


@pytest.mark.parametrize("name", ["sb3-dqn", "sb3-ppo"])
@pytest.mark.parametrize(("module", "title"), [("torch", "PyTorch"), ("stable_baselines3", "Stable-Baselines3")])
def test_a_missing_library_is_one_line_before_anything_is_trained(
    name: str, module: str, title: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # Python's own way to block an import
    message = f'it needs {title}: pip install "stlbench-rl[sb3]"'
    with pytest.raises(Unsuitable, match=re.escape(message)):
        plugins.build("agents", Choice(name))
    cells = [hold_disc_by(name)]
    with pytest.raises(UsageError, match=f"^agent {name}: {re.escape(message)}$"):
        check_cells(cells)


def test_without_torch_and_sb3_all_agents_can_be_listed_and_dqn_trains() -> None:
    """No module of an agent imports a heavy library."""
    code = """
        import sys
        from stlbench.contract import Training
        from stlbench.registry import plugins
        from stlbench.simulation.environment import BatchEnvironment
        from stlbench.task import build_agent, build_method, load_task
        found = sorted(name for name in plugins.available("agents") if plugins.parameters(plugins.find("agents", name)))
        print(found, {"torch", "stable_baselines3", "mujoco", "gymnasium"} & set(sys.modules))
        for name in ("torch", "stable_baselines3", "mujoco"):
            sys.modules[name] = None
        task = load_task("hold-disc")
        make = lambda count: BatchEnvironment(task, build_method(task, "funnel"), count, 0)
        build_agent(task, "dqn").train(Training(make, 800, 0, lambda policy, steps: None, 1))
    """
    done = subprocess.run([sys.executable, "-c", inspect.cleandoc(code)], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout == f"{OWN} set()\n"


def test_an_agent_for_the_other_kind_of_actions_is_a_row_with_that_reason() -> None:
    cell = hold_disc_by("td3")
    assert check_cells([cell]).notes == ("task hold-disc has no recipe for agent td3, which trains with its defaults",)
    result = run_cell(cell)
    assert result.status == "unsuitable"
    assert "the task's actions v, omega are a grid, and this agent's are continuous" in result.reason
