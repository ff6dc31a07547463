"""The best that is possible, against trying all plans: what the planner promises, and what its policy reaches.

The formulas are generated: one to three terms of the fragment, whose intervals overlap as they like.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers import lattice
from hypothesis import given, settings
from hypothesis import strategies as st

from stlbench import stl
from stlbench.contract import Array, Model
from stlbench_planning import maximin

STEPS = 6
STARTS = np.arange(-2.0, 3.0)[:, None]
PSI = [
    stl.parse(text)
    for text in (
        "x >= 2",
        "x <= -1",
        "x >= -0.5",
        "abs(x - 1) <= 0.5",
        "abs(x) >= 2",
        "x >= 1 | x <= -2",
        "0 * x >= -1",
    )
]
EVERY_TERM = ("F", "G", "FG")


@st.composite
def terms(draw: Any, kinds: tuple[str, ...] = EVERY_TERM) -> stl.Formula:
    """One term with an interval in 0..6, of any length from one sample on."""
    kind, psi = draw(st.sampled_from(kinds)), draw(st.sampled_from(PSI))
    a = draw(st.integers(0, STEPS))
    b = draw(st.integers(a, STEPS))
    if kind != "FG":
        return (stl.Always if kind == "G" else stl.Eventually)(a, b, psi)
    c2 = draw(st.integers(0, STEPS - b))
    return stl.Eventually(a, b, stl.Always(c2, draw(st.integers(c2, STEPS - b)), psi))


def formulas(kinds: tuple[str, ...] = EVERY_TERM) -> st.SearchStrategy[stl.Formula]:
    several = st.lists(terms(kinds), min_size=1, max_size=3)
    return several.map(lambda found: stl.And(tuple(found)) if len(found) > 1 else found[0])


def planned(model: Model, reach: int = lattice.REACH) -> maximin.MaximinPolicy:
    return maximin.plan(model, *lattice.whole(model, reach))


def best(model: Model, start: Array) -> float:
    return float(lattice.robustness(model, lattice.every_plan(model, start).samples).max())


def windows(term: stl.Term, hold: int) -> list[int]:
    """The first samples of an F G term's windows that the planner looks at: those that a decision begins with.

    All of them where the term is a G or an F term, too.
    """
    begins = range(term.start, term.c1 + term.c2 + 1)
    if term.a == term.c1 or term.b == term.c2:
        return list(begins)
    return [t for t in begins if t >= 1 and (t - 1) % hold == 0]


def narrowed(model: Model, samples: Array) -> Array:
    """The robustness of traces (T + 1, P, k) as the planner reads the formula: with those windows alone."""
    least = np.full(samples.shape[1], np.inf)
    for term in stl.fragment(model.formula):
        margins = stl.margin(term.psi, ("x",))(samples)
        if term.kind == "FG":
            lasts = term.b - term.c2 + 1
            worth = np.max([margins[t : t + lasts].min(axis=0) for t in windows(term, model.hold)], axis=0)
        else:
            of = margins[term.a : term.b + 1]
            worth = of.min(axis=0) if term.kind == "G" else of.max(axis=0)
        least = np.minimum(least, worth)
    return least


def has_windows(model: Model) -> bool:
    return all(windows(term, model.hold) for term in stl.fragment(model.formula) if term.kind == "FG")


class TestAgainstAllPlans:
    @settings(max_examples=150, deadline=None)
    @given(formulas(), st.sampled_from([1, 2, 3, 6]))
    def test_it_is_the_best_of_windows_that_begin_with_a_decision(self, formula: stl.Formula, hold: int) -> None:
        """So of F and G terms the best there is. Else a lower bound of it, which the policy reaches or exceeds."""
        model = lattice.task(formula, STEPS, hold)
        if not has_windows(model):
            return
        policy = planned(model)
        tried = [lattice.every_plan(model, start).samples for start in STARTS]
        value = policy.value(STARTS)
        np.testing.assert_allclose(value, [narrowed(model, samples).max() for samples in tried], atol=1e-5)
        reached = lattice.robustness(model, lattice.followed(model, policy, STARTS).samples)
        assert (reached >= value - 1e-5).all()
        assert (reached <= [lattice.robustness(model, samples).max() + 1e-5 for samples in tried]).all()

    @pytest.mark.parametrize("hold", [1, 2])
    def test_on_a_plane(self, hold: int) -> None:
        formula = "F[1,3] x >= 2 & G[2,4] (y <= 0 | x <= 1) & F[0,2] G[1,2] norm(x - 1, y - 1) <= 0.5"
        model = lattice.task(formula, 4, hold, ("x", "y"))
        policy = planned(model, 6)
        starts = np.array([[0.0, 0.0], [1.0, -1.0], [-1.0, 2.0]])
        reached = lattice.robustness(model, lattice.followed(model, policy, starts).samples)
        truth = [best(model, start) for start in starts]
        assert (policy.value(starts) <= np.array(truth) + 1e-5).all()
        np.testing.assert_allclose(policy.value(starts), reached, atol=1e-5)
        if hold == 1:
            np.testing.assert_allclose(reached, truth, atol=1e-5)


class TestByHand:
    def test_an_f_is_not_put_off_for_ever(self) -> None:
        """Robustness 2 is reached at any one sample, and a policy that knows no stages could wait at each."""
        model = lattice.task("F[1,6] x >= 1", STEPS)
        trace = lattice.followed(model, planned(model), np.array([[-3.0]])).samples
        assert trace.max() == 3

    def test_two_places_in_one_time(self) -> None:
        """From 0 there are just six steps for going to 2 and then to -2, or the other way."""
        model = lattice.task("F[1,6] x >= 2 & F[1,6] x <= -2", STEPS)
        policy, start = planned(model), np.zeros((1, 1))
        trace = lattice.followed(model, policy, start).samples
        assert (policy.value(start).item(), trace.min(), trace.max()) == (0, -2, 2)

    def test_a_later_window_is_taken_where_it_is_better(self) -> None:
        model = lattice.task("F[0,3] G[1,3] x >= 3", STEPS)
        trace = lattice.followed(model, planned(model), np.array([[0.0]])).samples[:, 0, 0]
        assert trace.tolist()[4:] == [4, 5, 6]

    def test_what_leaves_the_grid_is_lost(self) -> None:
        model = lattice.task("F[6,6] x >= 0", STEPS)
        policy = planned(model, 3)
        assert policy.value(np.array([[1.0]])).item() == pytest.approx(3)
        assert lattice.followed(model, policy, np.array([[1.0]])).samples.max() == 3

    def test_of_equal_plans_the_smallest_actions_are_taken(self) -> None:
        """What counts is the first sample after the start; then the point stays where it is."""
        model = lattice.task("F[1,1] x >= 0", STEPS)
        assert lattice.followed(model, planned(model), np.zeros((1, 1))).vectors.ravel().tolist() == [1, 0, 0, 0, 0, 0]
