"""The checks of an agent notice what breaks the contract."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from stlbench.contract import ActionGrid, Agent, Array, Cost, Policy, Training, Unsuitable
from stlbench.testing import Rules, check_agent


class Weighted(Policy):
    """Linear scores on a grid; linear actions in a box."""

    def __init__(self, weights: Array, grid: bool) -> None:
        self.weights, self.grid = weights, grid

    def act(self, observation: Array) -> Any:
        found = observation @ self.weights
        return found.argmax(axis=1) if self.grid else found


def zeros(environment: Any) -> Weighted:
    actions = environment.actions
    grid = isinstance(actions, ActionGrid)
    return Weighted(np.zeros((environment.observation_size, actions.size if grid else len(actions.low))), grid)


class Sound(Agent):
    """Random weights, three times."""

    copies = 4
    search_space = {"rate": (0.1, 1.0), "hold": (1, 2)}  # noqa: RUF012

    def __init__(self, *, rate: float = 1.0) -> None:
        self.rate = rate

    def train(self, training: Training) -> Policy:
        environment = training.make(self.copies)
        generator, observation, policy = np.random.default_rng(training.seed), environment.reset(), zeros(environment)
        for part in range(1, 4):
            policy = Weighted(self.rate * generator.normal(size=policy.weights.shape), policy.grid)
            for _ in range(training.steps // (3 * self.copies)):
                observation = environment.step(policy.act(observation)).observation
            training.report(policy, part * training.steps // 3)
        return policy

    def cost(self, size: int, actions: Any, decisions: int) -> Cost | None:
        return Cost(8 * size * decisions, size)


def test_a_sound_agent_keeps_all_rules() -> None:
    rules = Rules()
    check_agent(Sound, rules)
    assert rules.kept[-1] == "with two robots with 3 actions each, it trains or raises Unsuitable"
    assert "the same seed gives the same final policy" in rules.kept


def test_an_agent_that_plans() -> None:
    check_agent("planner[resolution=0.5]")


def broken(**parts: Any) -> type[Agent]:
    return type("Broken", (Sound,), parts)


def trained(**changes: Callable[[Training], Any]) -> type[Agent]:
    """`Sound`, with another training than that it is given: the fields that change, each from what was given."""

    def train(self: Any, given: Training) -> Policy:
        return Sound.train(self, replace(given, **{name: change(given) for name, change in changes.items()}))

    return broken(train=train)


def acting(change: Callable[[Any], Any]) -> type[Agent]:
    """`Sound`, whose policies act otherwise."""

    class Otherwise(Weighted):
        def act(self, observation: Array) -> Any:
            return change(super().act(observation))

    def train(self: Any, training: Training) -> Policy:
        final = Sound.train(self, Training(training.make, training.steps, training.seed, lambda policy, at: None))
        assert isinstance(final, Weighted)
        policy = Otherwise(final.weights, final.grid)
        training.report(policy, training.steps)
        return policy

    return broken(train=train)


seeds = iter(range(1000))


@pytest.mark.parametrize(
    ("agent", "rule"),
    [
        (broken(search_space={"rat": (1,)}), "search_space names parameters of the agent, and hold; got rat"),
        (broken(search_space={"rate": ()}), "search_space has values for each parameter; got none for rate"),
        (broken(recipe={"rat": 1}), "recipe has parameters of the agent, with values of their types; got rat = 1"),
        (broken(recipe={"rate": "x"}), "recipe has parameters of the agent, with values of their types; got rate"),
        (broken(second_recipe={"rat": 1}), "second_recipe has parameters of the agent, with values of their types"),
        (broken(second_recipe={"rate": [1, 2]}), "second_recipe has parameters of the agent, with values of their"),
        (broken(preference={"line": 1}), "preference has places from 1 on for some of grid, robots, box; got"),
        (broken(preference={"grid": 0}), "preference has places from 1 on for some of grid, robots, box; got"),
        (broken(search_space={"rate": ("x",)}), "values of search_space are of their type; got rate = 'x'"),
        (broken(cost=lambda self, size, *_: Cost(1, 1 / size)), "cost does not fall where observations or decisions"),
        (broken(cost=lambda self, size, *_: Cost(-1, 1)), "cost has bytes of the replay, at least 0"),
        (broken(uncompiled=lambda self: 3), "uncompiled is None or can be called; got 3"),
        (trained(steps=lambda t: 2 * t.steps), "training takes at most its budget, 2000 environment steps; got 39"),
        (trained(report=lambda t: lambda policy, at: None), "training reports a policy"),
        (trained(report=lambda t: lambda policy, at: t.report(policy, -at)), "reports count the environment steps so"),
        (trained(seed=lambda t: next(seeds)), "the same seed gives the same reported policies, bit for bit"),
        (broken(train=lambda self, training: 1 / 0), "with one of 5 actions, it trains or raises Unsuitable"),
        (acting(lambda action: action[:, None]), r"act has shape \(6,\); got \(6, 1\)"),
        (acting(lambda action: action + 100), r"actions are whole numbers in 0\.\.4"),
        (acting(lambda action: action * 1.0), r"actions are whole numbers in 0\.\.4"),
        (acting(lambda action: action * 0 + next(seeds) % 5), "act is pure"),
        (acting(lambda action: action * 0 + min(4, len(action))), "act of a batch is that of its rows"),
    ],
)
def test_an_agent_that_breaks_a_rule_is_told_which(agent: type[Agent], rule: str) -> None:
    with pytest.raises(AssertionError, match=f"^rule broken: {rule}"):
        check_agent(agent)


@pytest.mark.parametrize("keyword_only", [False, True])
def test_parameters_that_a_user_cannot_set_break_a_rule(keyword_only: bool) -> None:
    @dataclass(kw_only=keyword_only)
    class Rated(Sound):
        rate: float = 1.0

    if keyword_only:
        check_agent(Rated)
        return
    with pytest.raises(AssertionError, match=r"^rule broken: parameters of the constructor are .*; got rate$"):
        check_agent(Rated)


def test_a_policy_that_later_training_changes_is_not_frozen() -> None:
    def train(self: Any, training: Training) -> Policy:
        policy = Weighted(np.zeros((training.make(1).observation_size, 5)), True)
        for at in (1, 2):
            policy.weights[0] = [at, 0, 0, 0, -at] if at == 1 else [-at, 0, 0, 0, at]
            training.report(policy, at)
        return policy

    with pytest.raises(AssertionError, match=r"^rule broken: a policy that was reported does not change; got one of"):
        check_agent(broken(train=train))


def idle(self: Any, training: Training) -> Policy:
    """Reports a policy of all zeros, without a step."""
    policy = zeros(training.make(1))
    training.report(policy, 0)
    return policy


def test_an_agent_takes_steps_unless_it_says_that_it_does_not_train() -> None:
    rule = "an agent takes environment steps, plans, or says trains = False; got no"
    with pytest.raises(AssertionError, match=rule):
        check_agent(broken(train=idle))
    check_agent(broken(train=idle, trains=False))


def test_an_agent_that_refuses_all_tasks_says_why() -> None:
    def train(self: Any, training: Training) -> Policy:
        raise Unsuitable("only weather")

    with pytest.raises(Unsuitable, match="only weather"):
        check_agent(broken(train=train))
