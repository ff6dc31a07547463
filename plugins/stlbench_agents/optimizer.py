"""The step along the gradient, compiled by Numba: Adam, and the averages of weights.

One pass over the weights in blocks, since these loops wait for memory more than they compute.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stlbench_agents.kernels import START, inlined, inner_product, part
from stlbench_agents.layers import aligned, zeros
from stlbench_agents.plain_kernels import Floats

_BLOCK = 1024  # weights that Adam and the averages take at a time, so that their memory stays in the first cache


class Weights(NamedTuple):
    """The flat vectors that an update changes."""

    online: Floats
    target: Floats
    average: Floats  # of the reported policy
    gradient: Floats
    mean: Floats  # Adam's first moment
    square: Floats  # Adam's second moment

    @staticmethod
    def of(flat: Floats) -> Weights:
        return Weights(*(aligned(flat) for _ in range(3)), *(zeros(flat.shape, flat.dtype) for _ in range(3)))


def decay(first: float, last: float, updates: int) -> float:
    """The factor from one update's learning rate to the next, if it falls geometrically over so many updates."""
    return float((last / first) ** (1 / max(1, updates - 1)))


@inlined
def clipping(gradient: Floats, max_norm: float) -> float:
    """The factor, at most 1, that brings the gradient's norm to `max_norm`."""
    total = inner_product(gradient, START, gradient, START, len(gradient))
    return float(min(1.0, max_norm / (np.sqrt(total) + 1e-6)))


@inlined
def adam(
    weights: Floats, gradient: Floats, mean: Floats, square: Floats, rate: float, count: int, factor: float
) -> None:
    """Step `count` (from 1) of Adam (Kingma, Ba 2015; betas 0.9, 0.999, epsilon 1e-8) on `factor` times the gradient.

    A weight without gradient (a dead ReLU, an action not drawn) would push its moments into denormal numbers, which
    are a hundred times slower: adding 1e-30 keeps them out.
    """
    kind = weights.dtype.type
    unbiased = np.sqrt(1 - 0.999**count)
    step, epsilon, tiny = kind(rate * unbiased / (1 - 0.9**count)), kind(1e-8 * unbiased), kind(1e-30)
    clip = kind(factor)
    for i in range(len(weights)):
        slope = gradient[i] * clip
        mean[i] = kind(0.9) * mean[i] + kind(0.1) * slope + tiny
        square[i] = kind(0.999) * square[i] + kind(0.001) * slope * slope + tiny
        weights[i] -= step * mean[i] / (np.sqrt(square[i]) + epsilon)


@inlined
def blend(into: Floats, weights: Floats, share: float) -> None:
    """into = (1 - share) into + share weights: a target network, or averaged weights, one step on; exact at 0 and 1."""
    part, rest = into.dtype.type(share), into.dtype.type(1 - share)
    for i in range(len(into)):
        into[i] = rest * into[i] + part * weights[i]


@part
def step(weights: Weights, rate: float, count: int, max_norm: float, target_share: float, average_share: float) -> None:
    """Step `count` of Adam along the gradient, its norm clipped; then target and average move by their shares."""
    factor = clipping(weights.gradient, max_norm) if max_norm < np.inf else 1.0
    for begin in range(0, len(weights.online), _BLOCK):
        now = slice(begin, begin + _BLOCK)
        online = weights.online[now]
        adam(online, weights.gradient[now], weights.mean[now], weights.square[now], rate, count, factor)
        if target_share > 0:
            blend(weights.target[now], online, target_share)
        if average_share > 0:
            blend(weights.average[now], online, average_share)
