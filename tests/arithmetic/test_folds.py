"""Minimum-like functions: values by hand, and the laws that make them stand for a conjunction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stlbench import stl
from stlbench.stl import Fold, Mean, Total

FOLDS: dict[str, Fold] = {
    **{name: stl.semantics(name).least for name in ("classic", "lse", "agm", "gmsr")},  # type: ignore[arg-type]
    "weighted": stl.semantics("gilpin").greatest.mirrored(),
}
SMOOTH = ("lse", "agm", "gmsr")
SOUND = ("classic", "agm", "gmsr")
#: values are 0 or at least 1/16 in size, where the eps of gmsr is nothing
values = arrays(np.float64, st.integers(1, 12), elements=st.integers(-16, 16).map(lambda n: n / 16))
each = pytest.mark.parametrize("name", FOLDS)


@pytest.mark.parametrize(
    ("name", "given_", "expected"),
    [
        ("classic", [0.5, -0.25, 1.0], -0.25),
        ("lse", [0.0, 0.0], -math.log(2) / 10),
        ("lse", [0.5, 1.0], 0.5 - math.log(1 + math.exp(-5)) / 10),
        ("lse", [-100.0, 100.0], -100.0),  # e^1000 is more than a float can be
        ("lse", [200.0, 200.0], 200 - math.log(2) / 10),  # and e^-2000 is less
        ("weighted", [0.5, 1.0], (0.5 + math.exp(-5)) / (1 + math.exp(-5))),
        ("weighted", [0.25, 0.25, 0.25], 0.25),
        ("weighted", [-100.0, 100.0], -100.0),
        ("weighted", [math.inf, 1.0], 1.0),
        ("weighted", [-math.inf, 1.0], -math.inf),
        ("agm", [1.0, 0.125], 0.5),  # sqrt(2 * 1.125) - 1
        ("agm", [-1.0, 0.5], -0.5),
        ("agm", [0.0, 0.5, 1.0], 0.0),
        ("gmsr", [0.5, 0.125], 0.25 - 1e-4),  # (1/4 * 1/64)^(1/4)
        ("gmsr", [-0.6, 0.8], 1e-4 - math.sqrt(1e-8 + 0.18)),
        ("gmsr", [0.0, 1.0], 0.0),
    ],
)
def test_by_hand(name: str, given_: list[float], expected: float) -> None:
    assert FOLDS[name](np.array(given_)) == pytest.approx(expected, abs=1e-7)
    assert FOLDS[name].mirrored()(-np.array(given_)) == pytest.approx(-expected, abs=1e-7)


def test_the_mean_and_the_sum() -> None:
    values = np.array([[1.0, 0.0, 0.5, 0.5], [1.0, 1.0, 1.0, 0.0]])
    assert Mean()(values).tolist() == [0.5, 0.75]
    assert Total()(values).tolist() == [2, 3]


@each
@given(values=values)
def test_summaries_grow_value_by_value(name: str, values: np.ndarray) -> None:
    fold = FOLDS[name]
    summary = np.full(fold.size, fold.empty)
    for value in values:
        summary = fold.merge(summary, fold.lift(np.array(value)))
    assert fold.read(summary) == pytest.approx(fold(values), abs=1e-12)


@each
def test_none_and_many(name: str) -> None:
    fold = FOLDS[name]
    assert fold.read(np.full(fold.size, fold.empty)) == math.inf
    assert fold.mirrored().read(np.full(fold.size, fold.empty)) == -math.inf
    once = fold.lift(np.array([0.5, -0.25]))
    assert fold.read(fold.repeat(once, [4, 4])) == pytest.approx(fold(np.tile([[0.5], [-0.25]], 4)))
    assert fold.read(fold.repeat(once, [0, 0])).tolist() == [math.inf, math.inf]


@pytest.mark.parametrize("name", SOUND)
@given(values=values)
def test_the_sign_is_that_of_the_least(name: str, values: np.ndarray) -> None:
    assert np.sign(FOLDS[name](values).round(9)) == np.sign(values.min())


@pytest.mark.parametrize("name", ["classic", "agm", "gmsr"])
@pytest.mark.parametrize("rest", [0.5, 1.0, 1e-9, 1e-200])
@pytest.mark.parametrize("one", [1e-9, 1e-300, 0.0, -0.0, -1e-9, -1e-300])
def test_the_sign_is_exact_over_many_values(name: str, rest: float, one: float) -> None:
    values = np.full(500, rest)
    values[123] = one
    assert np.sign(FOLDS[name](values)) == np.sign(one)
    assert np.sign(FOLDS[name].mirrored()(-values)) == -np.sign(one)


def test_the_sign_of_log_sum_exp_can_be_wrong_either_way() -> None:
    """Ten values of .1 at b = 10 make .1 - log(10) / 10 = -.13; and as a maximum of -.1, .13."""
    assert FOLDS["lse"](np.full(10, 0.1)) == pytest.approx(0.1 - math.log(10) / 10)
    assert FOLDS["lse"].mirrored()(np.full(10, -0.1)) == pytest.approx(math.log(10) / 10 - 0.1)


floats = arrays(np.float64, st.integers(1, 12), elements=st.floats(-1e3, 1e3))


@given(values=floats, sharpness=st.sampled_from([0.5, 10.0, 100.0]))
def test_gilpins_two_are_never_above_the_true_ones(values: np.ndarray, sharpness: float) -> None:
    both = stl.semantics("gilpin", sharpness)
    most = math.log(len(values)) / sharpness
    for value, exact in ((both.least(values), values.min()), (both.greatest(values), values.max())):
        assert exact - most - 1e-9 <= value <= exact + 1e-9
        assert value <= 0 or exact > 0


@pytest.mark.parametrize("name", ["classic", "agm", "weighted"])
@given(value=st.integers(-16, 16).map(lambda n: n / 16), count=st.integers(1, 40))
def test_equal_values_give_themselves(name: str, value: float, count: int) -> None:
    assert FOLDS[name](np.full(count, value)) == pytest.approx(value, abs=1e-12)


@pytest.mark.parametrize("name", sorted(FOLDS.keys() - {"weighted"}))  # a weighted mean can fall as a value rises
@given(values=values, data=st.data())
def test_more_of_a_value_is_never_worse(name: str, values: np.ndarray, data: st.DataObject) -> None:
    more = values.copy()
    more[data.draw(st.integers(0, len(values) - 1))] += 1 / 16
    assert FOLDS[name](more) >= FOLDS[name](values) - 1e-12


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("given_", [[0.25, 0.5, 0.75], [-0.25, -0.5, -0.75]])
def test_each_value_counts(name: str, given_: list[float]) -> None:
    """The finite difference by each value is positive: nothing is masked by the least one, as in `classic`."""
    values, step = np.array(given_), 1e-4
    for i in range(3):
        change = FOLDS[name](values + step * np.eye(3)[i]) - FOLDS[name](values - step * np.eye(3)[i])
        assert change / (2 * step) > 1e-3
    assert stl.semantics("classic").least(values + step * np.eye(3)[1]) == values.min()


@pytest.mark.parametrize("sharpness", [math.inf, math.nan, 0.0, -1.0])
@pytest.mark.parametrize("name", ["lse", "gilpin"])
def test_a_sharpness_is_finite(name: stl.SemanticsName, sharpness: float) -> None:
    with pytest.raises(ValueError, match=r"the sharpness is a finite number above 0, got .*'classic'"):
        stl.semantics(name, sharpness)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("fold", [*FOLDS.values(), Mean(), Total()], ids=[*FOLDS, "mean", "total"])
@pytest.mark.parametrize("value", [math.inf, -math.inf, -2.0])
def test_0_times_a_value_is_no_value(fold: Fold, value: float) -> None:
    one = fold.lift(np.array(0.5))
    none = fold.repeat(fold.lift(np.array(value)), 0)
    assert fold.read(none) == (0.0 if isinstance(fold, Total) else math.inf)
    assert fold.read(fold.merge(none, one)) == fold.read(one)
