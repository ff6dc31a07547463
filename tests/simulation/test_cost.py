"""Which methods are refused for what they would cost, and what is said of it."""

from __future__ import annotations

import re
from typing import Any

import pytest
from helpers.line_task import Probe, line

from stlbench.contract import Actions, Agent, Cost, Intractable, Policy, Training
from stlbench.study.fitting import refuse_dear
from stlbench.task import build_agent, build_method, load_task

GIB = 2**30


class Counting(Agent):
    """Costs what it is made with; notes what it is asked."""

    def __init__(self, replay: int = 0, update: float = 1.0, base: int = 3) -> None:
        self.replay, self.update, self.base = replay, update, base
        self.asked: list[tuple[int, int]] = []

    def train(self, training: Training) -> Policy:
        raise AssertionError

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost:
        self.asked.append((size, decisions))
        return Cost(self.replay * (size > self.base), self.update if size > self.base else 1.0)


def refused(agent: Agent, inputs: int = 7, steps: int = 40) -> None:
    """The policy sees x, the step count, the time, and the method's inputs."""
    task = line(hold=2)
    refuse_dear(task, Probe(task.specification, inputs), agent, steps)


def test_what_the_policy_sees_is_counted_with_and_without_the_methods_inputs() -> None:
    agent = Counting()
    refused(agent)
    assert agent.asked == [(10, 20), (3, 20)]


@pytest.mark.parametrize(
    ("cost", "replay", "times"), [({"replay": 4 * GIB + 2**24}, "4.02", 1), ({"update": 10.6}, "0.00", 11)]
)
def test_beyond_either_limit_it_is_intractable(cost: dict[str, Any], replay: str, times: int) -> None:
    words = f"needs 7 inputs: a replay of {replay} GiB (limit 4), updates {times} times as long (limit 10)"
    with pytest.raises(Intractable, match=f"^{re.escape(words)}$"):
        refused(Counting(**cost))


def test_the_limits_themselves_fit() -> None:
    refused(Counting(replay=4 * GIB, update=10.0))


def test_neither_a_method_without_inputs_nor_an_agent_that_cannot_say_is_refused() -> None:
    refused(Counting(update=100.0, base=0), inputs=0)
    silent = type("Silent", (Counting,), {"cost": Agent.cost})
    refused(silent())


@pytest.mark.parametrize("task", ["robot-nav", "pendulum"])
def test_histories_of_thousands_of_samples_are_intractable(task: str) -> None:
    entry = load_task(task)
    agent, steps = build_agent(entry, entry.own_agent), entry.budget("quick").steps
    with pytest.raises(Intractable, match=r"^needs [34]00[23] inputs: a replay of .* updates (16|17|20) times as long"):
        refuse_dear(entry, build_method(entry, "tau-mdp"), agent, steps)
    thinned = build_method(entry, f"tau-mdp[every={max(5, entry.file.hold)}]")
    refuse_dear(entry, thinned, agent, steps)


@pytest.mark.parametrize("task", ["hold-disc", "formation"])
def test_shorter_ones_are_trained(task: str) -> None:
    entry = load_task(task)
    refuse_dear(entry, build_method(entry, "tau-mdp"), build_agent(entry, entry.own_agent), entry.budget("paper").steps)
