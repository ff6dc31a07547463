"""How values change: finite differences against autograd of an independent implementation, and where they jump."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, formulas
from hypothesis import given

from stlbench import stl

torch: Any = pytest.importorskip("torch")

SHARPNESS = 10.0
NAMED = pytest.mark.parametrize("name", ["lse", "agm", "gmsr"])


def least(name: str, values: Sequence[Any]) -> Any:
    """The minimum-like function of n numbers, from its formula in docs/stl.md."""
    x, n = torch.stack(list(values)), len(values)
    if name == "lse":
        return -torch.logsumexp(-SHARPNESS * x, 0) / SHARPNESS
    if name == "agm":
        return x.clamp(max=0).mean() if bool((x <= 0).any()) else (1 + x).prod() ** (1 / n) - 1
    above = (1e-8**n + (x.clamp(min=0) ** 2).prod()) ** (1 / n)
    below = 1e-8 + ((-x).clamp(min=0) ** 2).mean()
    return above.sqrt() - below.sqrt()


def greatest(name: str, values: Sequence[Any]) -> Any:
    return -least(name, [-value for value in values])


def value(node: stl.Formula, t: int, name: str, leaves: dict[stl.Formula, Any]) -> Any:
    """By the definition, one number at a time."""
    if node in leaves:
        return leaves[node][t]
    match node:
        case stl.Not(arg):
            return -value(arg, t, name, leaves)
        case stl.And(args):
            return least(name, [value(arg, t, name, leaves) for arg in args])
        case stl.Or(args):
            return greatest(name, [value(arg, t, name, leaves) for arg in args])
        case stl.Always(a, b, arg):
            return least(name, [value(arg, t + i, name, leaves) for i in range(a, int(b) + 1)])
        case stl.Eventually(a, b, arg):
            return greatest(name, [value(arg, t + i, name, leaves) for i in range(a, int(b) + 1)])
        case stl.Until(a, b, left, right) | stl.Release(a, b, left, right):
            inner, outer = (least, greatest) if isinstance(node, stl.Until) else (greatest, least)
            goals = list[Any]()
            for i in range(a, int(b) + 1):
                goal = value(right, t + i, name, leaves)
                guards = [value(left, t + j, name, leaves) for j in range(i)]
                goals.append(inner(name, [goal, inner(name, guards)]) if guards else goal)
            return outer(name, goals)
    raise AssertionError(node)


@NAMED
@given(formula=formulas(LIPSCHITZ, constants=False, past=False), seed=SEEDS)
def test_the_derivative_by_every_leaf_at_every_step(name: Any, formula: stl.Formula, seed: int) -> None:
    """No value of a leaf is near 0, where `agm` jumps."""
    quantity = stl.Quantity(formula, NAMES, stl.semantics(name, SHARPNESS))
    generator = np.random.default_rng(seed)
    shape = quantity.horizon + 1, len(quantity.leaves)
    at = generator.uniform(1 / 16, 1, shape) * generator.choice([-1, 1], shape)
    given_ = torch.tensor(at, requires_grad=True)
    found = value(quantity.formula, 0, name, dict(zip(quantity.leaves, given_.T, strict=True)))
    assert quantity.values(at[None]).item() == pytest.approx(found.item(), abs=1e-9)
    (expected,) = torch.autograd.grad(found, given_)
    step = 1e-6
    moves = step * np.eye(at.size).reshape(-1, *shape)
    changes = quantity.values(at + moves)[:, 0] - quantity.values(at - moves)[:, 0]
    assert changes / (2 * step) == pytest.approx(expected.numpy().ravel(), abs=1e-5)


@pytest.mark.parametrize("name", ["lse", "gmsr"])
def test_where_a_value_is_0_the_slopes_of_both_sides_meet(name: Any) -> None:
    """Of two values, .5 and one that crosses 0. gmsr bends within 1e-8, its eps, so the step is much less."""
    fold, step = stl.semantics(name).least, 1e-13
    slopes = [
        float((fold(np.array([end, 0.5])) - fold(np.array([begin, 0.5]))) / step)
        for begin, end in ((-step, 0.0), (0.0, step))
    ]
    assert slopes[0] == pytest.approx(slopes[1], abs=0.02)


def test_agm_jumps_where_a_value_becomes_positive() -> None:
    """sqrt(1 * 1.5) - 1 = .2247 from above, 0 at 0 and below: no gradient tells of the jump."""
    fold = stl.semantics("agm").least
    assert fold(np.array([1e-12, 0.5])) == pytest.approx(np.sqrt(1.5) - 1)
    assert fold(np.array([0.0, 0.5])) == 0
