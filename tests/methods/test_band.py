"""The bounds that methods give for figures: the funnel's worked out by hand, none of the others'."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.episodes import specification
from helpers.stepwise import one_step

from stlbench.contract.presentation import Banded
from stlbench_methods.flag import Flag
from stlbench_methods.funnel import Funnel
from stlbench_methods.raw import Raw

NEAR = 1e-5
BOX = {"x": (-2.0, 2.0)}


def test_the_funnel_of_a_sequence() -> None:
    """Eq. 5 for F[4,8] (x >= 1) & G[12,20] (abs(x) <= 1), gamma_inf = .5, as in test_funnel.

    gamma(t) = 3.5 * 7^(-t/8) + .5 from 0 to 8; then 1.5 * 3^(-(t-8)/4) + .5 from 8 to 20; rho_max = 1 for both.
    """
    spec = specification("F[4,8] x >= 1 & G[12,20] abs(x) <= 1", BOX, steps=22)
    first, second = Funnel(spec, ginf=0.5).band()
    assert (first.term, second.term) == spec.terms
    assert (first.start, second.start) == (0, 8)
    assert first.lower == pytest.approx([0.5 - 3.5 * 7 ** (-t / 8) for t in range(9)], abs=NEAR)
    assert second.lower == pytest.approx([0.5 - 1.5 * 3 ** (-(t - 8) / 4) for t in range(8, 21)], abs=NEAR)
    assert first.lower[8] == pytest.approx(0, abs=NEAR)  # t* = b: the lower bound reaches 0 at the deadline
    assert second.lower[4] == pytest.approx(0, abs=NEAR)  # t* = a
    assert first.upper == pytest.approx(np.ones(9), abs=NEAR)
    assert second.upper == pytest.approx(np.ones(13), abs=NEAR)


def test_the_funnel_of_always_from_the_start_is_flat_or_has_its_middle_at_zero() -> None:
    spec = specification("G[0,10] x >= 0", BOX, steps=12)
    (paper,) = Funnel(spec, ginf=0.25).band()
    assert paper.lower == pytest.approx(np.full(11, 1.75), abs=NEAR)
    (code,) = Funnel(spec, ginf=0.25, variant="code").band()
    assert (code.lower[0], code.lower[5]) == pytest.approx((-2, 0), abs=NEAR)


def test_a_reward_is_positive_exactly_inside_the_linear_funnel() -> None:
    method = Funnel(specification("F[2,6] G[1,3] x >= 0.5", BOX, steps=10), ginf=0.1)
    (band,) = method.band()
    for t in range(1, len(band.lower)):
        for x, inside in ((band.lower[t] + 0.5 + 0.01, True), (band.lower[t] + 0.5 - 0.01, False)):
            arrived = np.array([[x]])
            reward, _ = one_step(method, arrived, np.zeros((1, 1)), arrived, np.array([t - 1]), np.zeros((1, 0)))
            assert (reward[0] > 0) == inside


def test_other_methods_have_none() -> None:
    spec = specification("G[0,10] x >= 0", BOX, steps=12)
    assert isinstance(Funnel(spec), Banded)
    assert not isinstance(Raw(spec), Banded)
    assert not isinstance(Flag(spec), Banded)
