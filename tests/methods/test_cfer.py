"""cfer: it pays as flag does, and its other flags are drawn as its source replays them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.episodes import run, specification

from stlbench_methods.cfer import Cfer
from stlbench_methods.flag import Flag

BOX = {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}
PATROL = "G[0,9] (F[0,3] x >= 0 & G[0,6] y >= 0)"
MANY = 200_000


@pytest.mark.parametrize("flags", ["all", "published"])
@pytest.mark.parametrize("own", [0, 1, 3, 4])
def test_each_flag_is_drawn_by_its_distance(flags: str, own: int) -> None:
    """F[0,3]: flags 0..4, without 4 as published. exp(-|g - f|) over the sum of all, from evenly spaced chances."""
    method = Cfer(specification("G[0,9] F[0,3] x >= 0", BOX), flags=flags)  # type: ignore[arg-type]
    chance = (np.arange(MANY)[:, None] + 0.5) / MANY
    drawn = method.counterfactual(np.zeros((MANY, 2)), np.zeros(MANY, np.int64), np.full((MANY, 1), float(own)), chance)
    values = range(5 if flags == "all" else 4)
    weights = np.array([math.exp(-abs(g - own)) for g in values])
    found, counts = np.unique(drawn, return_counts=True)
    assert found.tolist() == list(values)
    assert counts / MANY == pytest.approx(weights / weights.sum(), abs=2 / MANY)


def test_it_pays_and_counts_as_flag_does() -> None:
    traces = np.where(np.random.default_rng(1).random((50, 20, 2)) < 0.8, 1.0, -1.0)
    spec = specification(PATROL, BOX)
    ours, theirs = run(Cfer(spec), traces), run(Flag(spec), traces)
    assert np.array_equal(ours[0][:, 1:], theirs[0][:, 1:])
    assert np.array_equal(ours[1], theirs[1])


def test_by_hand() -> None:
    """f = 4 of F[0,3] and 0 of G[0,6]. Below 4 the weights sum up to .368 .503 .553 .571, above 0 to .368 .. .5811.

    Of the first .5 * 1.571 and .99 * 1.571 are above .571: its own; .2 * 1.571 = .314 is below .368: 3. Of the second
    .5 * 1.581 is below 1: its own; .7 * 1.581 - 1 = .107: 1; .999 * 1.581 - 1 = .5798, between .5781 and .5806: 6.
    """
    method = Cfer(specification(PATROL, BOX))
    memory = np.tile([4.0, 0.0], (3, 1))
    chance = np.array([[0.5, 0.5], [0.99, 0.7], [0.2, 0.999]])
    drawn = method.counterfactual(np.zeros((3, 2)), np.zeros(3, np.int64), memory, chance)
    assert drawn.tolist() == [[4, 0], [4, 1], [3, 6]]
