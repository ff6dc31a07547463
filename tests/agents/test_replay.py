"""The ring of transitions: n-step returns by hand, and against the whole history."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench.contract import Transition
from stlbench_agents.replay import Batch, Replay

EPISODE = 4
"""Decisions an episode, in the histories below."""


def filled(steps: int, rows: int, copies: int, n_steps: int, gamma: float) -> Replay:
    """`steps` lock-steps; the observation names its step and copy, (t, c), and what is arrived at is (t + 1, c).

    The reward of step t is 2^(t mod 4) of copy 0 and ten times that of copy 1. The episodes of copy c end after the
    steps t with (t + c) % 4 = 3.
    """
    replay = Replay(rows, copies, 2, n_steps, gamma)
    copy = np.arange(copies)
    for t in range(steps):
        ended = (t + copy) % EPISODE == EPISODE - 1
        arrived = np.stack([np.full(copies, t + 1.0), copy], axis=1)
        reward = 2.0 ** (t % EPISODE) * 10.0**copy
        replay.add(
            np.stack([np.full(copies, float(t)), copy], axis=1),
            7 * t + copy,
            Transition(arrived, reward, arrived, ended),
        )
    return replay


def drawn(replay: Replay, batch: int = 4000) -> Batch:
    return replay.sample(np.random.default_rng(0), batch)


def sample_of(batch: Batch, t: int, copy: int) -> tuple[float, list[float], float, bool]:
    """Return, arrived, discount and end of the samples that begin at (t, copy), which must all be equal."""
    rows = np.flatnonzero((batch.observation == [t, copy]).all(axis=1))
    found = {
        (float(batch.returns[i]), tuple(batch.arrived[i].tolist()), float(batch.discount[i]), bool(batch.ended[i]))
        for i in rows
    }
    ((returns, arrived, discount, ended),) = found
    return returns, list(arrived), discount, ended


def test_three_step_returns_by_hand() -> None:
    """gamma = .5, rewards 1 2 4 8 | 1 2 4 8: no return reaches over the end of the episode after step 3.

    From 0: 1 + 2/2 + 4/4 = 3, bootstrap at 3 with 1/8. From 1: 2 + 4/2 + 8/4 = 6, ends exactly. From 2: 4 + 8/2 = 8
    after two rewards, with 1/4. From 3: 8, with 1/2. From 4 as from 0. From 5 as from 1.
    """
    batch = drawn(filled(8, rows=20, copies=1, n_steps=3, gamma=0.5))
    assert sample_of(batch, 0, 0) == (3, [3, 0], 1 / 8, False)
    assert sample_of(batch, 1, 0) == (6, [4, 0], 1 / 8, True)
    assert sample_of(batch, 2, 0) == (8, [4, 0], 1 / 4, True)
    assert sample_of(batch, 3, 0) == (8, [4, 0], 1 / 2, True)
    assert sample_of(batch, 4, 0) == (3, [7, 0], 1 / 8, False)
    assert sample_of(batch, 5, 0) == (6, [8, 0], 1 / 8, True)
    assert set(batch.observation[:, 0]) == {0, 1, 2, 3, 4, 5}


def test_one_step_returns() -> None:
    batch = drawn(filled(6, rows=20, copies=2, n_steps=1, gamma=0.5))
    assert sample_of(batch, 2, 1) == (40, [3, 1], 0.5, True)
    assert sample_of(batch, 2, 0) == (4, [3, 0], 0.5, False)
    assert set(batch.action[(batch.observation == [5, 1]).all(axis=1)]) == {36}


@pytest.mark.parametrize(("steps", "rows"), [(7, 10), (10, 10), (11, 10), (23, 10), (40, 10), (25, 7)])
@pytest.mark.parametrize("n_steps", [1, 3])
@pytest.mark.parametrize("copies", [1, 2])
def test_every_sample_is_a_piece_of_the_history_and_all_are_equally_likely(
    steps: int, rows: int, n_steps: int, copies: int
) -> None:
    """Also after the ring has wrapped around: no window reaches over the write position."""
    gamma, count = 0.5, 4000
    batch = drawn(filled(steps, rows, copies, n_steps, gamma), count)
    for i in range(count):
        t, copy = batch.observation[i].astype(int).tolist()
        assert batch.action[i] == 7 * t + copy
        returns, used = 0.0, 0
        while used < n_steps:
            returns += gamma**used * 2.0 ** ((t + used) % EPISODE) * 10.0**copy
            used += 1
            if ended := (t + used - 1 + copy) % EPISODE == EPISODE - 1:
                break
        expected = (pytest.approx(returns), [t + used, copy], pytest.approx(gamma**used), ended)
        assert (batch.returns[i], batch.arrived[i].tolist(), batch.discount[i], batch.ended[i]) == expected
    beginnings = range(max(0, steps - rows), steps - n_steps + 1)
    pairs, often = np.unique(batch.observation, axis=0, return_counts=True)
    assert pairs.tolist() == [[t, copy] for t in beginnings for copy in range(copies)]
    mean = count / len(pairs)
    assert np.abs(often - mean).max() < 5 * np.sqrt(mean)  # Poisson: five standard deviations


def test_it_is_ready_when_it_holds_one_window() -> None:
    replays = [filled(steps, rows=9, copies=2, n_steps=3, gamma=0.9) for steps in (2, 3)]
    assert [replay.ready for replay in replays] == [False, True]


def test_what_was_stored_does_not_change_with_the_callers_arrays() -> None:
    replay, observation = Replay(4, 1, 2, 1, 0.9), np.array([[1.0, 2.0]])
    reward, ended = np.array([3.0]), np.array([False])
    replay.add(observation, np.array([5]), Transition(observation, reward, observation, ended))
    observation[:], reward[:], ended[:] = 0, 0, True
    batch = drawn(replay, 1)
    assert batch.observation.tolist() == batch.arrived.tolist() == [[1, 2]]
    assert (batch.returns[0], batch.ended[0]) == (3, False)
