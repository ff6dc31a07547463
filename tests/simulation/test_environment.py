"""Transitions worked out by hand on the line, and what training must not depend on."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.line_task import Probe, line

from stlbench.contract import Array, Integers
from stlbench.simulation.environment import BatchEnvironment, Simulator, ends_of

DOWN, STAY, UP = 0, 1, 2
"""x moves by -.5, 0, .5 a step."""

VIOLATED = {"where": "violation"}


def always(action: int, count: int) -> np.ndarray:
    return np.full(count, action)


class TestSimulator:
    def test_an_observation_is_features_then_time_then_inputs(self) -> None:
        task = line()
        simulator = Simulator(task, Probe(task.specification, memory_size=2))
        # features x and t; time 2 t / 8 - 1; memory: transitions so far, x_0
        assert simulator.reset(np.array([[0.25], [3.0]])).tolist() == [[0.25, 0, -1, 0, 0.25], [3, 0, -1, 0, 3]]
        simulator.advance(np.array([UP, DOWN]))
        assert simulator.observe().tolist() == [[0.75, 1, -0.75, 1, 0.25], [2.5, 1, -0.75, 1, 3]]

    def test_an_action_is_held_and_every_step_is_a_sample(self) -> None:
        task = line(hold=4)
        simulator = Simulator(task, Probe(task.specification))
        simulator.reset(np.array([[0.0], [1.0]]))
        steps = simulator.advance(np.array([UP, DOWN]))
        assert steps.samples[..., 0].tolist() == [[0.5, 1, 1.5, 2], [0.5, 0, -0.5, -1]]
        # 100 t + 10 x_{t+1} + x_t at t = 0..3: 5, 110.5, 216, 321.5 and 6, 100.5, 195, 289.5
        assert steps.reward.tolist() == [653 / 4, 591 / 4]
        assert simulator.advance(always(STAY, 2)).samples[..., 0].tolist() == [[2] * 4, [-1] * 4]
        assert simulator.t.tolist() == [8, 8]

    @pytest.mark.parametrize("hold", [1, 2, 4])
    def test_reward_with_memory_step_by_step_is_that_without_memory_in_one_call(self, hold: int) -> None:
        task = line(hold=hold)
        simulators = [Simulator(task, Probe(task.specification, memory_size=size)) for size in (0, 3)]
        generator = np.random.default_rng(0)
        states = generator.normal(size=(5, 1))
        for simulator in simulators:
            simulator.reset(states)
        for _ in range(8 // hold):
            action = generator.integers(3, size=5)
            without, with_ = (simulator.advance(action) for simulator in simulators)
            assert without.reward == pytest.approx(with_.reward, rel=1e-12)
            assert np.array_equal(without.samples, with_.samples)
        assert simulators[1].memory[:, 0].tolist() == [8] * 5  # every step once, also of a held action
        assert np.array_equal(simulators[1].memory[:, 1], states[:, 0])

    def test_rows_that_are_replaced_start_anew_and_others_go_on(self) -> None:
        task = line()
        simulator = Simulator(task, Probe(task.specification, memory_size=2))
        simulator.reset(np.array([[0.0], [1.0], [2.0]]))
        simulator.advance(always(UP, 3))
        simulator.reset_rows(np.array([0, 2]), np.array([[-1.0], [-2.0]]), np.array([0, 0]))
        assert simulator.observe().tolist() == [[-1, 0, -1, 0, -1], [1.5, 1, -0.75, 1, 1], [-2, 0, -1, 0, -2]]
        steps = simulator.advance(always(UP, 3))
        assert steps.samples[:, 0, 0].tolist() == [-0.5, 2, -1.5]
        # 100 t + 10 x_{t+1} + x_t with t = 0, 1, 0
        assert steps.reward.tolist() == [-5 - 1, 100 + 20 + 1.5, -15 - 2]

    def test_rows_may_start_at_another_time_and_vectors_are_clipped(self) -> None:
        simulator = Simulator(task := line(), Probe(task.specification, memory_size=1))
        simulator.reset(np.zeros((2, 1)))
        simulator.reset_rows(np.array([1]), np.array([[3.0]]), np.array([6]))
        assert simulator.observe().tolist() == [[0, 0, -1, 0], [3, 6, 0.5, 0]]
        steps = simulator.advance(np.array([[0.25], [-7.0]]))  # v is in [-1, 1] m/s
        assert steps.samples[:, 0, 0].tolist() == [0.125, 2.5]
        assert steps.reward.tolist() == [1.25, 600 + 25 + 3]

    def test_what_is_placed_is_copied(self) -> None:
        task, states = line(), np.array([[1.0], [2.0]])
        simulator = Simulator(task, Probe(task.specification))
        simulator.reset(states)
        simulator.reset_rows(np.array([0]), np.array([[7.0]]), np.array([0]))
        assert states.tolist() == [[1], [2]]


class _InPlace(Probe):
    """Changes all arrays that it is given, as if they were its own."""

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        signals[:], t[:] = 9.0, 7
        return np.zeros((len(t), self.memory_size))

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        paid = super().along(samples, action, t, memory)
        samples[:], action[:], t[:], memory[:] = 9.0, 9.0, 7, 9.0
        return paid


@pytest.mark.parametrize("hold", [1, 2])
def test_what_a_method_changes_in_place_is_in_no_trace(hold: int) -> None:
    """Else it could make the trace that the referee scores."""
    task = line(hold=hold)
    honest, other = (Simulator(task, kind(task.specification, memory_size=2)) for kind in (Probe, _InPlace))
    for simulator in (honest, other):
        simulator.reset(np.array([[0.25], [3.0]]))
    for action in (UP, DOWN, UP):
        expected, found = (simulator.advance(always(action, 2)) for simulator in (honest, other))
        assert found.samples.tolist() == expected.samples.tolist()
        assert other.signals.tolist() == honest.signals.tolist()
        assert other.t.tolist() == honest.t.tolist()
        assert other.last_action.tolist() == honest.last_action.tolist()


class TestBatchEnvironment:
    def test_an_episode_by_hand(self) -> None:
        """hold 4, T = 8: two decisions an episode. From x_0 = 0: .5 1 1.5 2, then 2 2 2 2."""
        task = line(hold=4, training={"starts": {"box": {"x": 0}}})
        method = Probe(task.specification)
        method.scale = 10.0
        environment = BatchEnvironment(task, method, 2, seed=0)
        assert environment.observation_size == 3
        assert environment.reset().tolist() == [[0, 0, -1]] * 2
        first = environment.step(always(UP, 2))
        assert first.reward.tolist() == [65.3 / 4] * 2  # as above, divided by the scale
        assert first.observation.tolist() == first.arrived.tolist() == [[2, 4, 0]] * 2
        assert first.cut.tolist() == first.ended.tolist() == [False, False]
        assert first.discount.tolist() == [1, 1]
        second = environment.step(always(STAY, 2))
        # 100 t + 20 + 2 at t = 4..7
        assert second.reward == pytest.approx([(100 * 22 + 4 * 22) / 4 / 10] * 2)
        assert second.cut.tolist() == second.ended.tolist() == [True, True]
        assert second.discount.tolist() == [1, 1]
        assert second.arrived.tolist() == [[2, 8, 1]] * 2  # where the episode ended
        assert second.observation.tolist() == [[0, 0, -1]] * 2  # where the next one begins
        assert environment.step(always(DOWN, 2)).arrived.tolist() == [[-2, 4, 0]] * 2

    def test_the_budget_counts_steps_of_all_copies(self) -> None:
        task = line(hold=4)
        environment = BatchEnvironment(task, Probe(task.specification), 3, seed=0)
        environment.reset()
        assert environment.taken == 0
        for _ in range(5):
            environment.step(always(UP, 3))
        assert environment.taken == 5 * 4 * 3

    def test_initial_states_depend_on_the_seed_alone(self) -> None:
        """Over three episodes, whatever the method, its memory and the actions."""
        task = line()

        def starts(memory_size: int, seed: int, action: int) -> list[float]:
            environment = BatchEnvironment(task, Probe(task.specification, memory_size), 4, seed)
            found = environment.reset()[:, 0].tolist()
            for _ in range(16):
                transition = environment.step(always(action, 4))
                found += transition.observation[transition.ended, 0].tolist()
            return found

        reference = starts(0, 5, UP)
        assert len(set(reference)) == 12
        assert min(reference) >= -1
        assert max(reference) <= 1
        assert starts(3, 5, DOWN) == reference
        assert starts(0, 6, UP) != reference

    def test_training_may_start_elsewhere_than_the_referee(self) -> None:
        task = line(training={"starts": {"box": {"x": [5, 6]}}})
        starts = BatchEnvironment(task, Probe(task.specification), 50, seed=1).reset()[:, 0]
        assert 5 <= starts.min() < starts.max() <= 6


class TestTrainingOptions:
    """What a task file's `training` changes, with the formula G[0,4] (x <= 1), T = 8, x moving by 0.5 a step."""

    def make(self, count: int = 2, hold: int = 2, x: object = 0, **training: object) -> BatchEnvironment:
        task = line(hold=hold, training={"starts": {"box": {"x": x}}} | training)
        return BatchEnvironment(task, Probe(task.specification), count, seed=0)

    def test_a_return_is_cut_at_a_phase_boundary_with_the_time_frozen_in_the_old_phase(self) -> None:
        environment = self.make(cuts=[4])
        environment.reset()
        assert environment.step(always(DOWN, 2)).cut.tolist() == [False] * 2
        second = environment.step(always(DOWN, 2))
        assert second.cut.tolist() == [True] * 2
        assert second.ended.tolist() == [False] * 2
        assert second.observation.tolist() == [[-2, 4, 0]] * 2  # the episode goes on
        assert second.arrived.tolist() == [[-2, 2, -0.5]] * 2  # valued as if it were still t = 2
        third = environment.step(always(DOWN, 2))
        assert third.arrived.tolist() == third.observation.tolist() == [[-3, 6, 0.5]] * 2
        last = environment.step(always(DOWN, 2))
        assert last.cut.tolist() == last.ended.tolist() == [True] * 2
        assert last.arrived.tolist() == [[-4, 8, 1]] * 2

    def test_a_violation_ends_the_episode_and_is_paid_for_ever(self) -> None:
        environment = self.make(ends=[VIOLATED])
        environment.reset()
        first = environment.step(np.array([UP, DOWN]))  # 1.0 and -1.0: x <= 1 holds with robustness 0
        assert first.discount.tolist() == [1, 1]
        second = environment.step(np.array([UP, DOWN]))
        assert second.discount.tolist() == [0, 1]
        assert second.ended.tolist() == second.cut.tolist() == [True, False]
        # the other copy, at t = 2 and 3: 200 - 15 - 1 and 300 - 20 - 1.5
        assert second.reward.tolist() == [-0.5, (184 + 278.5) / 2]
        assert second.arrived[0].tolist() == [2, 4, 0]
        assert second.observation.tolist() == [[0, 0, -1], [-2, 4, 0]]

    def test_beyond_the_interval_of_a_term_nothing_is_violated(self) -> None:
        environment = self.make(ends=[VIOLATED])
        environment.reset()
        for action in (DOWN, STAY, UP, UP):  # -1 at t = 4, then up to 1
            transition = environment.step(always(action, 2))
            assert transition.discount.all()
        assert transition.ended.all()

    def test_a_violation_within_a_held_action_counts_though_it_is_over_at_its_end(self) -> None:
        """x = 1.5 at t = 2, the last sample that the formula reads; and at t = 3."""
        task = line(hold=4, formula="G[0,2] (x <= 1)", training={"ends": [{"where": "violation"}]})
        environment = BatchEnvironment(task, Probe(task.specification), 2, seed=0)
        environment.reset()
        environment.simulator.reset(np.array([[0.5], [0.0]]))
        first = environment.step(always(UP, 2))
        assert first.discount.tolist() == [0, 1]

    def test_a_condition_ends_the_episode_at_any_time(self) -> None:
        environment = self.make(ends=[VIOLATED, {"where": "x <= -2"}])
        environment.reset()
        environment.step(always(STAY, 2))
        environment.step(always(STAY, 2))
        assert environment.step(np.array([UP, DOWN])).discount.all()  # 1 and -1 at t = 6, where no term counts
        last = environment.step(np.array([UP, DOWN]))
        assert last.discount.tolist() == [1, 0]
        assert last.reward[1] == -0.5

    def test_an_end_pays_the_method_s_floor_over_its_scale(self) -> None:
        class Mean(Probe):
            scale, floor = 4.0, -6.0

        task = line(formula="G[0,4] (x <= 1)", training={"ends": [VIOLATED, {"where": "x >= 1.5"}]})
        assert [end.reward for end in ends_of(task, Mean(task.specification))] == [-1.5, -1.5]
        environment = BatchEnvironment(task, Mean(task.specification), 1, seed=0)
        environment.reset()
        environment.simulator.reset(np.array([[1.0]]))
        assert environment.step(always(UP, 1)).reward.tolist() == [-1.5]

    def test_exploring_episodes_begin_at_every_decision_from_their_own_states(self) -> None:
        environment = self.make(400, exploring={"share": 0.5, "states": {"box": {"x": 7}}})
        observation = environment.reset()
        explored = observation[:, 0] == 7
        assert 0.4 < explored.mean() < 0.6
        assert set(observation[explored, 1]) == {0, 2, 4, 6}
        assert observation[~explored].tolist() == [[0, 0, -1]] * (~explored).sum()
        ended = environment.step(always(STAY, 400)).ended
        assert np.array_equal(ended, observation[:, 1] == 6)

    def test_exploring_episodes_may_begin_where_the_last_one_ended_and_be_broken_off(self) -> None:
        environment = self.make(1, exploring={"share": 1, "kept": 1, "length": 1})
        environment.reset()
        before = 0.0
        for _ in range(20):  # each lasts one decision: up by 1, then the next begins there
            transition = environment.step(always(UP, 1))
            assert transition.cut.tolist() == transition.ended.tolist() == [True]
            assert transition.arrived[0, 0] == transition.observation[0, 0] == before + 1
            before += 1

    def test_some_exploring_episodes_keep_the_last_state_and_the_others_are_drawn(self) -> None:
        environment = self.make(400, exploring={"share": 1, "kept": 0.5, "length": 1, "states": {"box": {"x": 7}}})
        environment.reset()
        environment.simulator.state[:] = 3.0
        begun = environment.step(always(UP, 400)).observation[:, 0]
        assert set(begun) == {4, 7}
        assert 0.4 < (begun == 4).mean() < 0.6

    def test_half_of_the_drawn_states_fulfil_the_condition_that_ends_next(self) -> None:
        """A quarter of all states are above 5, a quarter below -5. The bounds are five standard deviations wide."""
        near = [{"until": 5, "where": "x <= -5"}, {"until": 2, "where": "x >= 5"}, {"until": 7, "where": "x >= 11"}]
        exploring = {"share": 1, "states": {"box": {"x": [-10, 10]}}, "near": near}
        x, t = self.make(4000, exploring=exploring).reset()[:, :2].T
        for times, above, below in (([0, 2], 0.625, 0.125), ([4], 0.125, 0.625), ([6], 0.25, 0.25)):
            begun = x[np.isin(t, times)]
            assert abs((begun >= 5).mean() - above) < 0.08
            assert abs((begun <= -5).mean() - below) < 0.08

    def test_exploring_episodes_begin_like_all_others_where_no_states_are_named(self) -> None:
        observation = self.make(400, exploring={"share": 1}).reset()
        assert observation[:, 0].tolist() == [0] * 400
        assert set(observation[:, 1]) == {0, 2, 4, 6}

    def test_nothing_else_is_drawn_without_exploring_starts(self) -> None:
        plain, cut = self.make(3, x=[-1, 1]), self.make(3, x=[-1, 1], cuts=[2], ends=[VIOLATED])
        assert plain.reset().tolist() == cut.reset().tolist()
