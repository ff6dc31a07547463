"""raw: eq. 18 of the paper, the robustness of the term whose turn it is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.episodes import run, specification
from helpers.stepwise import one_step

from stlbench.task import load_task
from stlbench_methods.raw import Raw


def test_eq_18_on_the_navigation_task() -> None:
    """rho_psi1 = 2 - |(x,y) - (25,25)| for t <= 1300, then rho_psi2 = 2 - |(x,y) - (30,30)|.

    From (22, 21): distances 5 = |(3,4)| and sqrt(64 + 81). From (30, 30): sqrt(50) and 0. After step 2000 there is no
    sample. The reward of the transition t is that of sample t + 1.
    """
    method = Raw(load_task("robot-nav").specification)
    sample = np.array([1, 900, 1300, 1301, 1600, 2000])
    for place, first, second in [((22, 21), 2 - 5, 2 - math.sqrt(145)), ((30, 30), 2 - math.sqrt(50), 2.0)]:
        here = np.tile(np.array(place, dtype=float), (6, 1))
        nowhere = np.full((6, 2), -5.0)  # where the transition comes from has no part in the reward
        reward, memory = one_step(method, nowhere, np.zeros((6, 2)), here, sample - 1, np.zeros((6, 0)))
        assert reward == pytest.approx([first] * 3 + [second] * 3)
        assert memory.shape == (6, 0)


def test_the_scale_is_the_widest_range_of_a_term() -> None:
    # x >= 1 over [-2, 2] has robustness in [-3, 1]; abs(x) <= 1 in [-1, 1].
    method = Raw(specification("F[1,2] x >= 1 & G[4,5] abs(x) <= 1", {"x": (-2, 2)}))
    assert method.scale == pytest.approx(4)


@pytest.mark.parametrize(
    ("text", "last", "literal"),
    [
        ("G[0,3] x <= 1 & F[2,5] y >= 2", [0.5, 0.5, 0.5, 1, 1, 0, 0], [0.5, 0.5, 0.5, 1, 1, 0, 0]),
        ("F[2,5] y >= 2", [1, 1, 1, 1, 1, 0, 0], [0, 1, 1, 1, 1, 0, 0]),
        ("G[3,3] x <= 1 & F[3,6] y >= 2", [0.5, 0.5, 0.5, 1, 1, 1, 0], [0, 0, 0.5, 1, 1, 1, 0]),
    ],
    ids=["overlap takes the minimum", "a gap pays nothing", "one sample is paid up to it"],
)
def test_whose_turn_it_is(text: str, last: list[float], literal: list[float]) -> None:
    spec = specification(text, {"x": (-3.0, 3.0), "y": (-3.0, 3.0)}, steps=7)
    trace = np.tile([[0.5, 3.0]], (8, 1))[None]  # robustness .5 and 1 throughout
    assert run(Raw(spec), trace)[0][0, 1:].tolist() == last
    assert run(Raw(spec, activity="literal"), trace)[0][0, 1:].tolist() == literal
