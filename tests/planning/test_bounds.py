"""The best that is possible bounds what policies reach, and nears the truth as the grid gets finer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import lattice
from helpers.lattice import Paid

from stlbench.contract import ActionGrid, Array, StatePolicy
from stlbench_planning import maximin, sums
from stlbench_planning.grid import Axis, Grid

STEPS = 12
STARTS = np.arange(-2.0, 3.0)[:, None]
FORMULAS = (
    "F[2,7] x >= 3 & G[8,12] x <= 0 & G[4,4] abs(x) <= 1",
    "F[1,12] x >= 3 & F[1,12] x <= -3 & F[6,9] abs(x) <= 0.5",
    "F[1,8] G[1,4] abs(x - 2) <= 0.5 & G[6,12] x >= -1",
)


class TestUpperBound:
    @pytest.mark.parametrize(
        ("formula", "hold"), [*((formula, hold) for formula in FORMULAS[:2] for hold in (1, 3)), (FORMULAS[2], 1)]
    )
    def test_no_random_plan_is_better(self, formula: str, hold: int) -> None:
        """There are too many to try all. With hold > 1, an F G term's value is a lower bound; see test_maximin."""
        model = lattice.task(formula, STEPS, hold)
        policy = maximin.plan(model, *lattice.whole(model, 16))
        vectors = np.random.default_rng(5).integers(-1, 2, size=(STEPS // hold, 2000, 1)).repeat(hold, axis=0)
        samples = np.concatenate([np.zeros((1, 2000, 1)), vectors.cumsum(axis=0)])
        for start, value in zip(STARTS, policy.value(STARTS), strict=True):
            assert (lattice.robustness(model, start + samples) <= value + 1e-5).all()

    @pytest.mark.parametrize("gamma", [1.0, 0.9])
    def test_no_plan_for_a_reward_is_better(self, gamma: float) -> None:
        model = lattice.task(FORMULAS[2], STEPS)
        best = maximin.plan(model, *lattice.whole(model, 16))
        for pay in (lambda s, t: s[..., 0], lambda s, t: -np.abs(s[..., 0] - 3.0 * (t < 8))):
            rewarded = replace(model, method=Paid(model.method.specification, pay))
            policy: StatePolicy = sums.plan(rewarded, *lattice.whole(model, 16), gamma)
            reached = lattice.robustness(model, lattice.followed(rewarded, policy, STARTS).samples)
            assert (reached <= best.value(STARTS) + 1e-5).all()


class Growing(lattice.Lattice):
    """x' = 1.2 x, whatever is done."""

    def __init__(self) -> None:
        super().__init__(("x",))

    def step(self, state: Array, action: Array) -> Array:
        return 1.2 * state


class TestResolution:
    def test_values_rise_to_the_truth_where_they_are_concave(self) -> None:
        """The truth is 1 - 1.2^4 |x|. Between points of a concave function lines lie below it, the lower the farther
        apart the points are; and each finer grid has all points of the coarser one. 0, the peak, is in none.
        """
        model = lattice.task("G[1,4] abs(x) <= 1", 4)
        model = replace(model, system=Growing(), actions=ActionGrid(("x",), ((0.0,),)))
        starts = np.linspace(-2, 2, 41)[:, None]
        truth = 1 - 1.2**4 * np.abs(starts[:, 0])
        before, errors = np.full(len(starts), -np.inf), []
        for points in (65, 257, 1025, 2049):
            grid = Grid((Axis(np.linspace(-110, 130, points)),))
            value = maximin.plan(model, grid, lattice.whole(model)[1]).value(starts)
            assert (value >= before - 1e-5).all()
            assert (value <= truth + 1e-5).all()
            before, errors = value, [*errors, float(np.abs(truth - value).max())]
        assert errors[-1] < 0.05 * errors[0]

    def test_with_a_choice_the_error_is_a_share_of_the_interval(self) -> None:
        """A point that may move by .37 within 6 steps. Each step's reading is off by less than an interval."""
        actions = ActionGrid(("x",), ((-0.37, 0.0, 0.37),))
        model = replace(lattice.task("F[3,6] x >= 1 & G[6,6] x <= 0.5", 6), actions=actions)
        starts = np.linspace(-1, 1, 21)[:, None]
        truth = [lattice.robustness(model, lattice.every_plan(model, start).samples).max() for start in starts]
        for points in (31, 121):
            grid = Grid((Axis(np.linspace(-6, 6, points)),))
            policy = maximin.plan(model, grid, lattice.whole(model)[1])
            assert (np.abs(policy.value(starts) - truth) <= 12 / (points - 1)).all()
            reached = lattice.robustness(model, lattice.followed(model, policy, starts).samples)
            assert (reached <= np.array(truth) + 1e-5).all()
