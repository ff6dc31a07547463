"""Planning on odd tasks: edges of intervals, grids and numbers, each with what is known of the answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers import lattice
from helpers.lattice import Paid, Stepped
from pydantic import ValidationError

from stlbench import stl
from stlbench.contract import ActionGrid, Array, End, Integers, Model, Specification, Unsuitable
from stlbench_methods.machine import Machine
from stlbench_planning import maximin, sums
from stlbench_planning.grid import Axis, AxisRecipe, Grid

STARTS = np.array([[-2.0], [0.0], [2.0]])
SPEC = lattice.specification("G[0,6] x <= 1", 6)


def x(signals: Array, t: Integers) -> Array:
    found: Array = signals[..., 0]
    return found


def best(model: Model, gamma: float) -> list[float]:
    return [lattice.returns(model, lattice.every_plan(model, start), gamma).max() for start in STARTS]


def earned(model: Model, policy: sums.SumPolicy) -> Array:
    return lattice.returns(model, lattice.followed(model, policy, STARTS), policy.gamma)


class TestEndsAtTheGridsEdge:
    @pytest.mark.parametrize("reward", [2.0, -0.6])
    def test_an_end_counts_also_where_the_grid_ends(self, reward: float) -> None:
        """Where x = 4 is reached the episode is over, though the last point of the grid is 3."""
        end = End(lambda s: s[..., 0] >= 4, np.ones(7, dtype=bool), reward)
        model = lattice.model(Paid(SPEC, lambda s, t: -0.9 + 0 * s[..., 0]), ends=(end,))
        policy = sums.plan(model, *lattice.whole(model, 3), 0.9)
        np.testing.assert_allclose(policy.value(STARTS), best(model, 0.9), atol=1e-5)
        np.testing.assert_allclose(earned(model, policy), best(model, 0.9), atol=1e-5)


class TestNumbers:
    @pytest.mark.parametrize("scale", [1e-2, 1e4])
    def test_scales_far_from_the_rewards(self, scale: float) -> None:
        """The scale should be the size of the rewards; here it is 1000 times too small, and 1000 times too large.

        Beyond that, sums are as bad as what is lost, and differences are ties.
        """
        method = Paid(SPEC, lambda s, t: -np.abs(s[..., 0] - 5))
        method.scale = scale
        model = lattice.model(method)
        policy = sums.plan(model, *lattice.whole(model), 0.9)
        np.testing.assert_allclose(policy.value(STARTS), best(model, 0.9), rtol=1e-5)
        np.testing.assert_allclose(earned(model, policy), best(model, 0.9), rtol=1e-5)

    @pytest.mark.parametrize("gamma", [0.99, 0.995, 0.999])
    def test_of_going_on_for_ever_near_a_discount_of_1(self, gamma: float) -> None:
        """At 5 each decision pays -1: -1 / (1 - gamma), though thousands of decisions are not enough to sum it."""
        model = lattice.model(Paid(SPEC, lambda s, t: -np.abs(s[..., 0] - 5) - 1), cuts=(3,))
        policy = sums.plan(model, *lattice.whole(model), gamma)
        assert policy.value(np.array([[5.0]])).item() == pytest.approx(-1 / (1 - gamma), rel=1e-4)

    @pytest.mark.parametrize("kind", ["samples", "transitions"])
    def test_a_reward_that_is_not_a_number_is_refused(self, kind: str) -> None:
        """A maximum would pass over it without a word."""

        def pay(signals: Array, t: Integers) -> Array:
            return np.where(signals[..., 0] == 3, np.nan, 1.0)

        method = Paid(SPEC, pay) if kind == "samples" else Stepped(SPEC, lambda s, a, s_, t: pay(s_, t))
        model = lattice.model(method)
        with pytest.raises(ValueError, match="the method's reward is sometimes not a number"):
            sums.plan(model, *lattice.whole(model), 0.9)

    def test_an_infinite_penalty_is_avoided(self) -> None:
        model = lattice.model(Paid(SPEC, lambda s, t: np.where(s[..., 0] == 3, -np.inf, s[..., 0])))
        policy = sums.plan(model, *lattice.whole(model), 0.9)
        assert lattice.followed(model, policy, STARTS).samples.max() == 2


class TestGrids:
    @pytest.mark.parametrize("gamma", [1.0, 0.9])
    def test_of_two_points(self, gamma: float) -> None:
        """A reward x is linear, and so are its values, but for the edge; the plan is to go up all the same."""
        model = lattice.model(Paid(SPEC, x))
        grid = Grid((Axis(np.array([-90.0, 90.0])),))
        policy = sums.plan(model, grid, lattice.whole(model)[1], gamma)
        assert (lattice.followed(model, policy, STARTS).vectors == 1).all()


class Read(lattice.Lattice):
    """The lattice, with other signals than its state."""

    def __init__(self, read: Callable[[Array], Array]) -> None:
        super().__init__(("x",))
        self.read = read

    def signals(self, state: Array) -> Array:
        return self.read(state)


class TestSignals:
    @staticmethod
    def read(read: Callable[[Array], Array], pay: Callable[[Array, Integers], Array]) -> list[float]:
        """The value at 0, by samples and by transitions."""
        names = tuple(f"s{i}" for i in range(read(np.zeros((1, 1))).shape[1]))
        spec = Specification(stl.parse("G[0,6] s0 <= 1"), names, (-9,) * len(names), (9,) * len(names), 6, 1.0)
        found = []
        for method in (Paid(spec, pay), Stepped(spec, lambda s, a, s_, t: pay(s_, t))):
            model = lattice.model(method, actions=ActionGrid(("x",), ((-1.0, 0.0, 1.0),)))
            model = replace(model, system=Read(read))
            policy = sums.plan(model, *lattice.whole(replace(model, system=lattice.Lattice(("x",))), 6), 0.9)
            found.append(policy.value(np.zeros((1, 1))).item())
        return found

    @pytest.mark.parametrize("count", [5, 7])
    def test_more_than_a_grid_has_dimensions(self, count: int) -> None:
        """A table over them would be coarse, and read in four of them alone."""
        read = lambda s: np.stack([s[..., 0] * (i + 0.7) - i for i in range(count)], axis=-1)  # noqa: E731
        of_samples, of_steps = self.read(read, lambda s, t: -np.abs(s[..., 0] - 1.3) + 0.1 * s[..., 4])
        assert of_samples == pytest.approx(of_steps, abs=1e-5)

    def test_one_that_never_changes(self) -> None:
        read = lambda s: np.stack([s[..., 0], 0 * s[..., 0] + 2], axis=-1)  # noqa: E731
        of_samples, of_steps = self.read(read, lambda s, t: s[..., 0] * s[..., 1])
        assert of_samples == pytest.approx(of_steps, abs=1e-4)


class TestFormulas:
    @pytest.mark.parametrize("formula", ["G[0,3] true & F[1,4] x >= 1", "G[0,0] true & F[2,5] G[0,1] x <= -1"])
    def test_true_is_no_matter(self, formula: str) -> None:
        """Its robustness is infinite."""
        model = lattice.task(formula, 6)
        policy = maximin.plan(model, *lattice.whole(model))
        truth = [lattice.robustness(model, lattice.every_plan(model, start).samples).max() for start in STARTS]
        np.testing.assert_allclose(policy.value(STARTS), truth, atol=1e-5)

    def test_nothing_but_true(self) -> None:
        model = lattice.task("G[0,3] true", 6)
        policy = maximin.plan(model, *lattice.whole(model))
        assert (policy.value(STARTS) > 0).all()
        assert not lattice.followed(model, policy, STARTS).vectors.any()

    @pytest.mark.parametrize(
        ("formula", "hold"),
        [("F[1,2] G[1,3] x >= 1", 3), ("F[2,5] G[0,1] x >= 1", 6), ("F[0,1] G[1,2] x >= 0 & F[1,2] G[1,3] x >= 1", 3)],
    )
    def test_an_f_g_none_of_whose_windows_begins_with_a_decision_is_refused(self, formula: str, hold: int) -> None:
        """Else it would look as if no plan satisfied it."""
        model = lattice.task(formula, 6, hold)
        with pytest.raises(Unsuitable, match=rf"none of its windows begins with a decision, every {hold} samples"):
            maximin.plan(model, *lattice.whole(model))


class TestOverAtTheGridsEdge:
    @pytest.mark.parametrize("reach", [9, 3])
    def test_a_memory_that_is_over_counts_also_there(self, reach: int) -> None:
        """The goal x >= 4 pays 1 and is all; the last point of one grid is 3."""
        model = lattice.model(Machine(lattice.specification("F[0,4] x >= 4", 4)))
        policy, start = sums.plan(model, *lattice.whole(model, reach), 0.9), np.array([[0.0]])
        most = lattice.returns(model, lattice.every_plan(model, start[0]), 0.9).max()
        assert most == pytest.approx(0.9**3)
        np.testing.assert_allclose(policy.value(start), most, atol=1e-5)
        np.testing.assert_allclose(lattice.returns(model, lattice.followed(model, policy, start), 0.9), most, atol=1e-5)


class TestMarginsWithoutAValue:
    @pytest.mark.parametrize("formula", ["F[0,3] sqrt(x) >= 2.4", "F[0,3] x >= 8 & G[0,3] 1 / (x + 9) <= 1"])
    def test_the_plan_is_the_best_among_those_that_have_one(self, formula: str) -> None:
        """The grid has states, and steps out of it, at which a margin has no value."""
        model, start = lattice.task(formula, 3), np.array([[5.0]])
        policy = maximin.plan(model, *lattice.whole(model))
        most = lattice.robustness(model, lattice.every_plan(model, start[0]).samples).max()
        np.testing.assert_allclose(policy.value(start), most, atol=1e-5)
        np.testing.assert_allclose(
            lattice.robustness(model, lattice.followed(model, policy, start).samples), most, atol=1e-5
        )


@pytest.mark.parametrize("axis", [{"low": -np.inf, "high": 5}, {"low": 0, "high": 5, "near": [np.nan]}])
def test_an_axis_has_finite_ends_and_borders(axis: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match="finite"):
        AxisRecipe.model_validate(axis)
