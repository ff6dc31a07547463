"""TD3's compiled arithmetic: gradients and targets against torch's."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
import torch
from helpers.plain_perceptron import perceptron
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from stlbench_agents.layers import size_of
from stlbench_agents.replay import Batch
from stlbench_agents.td3_learner import Networks, Noise, TD3Buffers, actor_gradient, critic_gradient, targets

Floats = NDArray[Any]
INPUTS, ROWS = 3, 40
ARCHITECTURES = [(9,), (12, 7), (6, 14, 10), (40, 72)]
"""Widths that grow and that shrink, none equal to another; the last wider than the processor's vectors."""

architectures = pytest.mark.parametrize("net_arch", ARCHITECTURES, ids=str)
axes_of = pytest.mark.parametrize("axes", [1, 3])


class Case(NamedTuple):
    """Weights, none of them 0, and transitions; some returns do not bootstrap."""

    networks: Networks
    actor: Floats
    critics: Floats
    batch: Batch
    normal: Floats
    work: TD3Buffers


def case(net_arch: tuple[int, ...], axes: int, dtype: Any = np.float64, layer_norm: bool = False) -> Case:
    generator, networks = np.random.default_rng(0), Networks.of(INPUTS, net_arch, axes)

    def normal(*size: int) -> Floats:
        return generator.normal(size=size).astype(dtype)

    observation, action = normal(ROWS, INPUTS), generator.uniform(-1, 1, (ROWS, axes)).astype(dtype)
    returns, arrived = normal(ROWS), normal(ROWS, INPUTS)
    discount = generator.choice(np.array([0.9, 0.5, 0.0], dtype), size=ROWS)
    batch = Batch(observation, action, returns, arrived, discount, np.array([-np.inf, np.inf], dtype))
    work = TD3Buffers.of(networks, ROWS, dtype, layer_norm)
    for part in (*work.actor[:-1], *work.critic[:-1], *work[2:]):
        part[:] = np.nan
    flats = 0.4 * normal(size_of(networks.actor)), 0.4 * normal(size_of(networks.critics[1]))
    return Case(networks, *flats, batch, normal(ROWS, axes), work)


def values(of: Case, critics: Tensor, which: int, observation: Tensor, action: Tensor) -> Tensor:
    layers, inputs = of.networks.critics[which], torch.cat([observation, action], 1)
    return perceptron(critics, layers, inputs, normalised=len(of.work.critic.scales) > 0)[:, 0]


def furthest(ours: Floats, expected: Floats) -> float:
    return float(np.abs(ours - expected).max() / np.abs(expected).max())


def tensors(of: Case) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(of.batch.observation), torch.from_numpy(of.batch.action)


@architectures
@axes_of
@pytest.mark.parametrize(("dtype", "bound"), [(np.float64, 1e-12), (np.float32, 1e-5)])
@pytest.mark.parametrize("layer_norm", [False, True])
class TestAgainstAutograd:
    """In double precision rounding is 1e-16 an operation, in single 6e-8; sums have 75 terms, a layer upon a layer."""

    def test_the_critics(
        self, net_arch: tuple[int, ...], axes: int, dtype: Any, bound: float, layer_norm: bool
    ) -> None:
        """Errors lie on both sides of 1, where Huber's loss bends."""
        of = case(net_arch, axes, dtype, layer_norm)
        of.work.goal[:] = 2 * of.batch.returns
        into = np.full_like(of.critics, np.nan)
        critic_gradient(of.critics, of.networks, of.batch, of.work, into)
        flat, goal = torch.from_numpy(of.critics.copy()).requires_grad_(), torch.from_numpy(of.work.goal)
        errors = [values(of, flat, which, *tensors(of)) for which in range(2)]
        sum(functional.smooth_l1_loss(each, goal) for each in errors).backward()  # type: ignore[union-attr]
        far = (torch.stack(errors) - goal).abs() > 1
        assert far.any()
        assert not far.all()
        assert flat.grad is not None
        assert furthest(into, flat.grad.numpy()) < bound

    def test_the_actor(self, net_arch: tuple[int, ...], axes: int, dtype: Any, bound: float, layer_norm: bool) -> None:
        of = case(net_arch, axes, dtype, layer_norm)
        into = np.full_like(of.actor, np.nan)
        actor_gradient(of.actor, of.critics, of.networks, of.batch, 0.7, of.work, into)
        flat, critics = torch.from_numpy(of.actor.copy()).requires_grad_(), torch.from_numpy(of.critics)
        output = perceptron(flat, of.networks.actor, tensors(of)[0])
        value = values(of, critics, 0, tensors(of)[0], torch.tanh(output))
        (0.7 * (output**2).mean() - value.mean()).backward()  # type: ignore[no-untyped-call]
        assert flat.grad is not None
        assert furthest(into, flat.grad.numpy()) < bound

    def test_the_targets(
        self, net_arch: tuple[int, ...], axes: int, dtype: Any, bound: float, layer_norm: bool
    ) -> None:
        of = case(net_arch, axes, dtype, layer_norm)
        targets(of.actor, of.critics, of.networks, of.batch, Noise(of.normal, 0.5, 0.6), of.work)
        arrived, critics = torch.from_numpy(of.batch.arrived), torch.from_numpy(of.critics)
        shift = torch.from_numpy(0.5 * of.normal).clamp(-0.6, 0.6)
        action = (torch.tanh(perceptron(torch.from_numpy(of.actor), of.networks.actor, arrived)) + shift).clamp(-1, 1)
        both = torch.stack([values(of, critics, which, arrived, action) for which in range(2)])
        expected = of.batch.returns + of.batch.discount * both.amin(0).numpy()
        assert of.work.goal == pytest.approx(expected, rel=0, abs=10 * bound)


def test_nothing_but_the_gradient_is_written() -> None:
    of = case((12, 7), 2)
    read = (of.actor, of.critics, *of.batch, *of.networks)
    before = [part.tobytes() for part in read]
    of.work.goal[:] = 0
    critic_gradient(of.critics, of.networks, of.batch, of.work, np.empty_like(of.critics))
    actor_gradient(of.actor, of.critics, of.networks, of.batch, 0.1, of.work, np.empty_like(of.actor))
    targets(of.actor, of.critics, of.networks, of.batch, Noise(of.normal, 0.5, 0.6), of.work)
    assert [part.tobytes() for part in read] == before


def test_a_workspace_of_another_batch_is_refused() -> None:
    of = case((12, 7), 2)
    work = TD3Buffers.of(of.networks, ROWS + 1, np.float64)
    with pytest.raises(ValueError, match="made for a batch of another size"):
        targets(of.actor, of.critics, of.networks, of.batch, Noise(of.normal, 0.5, 0.6), work)
