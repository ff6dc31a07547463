"""Falsification against least robustness that is known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.line_task import Probe, Rule, line, steered
from helpers.made_subjects import ending, still, watched

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.search.actor import Actor, of_controller, of_policy
from stlbench.search.falsify import How, falsify
from stlbench.search.optimisers import OPTIMISERS
from stlbench.simulation.referee import Episodes

GLOBAL = [name for name in OPTIMISERS if name != "random"]


@pytest.mark.parametrize("optimiser", GLOBAL)
def test_the_bottom_of_a_well(optimiser: str) -> None:
    found = falsify(still(), How(optimiser, 3000, least=True))
    assert found.found
    assert found.worst.robustness == pytest.approx(-0.05, abs=2e-3)
    assert found.start == pytest.approx({"a": -0.7, "b": 0.3}, abs=2e-3)
    assert found.evaluations <= 3000


@pytest.mark.parametrize("optimiser", OPTIMISERS)
def test_a_region_with_a_condition(optimiser: str) -> None:
    """Of a + 2 b the least over a in [-1, 0], b in [0, 1], a + b >= -0.2 is that of the corner a = -0.2, b = 0."""
    box = {"box": {"a": [-1, 0], "b": [0, 1]}, "where": "a + b >= -0.2"}
    actor, met = watched(still("G[0,8] a + 2 * b >= -0.5", initial=box))
    found = falsify(actor, How(optimiser, 2000, least=True))
    assert not found.found
    assert found.worst.robustness == pytest.approx(0.3, abs=0.03)
    everything = np.concatenate(met)
    assert (everything.sum(axis=1) >= -0.2).all()
    assert len(everything) == found.evaluations <= 2000


@pytest.mark.parametrize("optimiser", OPTIMISERS)
def test_it_stops_at_a_counterexample_and_says_which_evaluation_was_the_first(optimiser: str) -> None:
    actor, met = watched(still("G[0,8] a <= -0.2"))
    found = falsify(actor, How(optimiser, 5000))
    violated = np.concatenate(met)[:, 0] > -0.2
    assert found.first == 1 + np.argmax(violated)
    assert found.evaluations == len(violated) < 5000
    assert not np.concatenate([np.zeros((0, 2)), *met[:-1]])[:, :1].max(initial=-1) > -0.2
    assert found.worst.robustness < 0


@pytest.mark.parametrize("optimiser", OPTIMISERS)
def test_the_same_rules_give_the_same_answer(optimiser: str) -> None:
    one, two = (falsify(still(), How(optimiser, 400, least=True, seed=3)) for _ in range(2))
    assert (one.evaluations, one.first, one.start) == (two.evaluations, two.first, two.start)


def test_random_points_use_all_evaluations_and_no_more() -> None:
    told = list[tuple[int, float]]()
    found = falsify(still("G[0,8] a <= 9"), How("random", 2500), lambda count, least: told.append((count, least)))
    assert found.evaluations == 2500
    assert [count for count, _ in told] == [64, 128, 256, 512, 1024, 2048, 2500]
    assert told[-1][1] == found.worst.robustness
    assert found.first is None


def test_a_single_start_takes_one_evaluation_and_a_fixed_coordinate_is_in_the_start() -> None:
    found = falsify(still("G[0,8] a >= 0", initial={"box": {"a": -0.25, "b": 1}}))
    assert (found.evaluations, found.first, found.worst.robustness) == (1, 1, -0.25)
    assert found.start == {"a": -0.25, "b": 1}
    found = falsify(still("G[0,8] a <= -0.1", initial={"box": {"a": [-1, 0], "b": 1}}), How(evaluations=300))
    assert (found.found, found.start["b"]) == (True, 1)


def test_the_subformula_that_failed() -> None:
    found = falsify(still("F[0,3] a <= 5 & G[2,4] (b <= 3 & a <= -0.3)"), How(evaluations=500, least=True))
    assert str(found.witness.conjunct) == "G[2,4] (b <= 3 & a <= -0.3)"
    assert (str(found.witness.predicate), found.witness.step) == ("a <= -0.3", 2)
    assert found.witness.robustness == found.worst.robustness == pytest.approx(-0.3, abs=1e-2)


def test_at_robustness_zero_the_verdict_decides() -> None:
    strict = falsify(still("G[0,8] a < -0.5", initial={"box": {"a": -0.5, "b": 0}}))
    assert strict.found
    assert not falsify(still("G[0,8] a <= -0.5", initial={"box": {"a": -0.5, "b": 0}})).found


def test_a_policy_in_a_simulation() -> None:
    """Action 2 goes up by 0.5 a step: from x_0 the robustness of G[0,4] x <= 1 is 1 - x_0 - 2."""
    task = line()
    policy = of_policy("up", ("up",), task, Probe(task.specification), Rule(lambda observation: 2))
    found = falsify(policy, How(evaluations=600, least=True))
    assert found.worst.robustness == pytest.approx(-2, abs=1e-3)
    assert found.worst.trace[:5, 0].tolist() == pytest.approx((1 + 0.5 * np.arange(5)).tolist(), abs=1e-3)
    assert (found.witness.step, found.start["x"]) == (4, pytest.approx(1, abs=1e-3))


def test_a_controller_by_hand() -> None:
    down = of_controller(steered(lambda state, t: -np.ones_like(state)))
    assert falsify(down, How(evaluations=600, least=True)).worst.robustness == pytest.approx(0, abs=1e-3)
    with pytest.raises(UsageError, match="task line has no controller by hand"):
        of_controller(line())


def test_a_violation_comes_before_an_open_verdict() -> None:
    """Above a = -0.1 the start violates. What ends early above -0.3 is open, and a may become 4: as bad as those."""
    cut = ending(still("G[0,8] a <= -0.1", terminated="interval"), 3, -0.3)
    found = falsify(cut, How("random", evaluations=500, least=True))
    assert (found.worst.verdict, found.worst.robustness) == ("violated", pytest.approx(-4.1))
    assert found.first is not None
    assert found.start["a"] > -0.1
    known = cut.play(found.worst.point[None])
    assert (known.satisfied.tolist(), known.possible.tolist()) == ([False], [False])


def test_bad_input() -> None:
    with pytest.raises(UsageError, match="no optimiser 'evolution'; did you mean 'differential-evolution'"):
        falsify(still(), How("evolution"))
    with pytest.raises(UsageError, match="at least one evaluation, got 0"):
        falsify(still(), How(evaluations=0))
    with pytest.raises(UsageError, match=r"^still cannot be tried: sqrt"):
        falsify(still("G[0,8] sqrt(a) <= 1"))
    hopeless = {"box": {"a": [-1, 0], "b": [0, 1]}, "where": "a >= 1"}
    with pytest.raises(UsageError, match="'a >= 1' holds \\(almost\\) nowhere"):
        falsify(still(initial=hopeless), How(evaluations=50))


@pytest.mark.parametrize("evaluations", [1, 2, 3])
@pytest.mark.parametrize("optimiser", OPTIMISERS)
def test_few_evaluations_meet_a_start_in_a_small_part_of_the_box(optimiser: str, evaluations: int) -> None:
    """It has 2 % of it."""
    corner = {"box": {"a": [-1, 0], "b": [0, 1]}, "where": "a <= -0.9 & b <= 0.2"}
    assert falsify(still(initial=corner), How(optimiser, evaluations)).evaluations in range(1, evaluations + 1)


def test_many_rows_are_simulated_in_parts() -> None:
    sizes = list[int]()
    actor = still("G[0,2000000] a <= 9", steps=2_000_000)

    def record(starts: Array) -> Episodes:
        sizes.append(len(starts))
        traces = np.broadcast_to(starts[:, None], (len(starts), 2_000_001, 2))
        return Episodes(traces, np.full(len(starts), 2_000_000))

    small: Actor = replace(actor, record=record)
    assert small.rows == 1
    falsify(small, How("random", 2))
    assert sizes == [1, 1]
