"""The rules of the track `auto`: what they make of a task, and that nothing of it depends on the method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.line_task import Line, line

from stlbench.contract import ActionBox, ActionGrid, Array
from stlbench.errors import UsageError
from stlbench.records.identity import Track
from stlbench.registry.choices import Choice
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.worlds import observation_of
from stlbench.stl import holds, parse
from stlbench.study.cell import on_track, own_agent_on
from stlbench.task import build_method, load_task
from stlbench.task.starts import sample
from stlbench.task.task import agent_for
from stlbench.tracks.auto import cuts, initial_samples, recipe


@pytest.mark.parametrize(
    ("formula", "hold", "expected"),
    [
        ("G[900,1300] x >= 0 & G[1600,2000] x <= 0", 10, (1300,)),
        ("F[0,5] x >= 0 & F[0,7] x <= 0 & F[0,9] x >= 1", 2, (6, 8)),
        ("G[0,100] x >= 0 & F[0,50] x <= 1", 1, ()),
        ("F[0,5] x >= 0 & F[2,5] x <= 0", 1, ()),
        ("G[5,9] x >= 0 & G[9,12] x >= 1 & F[12,20] x <= 0", 1, (12,)),  # it has to be at 1 as it leaves 0
        ("G[5,9] x >= 0 & G[10,12] x >= 1", 1, ()),
        ("G[5,9] x >= 0 & G[11,12] x >= 1", 1, (9,)),
    ],
)
def test_returns_are_cut_where_the_next_goal_changes(formula: str, hold: int, expected: tuple[int, ...]) -> None:
    assert cuts(parse(formula), hold, 2000) == expected


def test_the_agent_follows_from_the_actions() -> None:
    assert agent_for(ActionBox(("u",), (-1.0,), (1.0,))) == "td3"
    assert agent_for(ActionGrid(("u", "v"), ((0.0, 1.0), (0.0, 1.0)))) == "dqn"
    assert agent_for(ActionGrid(("u", "v"), ((0.0, 1.0), (0.0, 1.0)), (1, 1))) == "dqn-per-robot"


@pytest.mark.parametrize(
    ("name", "agent", "discount"),
    [
        ("overlap", "dqn", 0.9),
        ("pendulum", "dqn", 0.95),  # each action is held for one step
        ("fetch-reach", "td3", 0.95),  # 40 decisions
        ("dwell", "td3", 0.96),  # 100 decisions
        ("ball-in-cup", "sb3-sac", 0.98),  # 200 decisions
        ("hopper", "td3", 0.98),  # 1000 decisions
        ("cartpole-steady", "dqn", 0.96),  # at least once in 10 decisions
    ],
)
def test_the_discount_reaches_over_20_steps_a_quarter_of_an_episode_or_a_window(
    name: str, agent: str, discount: float
) -> None:
    assert recipe(agent, load_task(name))["gamma"] == discount


@pytest.mark.parametrize("name", ["overlap", "pendulum", "formation", "patrol", "cartpole-steady"])
def test_nothing_by_hand_is_left(name: str) -> None:
    task = load_task(name)
    by_rules = on_track(task, Choice(own_agent_on(task, "auto")), "auto").file
    bare = task.file.plain().model_copy(update={"hold": task.file.hold, "agents": {"dqn": {}}})
    of_bare = on_track(type(task)(task.choice, bare, task.dynamics), Choice(own_agent_on(task, "auto")), "auto").file
    assert by_rules.model_copy(update={"notes": ""}) == of_bare.model_copy(update={"notes": ""})
    assert by_rules.features == "formula"
    assert by_rules.rewarded is not None


def test_the_method_changes_nothing_that_the_agent_is_given_but_the_reward() -> None:
    task = load_task("overlap")
    task = on_track(task, Choice("dqn"), "auto")
    environments = [BatchEnvironment(task, build_method(task, method), 4, seed=3) for method in ("raw", "funnel")]
    first, other = (environment.reset() for environment in environments)
    np.testing.assert_array_equal(first, other)
    generator = np.random.default_rng(0)
    for _ in range(20):
        action = generator.integers(0, task.actions.size, 4)  # type: ignore[union-attr]
        raw, funnel = (environment.step(action) for environment in environments)
        np.testing.assert_array_equal(raw.observation, funnel.observation)
        np.testing.assert_array_equal(raw.event, funnel.event)
        assert (raw.reward != funnel.reward).any()


@pytest.mark.parametrize("name", ["overlap", "lunar-lander"])
def test_a_policy_is_known_by_the_state_and_the_view_that_it_observes(name: str) -> None:
    task = load_task(name)
    task = on_track(task, Choice(own_agent_on(task, "auto")), "auto")
    method = build_method(task, "raw")
    shown = observation_of(task, method)
    assert task.view is not None
    assert shown.names[-len(task.view.quantities) :] == task.view.quantities
    assert shown.total == BatchEnvironment(task, method, 2, seed=0).observation_size


@pytest.mark.parametrize(("formula", "kept"), [("G[0,8] abs(x) <= 1", 0.5), ("G[0,8] abs(x) <= 0.000001", 1.0)])
def test_exploring_begins_where_the_invariants_hold_unless_that_is_almost_nowhere(formula: str, kept: float) -> None:
    task = line(formula=formula)
    exploring = on_track(task, Choice("dqn"), "auto").file.training.exploring
    assert exploring is not None
    assert exploring.kept == kept
    if exploring.states is not None:
        drawn = sample(exploring.states, np.random.default_rng(0), 50)
        assert (abs(drawn[:, 0]) <= 1).all()


@pytest.mark.parametrize(
    ("formula", "near"),
    [
        ("F[0,4] x >= 5 & F[2,6] G[0,1] x <= -5 & G[0,8] x <= 8", [(2, "x >= 5"), (7, "x <= -5")]),  # by their schedule
        ("x >= 0 & F[5,8] x >= 5", [(8, "x >= 5")]),  # no action changes the first sample
        ("F[0,8] x >= 9.99", []),  # 2 of 4096 states
        ("G[0,8] x <= 5", []),
    ],
)
def test_some_exploring_episodes_begin_where_a_goal_holds_that_chance_reaches(
    formula: str, near: list[tuple[int, str]]
) -> None:
    task = line(formula=formula)
    exploring = on_track(task, Choice("dqn"), "auto").file.training.exploring
    assert exploring is not None
    assert [(each.until, str(each.where)) for each in exploring.near] == near
    assert ("near" in exploring.model_dump()) == bool(near)  # other tasks keep the keys of their results


def test_where_no_range_is_of_a_coordinate_exploring_begins_in_initial_states() -> None:
    """The signals of ball-in-cup are distances, which its states are not: the ball must not be drawn into the cup."""
    task = load_task("ball-in-cup")
    exploring = on_track(task, Choice("td3"), "auto").file.training.exploring
    assert exploring is not None
    assert exploring.states is not None
    assert task.file.initial is not None
    assert task.file.initial.where is not None
    drawn = sample(exploring.states, np.random.default_rng(0), 200)
    assert holds(task.file.initial.where, tuple(exploring.states.box))(drawn).all()


@pytest.mark.parametrize(
    ("task", "part"),
    [
        *(("overlap", part) for part in ("features", "rewarded", "cuts", "near", "exploring")),
        ("cartpole-steady", "ends"),
    ],
)
def test_each_derived_part_can_be_left_out(task: str, part: str) -> None:
    """The file of `overlap` has no condition `near`, and the rules derive all of these parts."""
    whole, less = (on_track(load_task(name), Choice("dqn"), "auto").file for name in (task, f"{task}[without={part}]"))
    assert less == whole.without(part)


@pytest.mark.parametrize(
    ("name", "ends"),
    [
        ("suite:quadrotor/overlap/0", "x < 0 | x > 6 | z < 0 | z > 6 | tilt < -1.5 | tilt > 1.5"),
        ("suite:cart-pendulum/chain/0", "angle < -1 | angle > 1"),
        ("suite:double-integrator/chain/0", ""),  # leaving the room violates nothing
        ("overlap", ""),
        ("lunar-lander", "lost"),
        ("walker", ""),  # its early ends violate as it is
    ],
)
def test_training_episodes_end_early_for_robots_that_can_fall(name: str, ends: str) -> None:
    found = on_track(load_task(name), Choice("dqn"), "auto").file.training.ends
    assert [str(end.where) for end in found] == ([ends if ends == "lost" else str(parse(ends))] if ends else [])


@pytest.mark.parametrize(
    ("name", "track", "said"),
    [
        ("reach-stay[without=cuts]", "auto", r"the task is without cuts as it is on the track auto"),
        ("reach-stay[without=hold+cuts]", "shared", r"the task is without cuts as it is"),
    ],
)
def test_what_is_not_there_cannot_be_left_out(name: str, track: Track, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        on_track(load_task(name), Choice("dqn"), track)


def test_of_a_recipe_by_hand_only_the_grid_of_a_planner_stays() -> None:
    task = load_task("reach-stay")
    planner = task.recipe("planner")
    assert recipe("planner", task) == {"gamma": 0.9, "grid": planner["grid"]}
    assert recipe("best-possible", task) == {"grid": planner["grid"]}


@pytest.mark.parametrize(
    ("name", "budget", "steps", "checkpoints"),
    [
        ("ball-in-cup", "quick", 900_000, 12),  # 300 episodes by hand
        ("ball-in-cup", "smoke", 16_000, 2),
        ("reach-stay", "quick", 1_280_000, 20),  # 1600 episodes
    ],
)
def test_the_budget_quick_has_900_episodes_at_least(name: str, budget: str, steps: int, checkpoints: int) -> None:
    task = load_task(name)
    found = on_track(task, Choice(own_agent_on(task, "auto")), "auto").budget(budget)
    assert (found.steps, found.checkpoints) == (steps, checkpoints)


class _Flat(Line):
    def signals(self, state: Array) -> Array:
        return state[:, 0]


class _Raising(Line):
    def signals(self, state: Array) -> Array:
        raise RuntimeError("no licence")


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (_Flat, r"task line: the shape of its signals is \(64,\), the contract says \(64, 1\)"),
        (_Raising, "task line: RuntimeError: no licence"),
    ],
)
def test_a_system_that_fails_at_the_start_is_told_in_one_line(kind: type[Line], message: str) -> None:
    task = line()
    with pytest.raises(UsageError, match=message):
        initial_samples(replace(task, dynamics=kind(task.system.dt)))
