"""Scores of traces that were made by hand, and what does not enter them."""

from __future__ import annotations

import typing

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, formulas, traces
from helpers.line_task import Probe, Rule, line
from hypothesis import given, settings

from stlbench import stl
from stlbench.contract import Array, Integers
from stlbench.records.result import MAIN, RANDOM, Score, Summary, reported
from stlbench.simulation.referee import Referee, record, score
from stlbench.simulation.verdicts import lost_at
from stlbench.task import starts

THREE = "G[0,2] x <= 1 & F[0,3] x >= 5 & G[4,6] x <= 3"


EITHER = "G[0,4] x <= 1 | F[0,2] x >= 5"


def scored(formula: str, *traces: list[float]) -> Score:
    return score(line(), np.array(traces, dtype=float)[..., None], stl.parse(formula))


class TestScore:
    def test_robustness_and_satisfaction(self) -> None:
        """min of 1 - max over 0..2, the largest x - 5 over 0..3, 3 - max over 4..6."""
        found = scored(THREE, [0, 0, 0, 6, 0, 0, 0], [0, 0, 0, 6, 0, 5, 0], [0, 0, 0, 2, 0, 0, 0])
        assert found.robustness == (1, -2, -3)
        assert found.satisfied == (True, False, False)
        assert (found.minimum, found.mean) == (-3, pytest.approx(-4 / 3))
        assert found.satisfaction == pytest.approx(1 / 3)

    def test_satisfaction_is_not_the_sign_of_the_robustness(self) -> None:
        assert scored("G[0,1] x <= 1", [1, 0]) == Score((0.0,), (True,), {})
        strict = scored("G[0,1] x < 1", [1, 0])
        assert (strict.robustness, strict.satisfied) == ((0.0,), (False,))

    @pytest.mark.parametrize(
        ("trace", "first"),
        [
            ([0, 2, 0, 6, 0, 0, 0], "G[0,2] x <= 1"),  # lost at 1
            ([0, 0, 0, 2, 0, 0, 0], "F[0,3] x >= 5"),  # at 3, its deadline
            ([0, 0, 0, 6, 0, 5, 0], "G[4,6] x <= 3"),  # at 5
            ([0, 0, 0, 2, 4, 4, 4], "F[0,3] x >= 5"),  # at 3, before the third at 4
            ([0, 0, 2, 2, 4, 4, 4], "G[0,2] x <= 1"),  # at 2, all three lost
            ([0, 0, 0, 6, 0, 0, 4], "G[4,6] x <= 3"),  # in the last sample
            ([9, 0, 0, 0, 0, 0, 0], "G[0,2] x <= 1"),  # in the first one, which reaches the goal
        ],
    )
    def test_the_conjunct_that_is_lost_first(self, trace: list[float], first: str) -> None:
        assert scored(THREE, trace).first_failed == {first: 1}

    def test_failures_are_counted_by_conjunct_and_only_those_of_violations(self) -> None:
        good, early, late = [0, 0, 0, 6, 0, 0, 0], [2, 0, 0, 6, 0, 0, 0], [0, 0, 0, 6, 4, 0, 0]
        found = scored(THREE, good, early, late, early, good)
        assert found.first_failed == {"G[0,2] x <= 1": 2, "G[4,6] x <= 3": 1}
        assert scored(THREE, good, good).first_failed == {}

    @pytest.mark.parametrize(
        ("formula", "trace", "first"),
        [
            ("G[0,2] x <= 1 & (F[0,3] x >= 5 & G[4,6] x <= 3)", [0, 0, 0, 6, 0, 5, 0], "G[4,6] x <= 3"),
            ("F[0,2] G[0,2] (x <= 1 | x >= 9)", [2, 2, 2, 2, 2], "F[0,2] G[0,2] (x <= 1 | x >= 9)"),
            # G[0,4] is lost at 1, F[0,2] at 2; the second conjunct at 1 as well, and before it
            (f"({EITHER}) & F[0,1] x >= 2", [0, 2, 0, 0, 0], EITHER),
            (f"({EITHER}) & F[0,1] x >= 2", [0, 1.5, 0, 0, 0], "F[0,1] x >= 2"),
        ],
    )
    def test_conjuncts_are_taken_apart_and_a_disjunction_is_lost_with_its_last_hope(
        self, formula: str, trace: list[float], first: str
    ) -> None:
        assert scored(formula, trace).first_failed == {first: 1}


def lost_by_definition(formula: stl.Formula, trace: Array) -> int:
    """The length of the shortest beginning that no continuation can save, less 1; or the trace's length."""
    for length in range(1, len(trace) + 1):
        if not stl.satisfaction_bounds(formula, trace[:length], NAMES).possibly:
            return length - 1
    return len(trace)


@settings(max_examples=60)
@given(formulas(longest=4, leaves=4, endless=True), SEEDS)
def test_when_a_formula_is_lost(formula: stl.Formula, seed: int) -> None:
    batch = traces(9, seed, (4,))
    expected = [lost_by_definition(formula, trace) for trace in batch]
    assert lost_at(formula, batch, NAMES).tolist() == expected


UP = 2
PROTOCOLS = {
    "tail": {"title": "the end alone", "formula": "G[6,8] (x <= 1)"},
    "far": {"title": "from far away", "initial": {"box": {"x": [2, 3]}}, "starts": 3},
    "both": {"title": "both", "formula": "F[7,8] (x >= 4)", "initial": {"box": {"x": 0}}, "starts": 1},
}


class TestReferee:
    def test_a_recorded_trace_has_every_step(self) -> None:
        task = line(hold=4)
        # up while t < 4, then down: the policy sees x, t and the time
        policy = Rule(lambda seen: np.where(seen[:, 1] < 4, 2, 0))
        traces = record(task, Probe(task.specification), policy, np.array([[0.0], [1.0]])).traces[..., 0]
        assert traces[0].tolist() == [0, 0.5, 1, 1.5, 2, 1.5, 1, 0.5, 0]
        assert traces[1].tolist() == [1, 1.5, 2, 2.5, 3, 2.5, 2, 1.5, 1]

    def test_a_policy_gets_the_methods_inputs(self) -> None:
        task = line()
        # The memory counts transitions: it is 0, 1, .. 7 when the policy acts.
        policy = Rule(lambda seen: np.where(seen[:, 3] < 3, 2, 1))
        traces = record(task, Probe(task.specification, memory_size=1), policy, np.array([[0.0]])).traces
        assert traces[0, :, 0].tolist() == [0, 0.5, 1, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5]

    def test_protocols(self) -> None:
        """Always up from x_0: x_t = x_0 + t / 2. Formula: min over 0..4 of 1 - x = -1 - x_0."""
        task = line(protocols=PROTOCOLS)
        report = Referee(task, Probe(task.specification)).assess(Rule(lambda seen: UP))
        assert set(report.scores) == {MAIN, "tail", "far", "both"}
        begin = starts.grid(task.file.initial, 4)[:, 0]
        assert report.traces == pytest.approx(begin[:, None, None] + np.arange(9)[None, :, None] / 2)
        assert report.scores[MAIN].robustness == pytest.approx(-1 - begin)
        far = starts.grid(task.file.protocols["far"].initial or task.file.initial, 3)[:, 0]
        assert far.min() >= 2
        assert report.scores["far"].robustness == pytest.approx(-1 - far)
        # starts of a protocol: 64 unless it says otherwise, on the task's own region
        assert report.scores["tail"].robustness == pytest.approx(-3 - starts.grid(task.file.initial, 64)[:, 0])
        assert report.scores["both"].robustness == (0,)  # x_8 = 4
        assert report.scores["both"].satisfied == (True,)

    def test_selection_is_on_other_starts_than_the_report(self) -> None:
        task = line(starts=8)
        referee, policy = Referee(task, Probe(task.specification)), Rule(lambda seen: UP)
        own, others = (states[:, 0] for states in task.starts.report_and_selection())
        assert not set(others.round(9)) & set(own.round(9))
        # robustness is -1 - x_0 here
        assert referee.select(policy) == (0.0, pytest.approx(-1 - others.mean()))
        assert referee.assess(policy).scores[MAIN].robustness == pytest.approx(-1 - own)

    def test_checkpoints_side_by_side_have_the_scores_that_each_has_alone(self) -> None:
        """Bit for bit, memories and held actions included; more of them than are simulated at a time."""
        task = line(hold=2, starts=8, formula="G[0,8] (x <= 2) | F[0,8] (x <= -1)")
        probe = Probe(task.specification, memory_size=1)
        # they turn at different times: the memory counts steps
        policies = [Rule(lambda seen, k=k: np.where(seen[:, 3] < k % 9, 2, k % 3)) for k in range(150)]
        referee = Referee(task, probe)
        found = referee.choose(policies)
        alone = [referee.select(policy) for policy in policies]
        assert found.starts.tolist() == [8] * 150
        assert list(zip(found.satisfaction.tolist(), found.robustness_mean.tolist(), strict=True)) == alone
        assert len(set(alone)) == 4
        assert found.best == alone.index(max(alone))

    def test_a_race_of_checkpoints_is_on_the_first_starts_first(self) -> None:
        task = line(starts=16)
        referee = Referee(task, Probe(task.specification))
        found = referee.choose([Rule(lambda seen: UP), Rule(lambda seen: 0)])  # robustness -1 - x_0 and 1 - x_0
        others = task.starts.report_and_selection()[1][:, 0]
        assert (found.best, found.starts.tolist()) == (1, [8, 16])  # the best goes on to the others
        assert found.robustness_mean == pytest.approx([-1 - others[:8].mean(), 1 - others.mean()])
        # a first part is as even as the whole
        assert abs(others[:8].mean() - others.mean()) < 0.1
        assert np.ptp(others[:8]) > 1.5

    def test_a_policy_that_was_looked_at_is_not_played_again(self) -> None:
        """It satisfies from all starts for selection. The other is played."""
        task = line(starts=16, formula="G[0,8] (x <= 20)")
        seen_by = list[int]()

        def still(seen: Array) -> Integers:
            seen_by.append(len(seen))
            return np.zeros(len(seen), dtype=np.int64)

        referee, looked, other = Referee(task, Probe(task.specification)), Rule(still), Rule(lambda seen: UP)
        assert referee.look(looked) == referee.select(looked)
        seen_by.clear()
        found = referee.choose([other, looked])
        assert seen_by == []
        assert found.best == 1
        scored = (found.satisfaction[1], found.robustness_mean[1])
        assert scored == pytest.approx(Referee(task, Probe(task.specification)).select(looked))
        assert referee.choose([looked]).starts.tolist() == [16]

    def test_no_reward_enters_a_score(self) -> None:
        class Absurd(Probe):
            def step(
                self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
            ) -> tuple[Array, Array]:
                return np.full(len(signals), np.nan), memory

        task = line(protocols=PROTOCOLS)
        policy = Rule(lambda seen: np.where(seen[:, 0] > 0, 0, 2))
        honest = Referee(task, Probe(task.specification)).assess(policy)
        absurd = Referee(task, Absurd(task.specification)).assess(policy)
        assert honest.scores == absurd.scores
        assert np.array_equal(honest.traces, absurd.traces)


class TestRandomStarts:
    """x falls by 1 m per step from starts in [-1, 3]; the formula wants x <= 1 over steps 0..4."""

    BOX: typing.ClassVar = {"box": {"x": [-1, 3]}}

    def test_the_report_has_a_summary_of_them_and_that_is_what_counts(self) -> None:
        task = line(initial=self.BOX)
        referee = Referee(task, Probe(task.specification), random_starts=1000)
        scores = referee.assess(Rule(lambda observation: 0)).scores
        found = scores[RANDOM]
        assert found.summary == Summary(found.mean, found.minimum, found.satisfaction, 1000)
        assert (found.starts, scores[MAIN].starts) == (1000, task.file.starts)
        assert (found.robustness, found.satisfied) == ((), ())
        assert reported(scores) == found
        assert found.satisfaction == pytest.approx(0.5, abs=0.08)  # 5 binomial standard deviations
        assert found.mean == pytest.approx(0.0, abs=0.19)  # of 1 - x at the start, as x falls from there on
        assert found.first_failed == {"G[0,4] x <= 1": 1000 - round(1000 * found.satisfaction)}

    def test_they_are_the_same_for_every_method_and_no_others_are_scored_without_them(self) -> None:
        task = line(initial=self.BOX)
        first, second = (
            Referee(task, Probe(task.specification, memory), random_starts=100).assess(Rule(lambda seen: 2)).scores
            for memory in (0, 3)
        )
        assert first[RANDOM] == second[RANDOM]
        without = Referee(task, Probe(task.specification)).assess(Rule(lambda seen: 2)).scores
        assert without == {MAIN: first[MAIN]}
        assert reported(without) == first[MAIN]
