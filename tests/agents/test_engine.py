"""The compiled arithmetic: gradients against torch's autograd, Adam against torch.optim, greedy actions by counting."""

from __future__ import annotations

import math
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch
from helpers import plain_q
from numba import njit
from numpy.typing import NDArray

from stlbench_agents.engine import Network, QBuffers, additive_gradient, greedy_actions, joint_gradient
from stlbench_agents.layers import Weights, adam, blend, clipping, step
from stlbench_agents.policies import Head
from stlbench_agents.q_policy import GreedyPolicy, QNetwork
from stlbench_agents.replay import Batch

Floats = NDArray[Any]

INPUTS, ROWS = 5, 48
ARCHITECTURES: list[tuple[int, ...]] = [(), (9,), (12, 7), (6, 14, 10), (40, 24)]
"""Widths that grow and that shrink, none equal to another; no hidden layer; one wider than the processor's vectors."""
GRIDS = [(6,), (4, 3), (3, 2, 4)]
SHAPES = [
    *(plain_q.Shape(INPUTS, net_arch, (4, 3), "joint") for net_arch in ARCHITECTURES),
    *(plain_q.Shape(INPUTS, net_arch, grid, "additive") for net_arch, grid in product(ARCHITECTURES, GRIDS)),
]

shapes = pytest.mark.parametrize("shape", SHAPES, ids=lambda s: f"{s.head}-{len(s.net_arch)}-{len(s.grid)}")
doubles = pytest.mark.parametrize("double", [True, False], ids=["double", "plain"])


@njit
def _step(weights: Weights, rate: float, count: int, max_norm: float, target: float, average: float) -> None:
    step(weights, rate, count, max_norm, target, average)


class Case(NamedTuple):
    """What `gradient` takes before the workspace, in its order."""

    online: Floats
    target: Floats
    network: Network
    observation: Floats
    action: NDArray[np.int64]
    returns: Floats
    arrived: Floats
    discount: Floats
    double: bool

    @property
    def arrays(self) -> list[Floats]:
        """All of them that are arrays."""
        parts = (*self, *self.network)
        return [part for part in parts if isinstance(part, np.ndarray)]


def case(shape: plain_q.Shape, double: bool, rows: int = ROWS, dtype: Any = np.float64, seed: int = 0) -> Case:
    """Weights, none of them 0, and transitions; some returns do not bootstrap."""
    generator = np.random.default_rng(seed)
    network = engine_of(shape)
    size = sum(math.prod(part) for part in shape.weights)

    def normal(*size: int) -> Floats:
        return generator.normal(size=size).astype(dtype)

    online, target, observation = 0.4 * normal(size), 0.4 * normal(size), normal(rows, shape.inputs)
    action, returns = generator.integers(math.prod(shape.grid), size=rows), normal(rows)
    arrived, discount = normal(rows, shape.inputs), generator.choice(np.array([0.9, 0.5, 0.0], dtype), size=rows)
    return Case(online, target, network, observation, action, returns, arrived, discount, double)


def engine_of(shape: plain_q.Shape) -> Network:
    return QNetwork(*shape).engine


def poisoned(network: Network, rows: int, dtype: Any) -> QBuffers:
    """A workspace of NaN, and of no action; only what is constant is as it should be."""
    work = QBuffers.of(network, rows, dtype)
    for part in (*work.passes[:-1], work.outputs, work.goal):
        part[:] = np.nan
    work.chosen[:] = -1
    return work


def computed(of: Case, work: QBuffers | None = None, bounds: tuple[float, float] = (-np.inf, np.inf)) -> Floats:
    """The gradient, written over NaN."""
    dtype, into = of.online.dtype, np.full_like(of.online, np.nan)
    batch = Batch(of.observation, of.action, of.returns, of.arrived, of.discount, np.array(bounds, dtype))
    gradient = additive_gradient if of.network.additive else joint_gradient
    work = work or poisoned(of.network, len(of.action), dtype)
    gradient(of.online, of.target, of.network, batch, of.double, work, into)
    return into


def plain(shape: plain_q.Shape, of: Case) -> Floats:
    return plain_q.gradient(shape, of.online, of.target, *of[3:])


def furthest(ours: Floats, expected: Floats) -> float:
    """The largest difference, relative to the largest entry; NaN if there is one."""
    return float(np.abs(ours - expected).max() / np.abs(expected).max())


class TestGradient:
    @shapes
    @doubles
    def test_targets_lie_within_the_bounds_of_values(self, shape: plain_q.Shape, double: bool) -> None:
        of = case(shape, double)
        free, bounded = (poisoned(of.network, ROWS, np.float64) for _ in range(2))
        computed(of, free)
        low, high = np.quantile(free.goal, [0.2, 0.8])
        computed(of, bounded, (low, high))
        assert bounded.goal == pytest.approx(np.clip(free.goal, low, high))

    @shapes
    @doubles
    def test_against_autograd_in_double_precision(self, shape: plain_q.Shape, double: bool) -> None:
        """Rounding is 1e-16 an operation: 1e-12 leaves room for sums in any order and for nothing else."""
        for seed, rows in enumerate((ROWS, ROWS - 5, 1)):
            of = case(shape, double, rows, seed=seed)
            assert furthest(computed(of), plain(shape, of)) < 1e-12

    @shapes
    @doubles
    def test_in_single_precision_nothing_else_is_written_or_read(self, shape: plain_q.Shape, double: bool) -> None:
        """Sums of at most 48 products, a layer upon a layer: 1e-5 is a hundred roundings (of 6e-8) and more.

        A bootstrap action that the two precisions choose differently, or a ReLU that one has on and the other off,
        would differ by more; with these seeds no row is that close. Work that was done before leaves the bits alone.
        """
        of, other = case(shape, double, dtype=np.float32), case(shape, not double, dtype=np.float32, seed=1)
        before = [part.tobytes() for part in of.arrays]
        fresh = computed(of)
        assert fresh.dtype == np.float32
        assert furthest(fresh, plain(shape, of)) < 1e-5
        assert [part.tobytes() for part in of.arrays] == before
        work = poisoned(of.network, ROWS, np.float32)
        computed(other, work)
        assert np.array_equal(computed(of, work), fresh)

    def test_by_hand(self) -> None:
        """One hidden unit, two actions, one row.

        h = relu(2 * 3 - 1) = 5; Q = (5 + .5, -5) at the row, and Q_target = (0, 4) * relu(1 * 1 + 0) = (0, 4) where it
        arrived, the online network's choice there is relu(2 * 1 - 1) * (1, -1) + (.5, 0) = (1.5, -1): the first. So
        y = 1 + .5 * 0 with double, 1 + .5 * 4 without; the error is 4.5 or 2.5, and the gradient by (w, b, first row,
        second row, biases) is error * (3, 1, 5, 0, 1, 0).
        """
        network = Network(np.array([[0, 1, 1, 1], [2, 2, 1, 4]]), np.array([2]), False)
        online, target = np.array([2, -1, 1, -1, 0.5, 0]), np.array([1.0, 0, 0, 4, 0, 0])
        row, one = np.array([[3.0]]), np.ones(1)
        of = Case(online, target, network, row, np.array([0]), one, np.array([[1.0]]), 0.5 * one, True)
        assert computed(of).tolist() == [4.5 * 3, 4.5, 4.5 * 5, 0, 4.5, 0]
        assert computed(of._replace(double=False)).tolist() == [2.5 * 3, 2.5, 2.5 * 5, 0, 2.5, 0]

    def test_a_workspace_of_another_batch_is_refused(self) -> None:
        of = case(SHAPES[0], True)
        with pytest.raises(ValueError, match="made for a batch of another size"):
            computed(of, poisoned(of.network, ROWS + 1, np.float64))


class TestAdam:
    @pytest.mark.parametrize(("dtype", "bound"), [(np.float64, 1e-12), (np.float32, 2e-4)])  # 300 sums
    @pytest.mark.parametrize("max_norm", [0.5, 1e9], ids=["clipped", "free"])
    def test_against_torch(self, dtype: Any, bound: float, max_norm: float) -> None:
        """A fifth of the weights get no gradient, a fifth gets it only at the start, a fifth only now and then."""
        steps, size, generator = 300, 200, np.random.default_rng(0)
        begin = generator.normal(size=size)
        ours, mean, square = begin.astype(dtype), np.zeros(size, dtype), np.zeros(size, dtype)
        theirs = torch.tensor(begin.astype(dtype)).double().requires_grad_()
        reference = torch.optim.Adam([theirs])
        clipped = 0
        for count in range(1, steps + 1):
            slope = generator.normal(size=size) * 10.0 ** (count % 3 - 2)
            slope[:40] = 0
            slope[40:80] *= count <= 10
            slope[80:120] *= generator.random(40) < 0.02
            rate = 1e-2 * 0.99**count
            single = slope.astype(dtype)
            adam(ours, single, mean, square, rate, count, clipping(single, max_norm))
            theirs.grad = torch.tensor(single).double()
            clipped += float(torch.nn.utils.clip_grad_norm_([theirs], max_norm)) > max_norm
            reference.param_groups[0]["lr"] = rate
            reference.step()
        assert clipped == (0 if max_norm > 1 else 200)  # at a hundredth in size they are below .5
        moved = np.abs(ours - begin)
        assert moved[40:].mean() > 0.05
        assert moved[:40].max() < 1e-6
        assert np.abs(ours - theirs.detach().numpy()).max() < bound

    @pytest.mark.parametrize("first", [1.0, -1.0, 0.0, 1e-12, -5e-18])
    def test_moments_of_a_weight_without_gradient_do_not_become_denormal(self, first: float) -> None:
        """.9^850 is 1e-39: without care the first moment is denormal from there on, the second where g is 5e-18."""
        weights, mean, square = np.zeros(64, np.float32), np.zeros(64, np.float32), np.zeros(64, np.float32)
        slope, least = np.linspace(0.5, 1, 64, dtype=np.float32) * np.float32(first), np.finfo(np.float32).tiny
        for count in range(1, 2001):
            adam(weights, slope, mean, square, 1e-3, count, 1.0)
            slope[:] = 0
            for moment in (mean, square) if count % 10 == 0 else ():
                small = (moment != 0) & (np.abs(moment) < least)
                assert not small.any(), (count, moment[small])
            if count == 200:
                settled = weights.copy()
        assert weights == pytest.approx(settled, rel=0, abs=1e-9)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
class TestBlend:
    def test_many_steps_are_a_geometric_average(self, dtype: Any) -> None:
        generator = np.random.default_rng(0)
        into, history = np.ones(50, dtype), generator.normal(size=(200, 50)).astype(dtype)
        expected = np.ones(50)
        for weights in history:
            blend(into, weights, 0.005)
            expected = 0.995 * expected + 0.005 * weights
        assert np.abs(expected - 1).max() > 0.5
        assert into == pytest.approx(expected, rel=0, abs=1e-13 if dtype is np.float64 else 1e-6)

    def test_a_share_of_1_copies_and_one_of_0_changes_nothing(self, dtype: Any) -> None:
        into, weights = np.random.default_rng(1).normal(size=(2, 1000)).astype(dtype)
        weights[:3] = 0, 1e-20, 1e20
        before = into.copy()
        blend(into, weights, 0.0)
        assert np.array_equal(into, before)
        blend(into, weights, 1.0)
        assert np.array_equal(into, weights)


class TestStep:
    @pytest.mark.parametrize("size", [1, 1024, 2500])
    @pytest.mark.parametrize("shares", [(0.0, 0.0), (0.25, 0.0), (0.0, 0.5), (1.0, 0.125)])
    def test_is_adam_on_the_clipped_gradient_and_then_both_averages(
        self, size: int, shares: tuple[float, float]
    ) -> None:
        """Of the whole vector at once, whatever blocks `step` makes of it."""
        generator = np.random.default_rng(0)
        weights = Weights.of(generator.normal(size=size))
        online, target, average = (weights.online.copy() for _ in range(3))
        mean, square = np.zeros(size), np.zeros(size)
        for count in range(1, 5):
            weights.gradient[:] = generator.normal(size=size)
            _step(weights, 0.1, count, 0.5, *shares)
            adam(online, weights.gradient, mean, square, 0.1, count, clipping(weights.gradient, 0.5))
            blend(target, online, shares[0])
            blend(average, online, shares[1])
            expected = (online, target, average, weights.gradient, mean, square)
            for ours, theirs in zip(weights, expected, strict=True):
                assert ours == pytest.approx(theirs, rel=1e-12, abs=1e-15)


def policy_of(shape: plain_q.Shape, flat: Floats) -> GreedyPolicy:
    network = QNetwork(*shape)
    return GreedyPolicy(network, network.views(flat))


class TestBestActions:
    @shapes
    def test_against_an_enumeration(self, shape: plain_q.Shape) -> None:
        drawn = set()
        for seed in range(3):
            of = case(shape, True, 60, seed=seed)
            found = greedy_actions(of.online, of.network, of.observation)
            q = plain_q.all_q(shape, torch.tensor(of.online), torch.tensor(of.observation)).numpy()
            assert found.dtype == np.int64
            assert np.array_equal(found, q.argmax(axis=1))
            single, fine = of.online.astype(np.float32), of.observation.astype(np.float32).astype(np.float64)
            policy = policy_of(shape, single)
            assert np.array_equal(policy.act(fine), greedy_actions(single, of.network, fine.astype(np.float32)))
            assert policy.act(fine * (1 + 1e-9)).tolist() == [policy.act(row[None]).item() for row in fine]
            drawn |= set(found)
        assert len(drawn) > 3

    @pytest.mark.parametrize("grid", GRIDS)
    @pytest.mark.parametrize("head", ["joint", "additive"])
    def test_the_first_of_equals_as_numpys_argmax_has_it(self, grid: tuple[int, ...], head: Head) -> None:
        """Whole numbers from -1 to 1: exact in any order of sums, and equal more often than not."""
        shape, generator = plain_q.Shape(INPUTS, (4, 3), grid, head), np.random.default_rng(0)
        flat = generator.integers(-1, 2, size=sum(math.prod(part) for part in shape.weights)).astype(np.float32)
        x = generator.integers(-1, 2, size=(300, INPUTS)).astype(np.float32)
        found = greedy_actions(flat, engine_of(shape), x)
        # in whole numbers as well: the means that an additive head takes off are the same for all actions
        w1, b1, w2, b2, w3, b3 = QNetwork(*shape).views(flat)
        outputs = np.maximum(np.maximum(x @ w1 + b1, 0) @ w2 + b2, 0) @ w3.T + b3
        q = outputs
        if head == "additive":
            ends = np.cumsum(grid)[:-1]
            branches = np.split(outputs[:, 1:], ends, axis=1)
            chosen = product(*map(range, grid))
            q = np.stack([sum(b[:, i] for b, i in zip(branches, each, strict=True)) for each in chosen], axis=1)
        assert ((q == q.max(axis=1, keepdims=True)).sum(axis=1) > 1).mean() > 0.2
        assert np.array_equal(found, q.argmax(axis=1))
        assert np.array_equal(policy_of(shape, flat).act(x.astype(np.float64)), found)
