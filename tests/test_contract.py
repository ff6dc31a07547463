"""What the contract itself does: of `step` and `along`, the one that is not written follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification
from stlbench.stl import parse

SPECIFICATION = Specification(parse("G[0,9] x >= 0"), ("x",), (-9.0,), (9.0,), steps=9, dt=1.0)
SAMPLES = np.array([[[1.0], [2.0]], [[3.0], [5.0]], [[4.0], [-1.0]]])
"""(3, 2, 1): two rows while an action is held for two steps."""
ACTION, AT, TWO = np.zeros((2, 1)), np.array([0, 4]), np.zeros((2, 1))


class Steps(RewardMethod):
    """Reward 10 t + how far x moved, and the memory is the sum of such rewards."""

    memory_size = 1

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        reward = 10 * t + (next_signals - signals)[:, 0]
        return reward, memory + reward[:, None]


class Along(RewardMethod):
    """The same, written for all steps at once."""

    memory_size = 1

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        rewards = 10 * (t + np.arange(len(samples) - 1)[:, None]) + np.diff(samples[..., 0], axis=0)
        return rewards, memory + rewards.sum(axis=0)[:, None]


@pytest.mark.parametrize("kind", [Steps, Along])
def test_either_gives_both(kind: type[RewardMethod]) -> None:
    """From 1 to 3 to 4 at t = 0 and 1; from 2 to 5 to -1 at t = 4 and 5."""
    method = kind(SPECIFICATION)
    rewards, memory = method.along(SAMPLES, ACTION, AT, TWO)
    assert rewards.tolist() == [[2, 43], [11, 44]]
    assert memory.tolist() == [[13], [87]]
    reward, memory = method.step(SAMPLES[0], ACTION, SAMPLES[1], AT, TWO)
    assert (reward.tolist(), memory.tolist()) == ([2, 43], [[2], [43]])


def test_without_memory_along_is_one_call_of_step() -> None:
    calls = list[int]()

    class Plain(RewardMethod):
        def step(
            self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
        ) -> tuple[Array, Array]:
            calls.append(len(t))
            return 10 * t + (next_signals - signals)[:, 0], memory

    rewards, memory = Plain(SPECIFICATION).along(SAMPLES, ACTION, AT, np.zeros((2, 0)))
    assert (rewards.tolist(), memory.shape, calls) == ([[2, 43], [11, 44]], (2, 0), [4])


def test_the_last_that_is_written_counts() -> None:
    """A subclass that writes the other of the two is not paid as its base was."""

    class Doubled(Along):
        def step(
            self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
        ) -> tuple[Array, Array]:
            return 2 * next_signals[:, 0], memory

    class Inherited(Doubled):
        """Writes nothing, and is what Doubled is."""

    for kind in (Doubled, Inherited):
        assert kind(SPECIFICATION).along(SAMPLES, ACTION, AT, TWO)[0].tolist() == [[6, 10], [8, -2]]


def test_both_or_neither_is_refused_when_the_class_is_made() -> None:
    with pytest.raises(TypeError, match=r"^Neither must have one of arrival, step and along, and has none of them$"):
        type("Neither", (RewardMethod,), {})
    with pytest.raises(TypeError, match=r"^Both must have one of arrival, step and along, and has step and along$"):
        type("Both", (Steps,), {"step": Steps.step, "along": RewardMethod.along})


@pytest.mark.parametrize(("above", "name"), [("along", "step"), ("step", "along"), ("arrival", "step")])
def test_what_only_follows_from_another_way_cannot_be_called_by_super(above: str, name: str) -> None:
    ways = {"step": Steps.step, "along": Along.along, "arrival": lambda self, signals, t: signals[..., 0]}
    written = type("Above", (RewardMethod,), {above: ways[above]})
    own = type("Own", (written,), {name: lambda self, *words: getattr(super(own, self), name)(*words)})
    words = {"step": (SAMPLES[0], ACTION, SAMPLES[1], AT, TWO), "along": (SAMPLES, ACTION, AT, TWO)}[name]
    with pytest.raises(TypeError, match=rf"^Own.{name} calls super\(\).{name}, which would only call it again; call"):
        getattr(own(SPECIFICATION), name)(*words)


def test_arrival_alone_gives_step_and_along() -> None:
    """x at s_t plus 10 t, paid for s_1, s_2, ...: never for the sample that a transition begins with."""

    class Arrival(RewardMethod):
        def arrival(self, signals: Array, t: Integers) -> Array:
            return signals[..., 0] + 10 * t

    method, nothing = Arrival(SPECIFICATION), np.zeros((2, 0))
    expected = SAMPLES[1:, :, 0] + 10 * (AT + np.array([[1], [2]]))
    assert method.paid_on_arrival
    assert method.along(SAMPLES, ACTION, AT, nothing)[0].tolist() == expected.tolist()
    assert method.step(SAMPLES[0], ACTION, SAMPLES[1], AT, nothing)[0].tolist() == expected[0].tolist()

    class Stepped(Arrival):
        def step(
            self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
        ) -> tuple[Array, Array]:
            return signals[:, 0], memory

    later = Stepped(SPECIFICATION)
    assert not later.paid_on_arrival
    assert later.along(SAMPLES, ACTION, AT, nothing)[0].tolist() == SAMPLES[:-1, :, 0].tolist()
    with pytest.raises(TypeError, match=r"^Stepped is not paid for samples alone: it has no arrival$"):
        later.arrival(SAMPLES[0], AT)


def test_a_range_is_proven_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, bounds = list[str](), stl.bounds
    monkeypatch.setattr(stl, "bounds", lambda psi, box: asked.append(str(psi)) or bounds(psi, box))
    specification = replace(SPECIFICATION)
    for _ in range(2):
        assert specification.range(parse("x >= 1")) == pytest.approx((-10, 8))
        assert specification.range(parse("x >= 2")) == pytest.approx((-11, 7))
    assert asked == ["x >= 1", "x >= 2"]
