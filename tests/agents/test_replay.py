"""The ring of transitions: n-step returns by hand, and against the whole history."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stlbench.contract import Array, Event, Transition, Truth
from stlbench_agents.replay import Batch, Replay, weighted_rewards

EPISODE = 4
"""Decisions an episode, in the histories below."""


def came(
    arrived: Array, reward: Array, cut: Truth, ended: Truth | None = None, lost: Truth | None = None
) -> Transition:
    """Where nothing is said of `ended` it is `cut`; nothing is lost."""
    event = np.where(cut, np.where(cut if ended is None else ended, Event.TIME_LIMIT, Event.CUT), Event.GOES_ON)
    event = event if lost is None else np.where(lost, Event.END, event)
    return Transition(observation=arrived, reward=reward, arrived=arrived, event=event.astype(np.int8))


def unweighted(gamma: float) -> float:
    """The `scale` with which rewards are stored as they are, so that returns are easily added up."""
    return 1 / (1 - gamma) if gamma < 1 else 1.0


def filled(steps: int, rows: int, copies: int, n_steps: int, gamma: float) -> Replay:
    """`steps` lock-steps; the observation names its step and copy, (t, c), and what is arrived at is (t + 1, c).

    The reward of step t is 2^(t mod 4) of copy 0 and ten times that of copy 1. The episodes of copy c end after the
    steps t with (t + c) % 4 = 3.
    """
    replay = Replay(rows, copies, 2, n_steps, gamma, unweighted(gamma))
    copy = np.arange(copies)
    for t in range(steps):
        ended = (t + copy) % EPISODE == EPISODE - 1
        arrived = np.stack([np.full(copies, t + 1.0), copy], axis=1)
        reward = 2.0 ** (t % EPISODE) * 10.0**copy
        assert replay.ready == (t >= n_steps)
        replay.add(np.stack([np.full(copies, float(t)), copy], axis=1), 7 * t + copy, came(arrived, reward, ended))
    return replay


@pytest.mark.parametrize(("gamma", "expected"), [(0.9, [20, 4, 6]), (1.0, [2, 4, 6])])
def test_a_last_reward_counts_for_ever_or_once(gamma: float, expected: list[float]) -> None:
    """gamma = .9: ten times at an end; once where the method is over, where something follows, and where gamma = 1."""
    wide, event = np.zeros((3, 1)), np.array([Event.END, Event.OVER, Event.TIME_LIMIT], np.int8)
    transition = Transition(wide, np.array([1.0, 2, 3]), wide, event)
    assert weighted_rewards(transition, gamma, 2.0) == pytest.approx(expected)


def drawn(replay: Replay, batch: int = 4000) -> Batch:
    return replay.batch(replay.draw(np.random.default_rng(0), 1, batch)[0])


@pytest.mark.parametrize(("steps", "rows"), [(7, 10), (11, 10), (40, 10), (25, 7)])
@pytest.mark.parametrize("n_steps", [1, 3])
@pytest.mark.parametrize("copies", [1, 2])
def test_every_sample_is_a_piece_of_the_history_and_all_are_equally_likely(
    steps: int, rows: int, n_steps: int, copies: int
) -> None:
    """Also after the ring has wrapped around: no window reaches over the write position."""
    gamma, count = 0.5, 2000
    batch = drawn(filled(steps, rows, copies, n_steps, gamma), count)
    for i in range(count):
        t, copy = batch.observation[i].astype(int).tolist()
        assert batch.action[i] == 7 * t + copy
        returns, used = 0.0, 0
        while used < n_steps:
            returns += gamma**used * 2.0 ** ((t + used) % EPISODE) * 10.0**copy
            used += 1
            if (t + used - 1 + copy) % EPISODE == EPISODE - 1:
                break
        expected = (pytest.approx(returns), [t + used, copy], pytest.approx(gamma**used))
        assert (batch.returns[i], batch.arrived[i].tolist(), batch.discount[i]) == expected
    beginnings = range(max(0, steps - rows), steps - n_steps + 1)
    pairs, often = np.unique(batch.observation, axis=0, return_counts=True)
    assert pairs.tolist() == [[t, copy] for t in beginnings for copy in range(copies)]
    mean = count / len(pairs)
    assert np.abs(often - mean).max() < 5 * np.sqrt(mean)  # Poisson: five standard deviations


def test_what_was_stored_does_not_change_with_the_callers_arrays() -> None:
    replay, observation = Replay(4, 1, 2, 1, 0.5, scale=2), np.array([[1.0, 2.0]])
    action, reward, cut = np.array([5]), np.array([3.0]), np.array([False])
    replay.add(observation, action, came(observation, reward, cut))
    observation[:], action[:], reward[:], cut[:] = 0, 0, 0, True
    batch = drawn(replay, 1)
    assert batch.observation.tolist() == batch.arrived.tolist() == [[1, 2]]
    assert (batch.action[0], batch.returns[0], batch.discount[0]) == (5, 3, 0.5)


def one_copy(kinds: str, n_steps: int = 3, gamma: float = 0.5, scale: float = 1.0, limit: bool = False) -> Batch:
    """All windows into steps of one copy, a letter each: - goes on, c cut, e ended, l lost; rewards 1 2 4 8 ...

    What step i arrives at is (i + 1).
    """
    replay = Replay(len(kinds), 1, 1, n_steps, gamma, scale * unweighted(gamma), limit)
    for i, kind in enumerate(kinds):
        here, flags = np.array([[float(i)]]), [np.array([kind in which]) for which in ("cel", "el", "l")]
        replay.add(here, np.array([i]), came(here + 1, np.array([2.0**i]), *flags))
    return replay.batch(np.arange(len(kinds) - n_steps + 1))


@pytest.mark.parametrize(
    ("kinds", "settings", "returns", "arrived", "discount"),
    [
        # nothing stops: 1 + 2/2 + 4/4, 2 + 4/2 + 8/4, 4 + 8/2 + 16/4
        ("-----", {}, [3, 6, 12], [3, 4, 5], [1 / 8, 1 / 8, 1 / 8]),
        # a phase boundary after step 1: 1 + 2/2 and 2, with the value of what step 1 arrived at
        ("-c---", {}, [2, 2, 12], [2, 2, 5], [1 / 4, 1 / 2, 1 / 8]),
        # the time limit there: the same
        ("-e---", {}, [2, 2, 12], [2, 2, 5], [1 / 4, 1 / 2, 1 / 8]),
        # a violation there: 2 is worth 2 / (1 - 1/2) = 4, so 1 + 4/2 and 4, and nothing beyond
        ("-l---", {}, [3, 4, 12], [2, 2, 5], [0, 0, 1 / 8]),
        # after step 2, the last of the first window: 1 + 2/2 + 8/4, 2 + 8/2, 8
        ("--l--", {}, [4, 6, 8], [3, 3, 3], [0, 0, 0]),
        # one at the first and another at the third: 1, 2 + 4/2, 4
        ("c-c--", {}, [1, 4, 4], [1, 3, 3], [1 / 2, 1 / 4, 1 / 2]),
        # without a discount a violation counts once: 1 + 2 and 2
        ("-l-", {"n_steps": 2, "gamma": 1.0}, [3, 2], [2, 2], [0, 0]),
        # the scale multiplies every reward, also the last one, and no discount
        ("-l---", {"scale": 10.0}, [30, 40, 120], [2, 2, 5], [0, 0, 1 / 8]),
        # a time limit bootstraps, or is terminal; a cut always bootstraps; 8 / (1 - 1/2) is the violation's
        ("-cel-", {"n_steps": 1}, [1, 2, 4, 16, 16], [1, 2, 3, 4, 5], [1 / 2, 1 / 2, 1 / 2, 0, 1 / 2]),
        ("-cel-", {"n_steps": 1, "limit": True}, [1, 2, 4, 16, 16], [1, 2, 3, 4, 5], [1 / 2, 1 / 2, 0, 0, 1 / 2]),
    ],
)
def test_returns_that_stop(
    kinds: str, settings: dict[str, Any], returns: list[float], arrived: list[float], discount: list[float]
) -> None:
    batch = one_copy(kinds, **settings)
    assert (batch.returns.tolist(), batch.discount.tolist()) == (returns, discount)
    assert batch.arrived[:, 0].tolist() == arrived


def test_a_place_in_the_ring_that_is_written_again_forgets_its_end() -> None:
    replay, here = Replay(2, 1, 1, 1, 0.5, scale=2), np.zeros((1, 1))
    for yes in (True, True, False, False):
        flag = np.array([yes])
        replay.add(here, np.array([0]), came(here, np.ones(1), flag, flag, flag))
    batch = replay.batch(np.arange(2))
    assert (batch.returns.tolist(), batch.discount.tolist()) == ([1, 1], [0.5, 0.5])


@pytest.mark.parametrize(("gamma", "weight"), [(0.75, 0.5), (0.0, 2.0), (1.0, 2.0)])
def test_rewards_are_weighted_by_1_minus_gamma_where_that_is_not_0(gamma: float, weight: float) -> None:
    """And by the scale, here 2: rewards 1 1 1 make weight * (1 + gamma + gamma^2)."""
    replay, here, nothing = Replay(3, 1, 1, 3, gamma, scale=2.0), np.zeros((1, 1)), np.zeros(1, np.bool_)
    for _ in range(3):
        replay.add(here, np.array([0]), came(here, np.ones(1), nothing))
    batch = replay.batch(np.arange(1))
    assert batch.returns[0] == pytest.approx(weight * (1 + gamma + gamma**2))
    assert batch.discount[0] == pytest.approx(gamma**3)


@pytest.mark.parametrize(
    ("gamma", "limit", "bounds"), [(0.5, False, [2, 6]), (0.5, True, [0, 6]), (1.0, False, [-np.inf, np.inf])]
)
def test_values_are_bounded_by_the_rewards_that_were_seen(gamma: float, limit: bool, bounds: list[float]) -> None:
    """By 1 and 3, times the scale; by 0 too where nothing follows a limit. With gamma = 1 a value is a sum."""
    replay, here, nothing = Replay(9, 2, 1, 1, gamma, 2.0, limit), np.zeros((2, 1)), np.zeros(2, np.bool_)
    for rewards in ([2.0, 3.0], [1.0, 1.5]):
        replay.add(here, np.zeros(2, int), came(here, np.array(rewards), nothing))
    assert replay.batch(np.arange(2)).bounds.tolist() == bounds


def test_updates_of_one_lock_step_draw_different_rows() -> None:
    first = filled(8, rows=20, copies=2, n_steps=1, gamma=0.5).draw(np.random.default_rng(0), 3, 50)
    assert first.shape == (3, 50)
    assert len({row.tobytes() for row in first}) == 3


def test_actions_that_are_vectors() -> None:
    replay, here, nothing = Replay(4, 2, 1, 1, 0.5, axes=3), np.zeros((2, 1)), np.zeros(2, np.bool_)
    for i in range(4):
        replay.add(here, i + np.array([[0, 0.5, 1], [10, 10.5, 11]]), came(here, np.ones(2), nothing))
    assert replay.batch(np.array([5, 0])).action.tolist() == [[12, 12.5, 13], [0, 0.5, 1]]


@pytest.mark.parametrize(("steps", "rows", "room"), [(7, 10, 20), (11, 10, 20), (40, 10, 12), (25, 10, 4)])
def test_another_replay_goes_on_with_the_newest_transitions(steps: int, rows: int, room: int) -> None:
    """Returns that begin in what was kept are those of before, but stop at its end. Step 23 comes last of 24."""
    earlier, later = filled(steps, rows, 2, 3, 0.9), filled(0, room, 2, 3, 0.9)
    later.refill(earlier.kept())
    known = min(steps, rows, room)
    assert later.count == known
    batch = drawn(later)
    assert {*batch.observation[:, 0].tolist()} == {*map(float, range(steps - known, steps - 2))}
    for name in ("observation", "action", "reward"):
        ended = getattr(earlier.memory, name).reshape(rows, 2, -1)[np.arange(steps - known, steps) % rows]
        np.testing.assert_array_equal(getattr(later.memory, name).reshape(room, 2, -1)[:known], ended)
    np.testing.assert_array_equal(later.memory.bounds, earlier.memory.bounds)
    wide = np.zeros((2, 2))
    for _ in range(3):
        later.add(wide, np.zeros(2), came(wide, np.full(2, 1e6), np.zeros(2, bool)))
    assert later.batch(np.array([0, 1]) + 2 * (known - 1)).returns.max() < 1e3  # none of the new rewards


def test_few_transitions_are_kept_of_a_large_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stlbench_agents.replay._KEPT", 9)
    kept = filled(20, 30, 2, 3, 0.9).kept()
    assert kept["observation"][:, 0].tolist() == [16, 16, 17, 17, 18, 18, 19, 19]
    monkeypatch.setattr("stlbench_agents.replay._NUMBERS", 20)  # of five transitions with two inputs
    assert filled(20, 30, 2, 3, 0.9).kept()["reward"].shape == (4,)
