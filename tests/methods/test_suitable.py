"""Which formulas every method takes or calls unsuitable: with past operators, a release, and parts that cannot fail."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.episodes import specification

from stlbench.contract import RewardMethod, Unsuitable
from stlbench_methods.bhnr import Bhnr
from stlbench_methods.causation import Causation
from stlbench_methods.cfer import Cfer
from stlbench_methods.counters import Counters
from stlbench_methods.dense import Dense
from stlbench_methods.flag import Flag
from stlbench_methods.funnel import Funnel
from stlbench_methods.hprs import Hprs
from stlbench_methods.machine import Machine
from stlbench_methods.raw import Raw
from stlbench_methods.sparse import Sparse
from stlbench_methods.tau_cmdp import TauCmdp
from stlbench_methods.tau_mdp import TauMdp
from stlbench_methods.tltl import Tltl

BOX = {"x": (-2.0, 2.0), "y": (-2.0, 2.0)}
FRAGMENT = (Raw, Funnel, Flag, Cfer, Hprs, Machine, Causation, TauCmdp)
ANY = (Bhnr, Dense, Sparse, Tltl, TauMdp)


@pytest.mark.parametrize("method", [*FRAGMENT, *ANY, Counters])
@pytest.mark.parametrize("text", ["G[0,3] (x >= 1 -> O[0,3] y >= 1)", "F[0,3] (x >= 1 S y >= 1)", "H[0,2] x >= 1"])
def test_a_past_operator_is_unsuitable_in_one_line(method: type[RewardMethod], text: str) -> None:
    with pytest.raises(Unsuitable) as error:
        method(specification(text, BOX, steps=9))
    assert "\n" not in str(error.value)
    assert method is Causation or "the past operator" in str(error.value)


@pytest.mark.parametrize("method", ANY)
@pytest.mark.parametrize("text", ["x >= 1 R[0,3] y >= -1", "F[0,2] !(x >= 1 U[1,3] y >= 1)"])
def test_a_release_fits_where_an_until_does(method: type[RewardMethod], text: str) -> None:
    made = method(specification(text, BOX, steps=9))
    assert math.isfinite(made.scale)
    assert np.isfinite(made.floor)


@pytest.mark.parametrize("method", FRAGMENT)
def test_elsewhere_the_reason_has_the_text_that_was_written(method: type[RewardMethod]) -> None:
    with pytest.raises(Unsuitable) as error:
        method(specification("x >= 1 R[0,3] y >= -1", BOX, steps=9))
    assert "release at column 8" in str(error.value) or "x >= 1 R[0,3] y >= -1" in str(error.value)


@pytest.mark.parametrize("method", [Raw, Funnel, Hprs, Machine])
@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("F[1,2] x >= 0 & (x >= 0 U[0,3] x >= 1)", "until at column 25"),
        ("G[0,9] F[0,2] x >= 0", "F inside G at column 8"),
        ("F[0,5] x >= 0 | G[0,5] x <= 0", "disjunction of temporal formulas at column 15"),
    ],
)
def test_what_is_outside_the_fragment_is_named(method: type[RewardMethod], text: str, place: str) -> None:
    with pytest.raises(Unsuitable, match=f"{place} is not in the funnel fragment"):
        method(specification(text, BOX, steps=9))


@pytest.mark.parametrize("method", [*FRAGMENT, *ANY])
@pytest.mark.parametrize(
    "text", ["F[0,3] True & G[0,3] x >= 0", "G[0,3] (1 >= 0) & F[0,2] y >= 1", "G[0,9] (True | x >= 0)"]
)
def test_a_term_that_cannot_fail_is_unsuitable_or_harmless(method: type[RewardMethod], text: str) -> None:
    try:
        made = method(specification(text, BOX, steps=9))
    except Unsuitable:
        return
    assert 0 < made.scale < math.inf
    assert math.isfinite(made.floor)


@pytest.mark.parametrize("method", [Raw, Funnel])
def test_the_term_that_cannot_fail_is_named(method: type[RewardMethod]) -> None:
    with pytest.raises(Unsuitable, match=r"F\[0,3\] True cannot fail: True is the same for all signals"):
        method(specification("F[0,3] True & G[0,3] x >= 0", BOX, steps=9))
    with pytest.raises(Unsuitable, match=r"G\[0,3\] 0 >= 1 cannot hold"):
        method(specification("F[0,3] x >= 1 & G[0,3] 0 >= 1", BOX, steps=9))
