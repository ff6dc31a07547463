"""The first page of the contract, and how `arrival` and `along` follow from each other."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import stlbench.contract
from stlbench import stl
from stlbench.contract import Array, Event, Integers, RewardMethod, Specification, Transition
from stlbench.stl import parse
from stlbench.testing import check_method

SPECIFICATION = Specification(parse("G[0,9] x >= 0"), ("x",), (-9.0,), (9.0,), steps=9, dt=1.0)
SAMPLES = np.array([[[1.0], [2.0]], [[3.0], [5.0]], [[4.0], [-1.0]]])
"""(3, 2, 1): two rows while an action is held for two steps."""
ACTION, AT, NOTHING = np.zeros((2, 1)), np.array([0, 4]), np.zeros((2, 0))


class Arrival(RewardMethod):
    """x + 10 t."""

    def arrival(self, signals: Array, t: Integers) -> Array:
        return signals[..., 0] + 10 * t


class Along(RewardMethod):
    """How far x moves."""

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        return np.diff(samples[..., 0], axis=0), memory


def test_the_method_on_the_first_page_is_complete() -> None:
    """Its reward at t = 2 is the lesser of x - 1 and 0.5 - x; at t = 0, outside both intervals, it is 0."""
    example = stlbench.contract.__doc__.split("active:\n\n")[1].split("\nIts distribution")[0]
    names = dict[str, Any]()
    exec(textwrap.dedent(example), names)
    check_method(names["Raw"])
    specification = replace(SPECIFICATION, formula=parse("F[2,5] x >= 1 & G[1,6] x <= 0.5"))
    signals, t = np.array([[3.0], [0.0], [3.0]]), np.array([2, 2, 0])
    assert names["Raw"](specification).arrival(signals, t).tolist() == [-2.5, -1.0, 0.0]


def test_along_follows_from_arrival_and_never_pays_for_the_first_sample() -> None:
    expected = SAMPLES[1:, :, 0] + 10 * (AT + np.array([[1], [2]]))
    method = Arrival(SPECIFICATION)
    assert method.paid_on_arrival
    assert method.along(SAMPLES, ACTION, AT, NOTHING)[0].tolist() == expected.tolist()
    with pytest.raises(TypeError, match=r"^Along has no arrival"):
        Along(SPECIFICATION).arrival(SAMPLES[0], AT)


def test_the_last_class_that_writes_one_of_them_counts() -> None:
    arrival = type("A", (Along,), {"arrival": Arrival.arrival})(SPECIFICATION)
    assert arrival.paid_on_arrival
    assert arrival.along(SAMPLES, ACTION, AT, NOTHING)[0].tolist() == [[13, 55], [24, 59]]

    class Doubled(Arrival):
        def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
            rewards, memory = super().along(samples, action, t, memory)
            return 2 * rewards, memory

    for kind in (Doubled, type("Inherited", (Doubled,), {})):
        assert not kind.paid_on_arrival
        assert kind(SPECIFICATION).along(SAMPLES, ACTION, AT, NOTHING)[0].tolist() == [[26, 110], [48, 118]]


def test_both_or_neither_is_refused_when_the_class_is_made() -> None:
    with pytest.raises(TypeError, match=r"^Neither must have one of arrival and along, and has neither$"):
        type("Neither", (RewardMethod,), {})
    with pytest.raises(TypeError, match=r"^Both must have one of arrival and along, and has both$"):
        type("Both", (RewardMethod,), {"arrival": Arrival.arrival, "along": Along.along})


def test_the_event_of_a_transition_says_all() -> None:
    wide = np.zeros((5, 1))
    transition = Transition(wide, wide[:, 0], wide, np.array(list(Event), np.int8))
    assert transition.discount.tolist() == [1, 1, 1, 0, 0]
    assert transition.cut.tolist() == [False, True, True, True, True]
    assert transition.ended.tolist() == [False, False, True, True, True]


def test_a_range_is_proven_once(monkeypatch: pytest.MonkeyPatch) -> None:
    proven, bounds = list[str](), stl.bounds
    monkeypatch.setattr(stl, "bounds", lambda psi, box: proven.append(str(psi)) or bounds(psi, box))
    stlbench.contract.method._proven.cache_clear()  # of what other tests asked for
    for specification in (SPECIFICATION, replace(SPECIFICATION)):  # what one has proven, the other knows
        assert specification.range(parse("x >= 1")) == pytest.approx((-10, 8))
        assert specification.range(parse("x >= 2")) == pytest.approx((-11, 7))
    assert proven == ["x >= 1", "x >= 2"]
