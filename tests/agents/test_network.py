"""Q-networks against Q written out action by action."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stlbench.contract import ActionGrid, Unsuitable
from stlbench_agents.policies import Head
from stlbench_agents.q_policy import GreedyPolicy, QNetwork

GRID = ActionGrid(("v", "w", "u"), ((-1.0, 0.0, 1.0, 2.0), (5.0, 7.0), (0.0, 1.0, 2.0)))
"""4 x 2 x 3 = 24 actions; index 6 i + 3 j + k, the last axis fastest."""

INPUTS, WIDTHS = 5, (16, 8)
HEADS: tuple[Head, ...] = ("joint", "additive")


def test_an_index_means_the_same_action_to_the_grid_and_to_the_additive_head() -> None:
    for index, vector in enumerate(GRID.vectors):
        i, j, k = index // 6, index % 6 // 3, index % 3
        assert vector.tolist() == [GRID.axes[0][i], GRID.axes[1][j], GRID.axes[2][k]]


@pytest.mark.parametrize("net_arch", [(7,), (16, 8), (6, 9, 4)])
@pytest.mark.parametrize("head", HEADS)
def test_the_engine_finds_each_layer_where_the_views_have_it(head: Head, net_arch: tuple[int, ...]) -> None:
    network = QNetwork(INPUTS, net_arch, GRID.shape, head)
    views = network.views(np.arange(network.size, dtype=np.float32))
    outputs = 24 if head == "joint" else 1 + 4 + 2 + 3
    assert [view.shape for view in views[-2:]] == [(outputs, net_arch[-1]), (outputs,)]
    assert sum(view.size for view in views) == network.size
    assert network.engine.additive == (head == "additive")
    assert network.engine.axes.tolist() == ([24] if head == "joint" else [4, 2, 3])
    layers = [[int(m.flat[0]), *m.shape, int(b[0])] for m, b in zip(views[::2], views[1::2], strict=True)]
    assert network.engine.layers.tolist() == layers


@pytest.mark.parametrize("head", HEADS)
def test_a_policy_does_not_change_with_the_weights_it_was_made_of(head: Head) -> None:
    network, generator = QNetwork(INPUTS, WIDTHS, GRID.shape, head), np.random.default_rng(0)
    flat, observation = network.initial(generator), generator.normal(size=(40, INPUTS))
    policy = GreedyPolicy(network, network.views(flat))
    before = policy.act(observation)
    flat *= -1
    assert np.array_equal(policy.act(observation), before)
    assert not np.array_equal(GreedyPolicy(network, network.views(flat)).act(observation), before)


@pytest.mark.parametrize("head", HEADS)
def test_fresh_weights(head: Head) -> None:
    """He: standard deviation sqrt(2 / inputs) in hidden layers, .1 / sqrt(inputs) in the last; biases 0."""
    network = QNetwork(50, (200, 100), (10, 10), head)
    flat = network.initial(np.random.default_rng(3))
    w1, b1, w2, b2, w3, b3 = network.views(flat)
    assert flat.dtype == np.float32
    assert not any(bias.any() for bias in (b1, b2, b3))
    assert float(w1.std()) == pytest.approx(math.sqrt(2 / 50), rel=0.05)
    assert float(w2.std()) == pytest.approx(math.sqrt(2 / 200), rel=0.05)
    assert float(w3.std()) == pytest.approx(0.1 / math.sqrt(100), rel=0.1)
    assert np.array_equal(flat, network.initial(np.random.default_rng(3)))
    assert not np.array_equal(flat, network.initial(np.random.default_rng(4)))


def test_views_share_the_memory_of_the_flat_vector() -> None:
    network = QNetwork(2, (3,), (4,), "joint")
    flat = np.arange(2 * 3 + 3 + 4 * 3 + 4, dtype=np.float32)
    weights = network.views(flat)
    flat += 1
    assert np.array_equal(np.concatenate([weight.ravel() for weight in weights]), flat)
    weights[2][:] = 0
    assert flat.tolist() == [*range(1, 10), *[0] * 12, *range(22, 26)]


def of(**changed):
    """The arrays of a policy that sees two numbers, some of them changed."""
    arrays = {"widths": np.array([2, 3]), "grid": np.array([2]), "head": np.array("joint")}
    return GreedyPolicy.of(arrays | {"weights": np.zeros(2 * 3 + 3 + 3 * 2 + 2, np.float32)} | changed, (2,))


@pytest.mark.parametrize(
    "changed",
    [
        *({"widths": np.array(each)} for each in ([-2, 3], [2, 0], [2.0, 3.0], 2, np.array([], np.int64))),
        *({"weights": np.zeros(*each)} for each in ((16, np.float32), (17, np.float64), ((1, 17), np.float32))),
        {"grid": np.array([3])},
    ],
)
def test_arrays_of_others_that_do_not_fit_are_refused(changed):
    """Compiled code trusts them: it would read, and write, beside them."""
    with pytest.raises(Unsuitable):
        of(**changed)


def test_a_network_with_more_inputs_than_there_are_sees_nothing():
    policy = of()
    assert policy.act(np.zeros((4, 2))).shape == (4,)
    for observation in (np.zeros((4, 1)), np.zeros((4, 3)), np.zeros(2)):
        with pytest.raises(ValueError, match="the network has 2 inputs"):
            policy.act(observation)
