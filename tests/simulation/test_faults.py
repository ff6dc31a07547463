"""What plugins must not give at run time: each is told with the plugin's name, the rule, the step and the copies."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from helpers.latch import Latch
from helpers.line_task import Line, Probe, line
from helpers.stepwise import Stepwise

from stlbench.contract import Array, Integers, RewardMethod
from stlbench.registry.choices import Choice
from stlbench.simulation.environment import BatchEnvironment, Simulator
from stlbench.simulation.faults import PluginFault
from stlbench.task import build_method
from stlbench.task.task import Task
from stlbench_methods.raw import Raw

STAY = np.array([1, 1, 1])
NAN, INF = np.nan, np.inf


def stepped(method: RewardMethod, task: Task | None = None, times: int = 3) -> None:
    simulator = Simulator(task or line(hold=2), method)
    simulator.reset(np.array([[0.0], [1.0], [2.0]]))
    for _ in range(times):
        simulator.advance(STAY)
        simulator.observe()


class Paying(Probe):
    """Pays something odd from step 3 on, in two of three copies."""

    odd: Any = NAN

    def step(self, *words: Any) -> tuple[Array, Array]:
        rewards, memory = super().step(*words)
        late = (words[3] >= 3) & (words[0][:, 0] > 0)
        return np.where(late, self.odd, rewards), memory


def odd(base: type[Any], name: str, **methods: Callable[..., Any]) -> Any:
    """A class of this name, which does some things otherwise than the one that it is based on."""
    return type(name, (base,), methods)


def forgetting(self: Probe, *words: Any) -> tuple[Array, Array]:
    rewards, memory = Probe.step(self, *words)
    return rewards, memory[:, 1:]


SPEC = line(hold=2).specification


@pytest.mark.parametrize(
    ("method", "said"),
    [
        (Paying(SPEC), "method Paying: reward is nan at step 4 in 2 of 3 copies"),
        (
            odd(Probe, "Forgetting", step=forgetting)(SPEC, 2),
            r"method Forgetting: the shape of its memory is \(3, 0\), the contract says \(3, 2\)",
        ),
        (
            odd(Probe, "Blind", inputs=lambda _, memory: np.where(memory > 2, NAN, memory))(SPEC, 1),
            "method Blind: input is nan at step 4 in 3 of 3 copies",
        ),
    ],
)
def test_what_a_method_gives(method: RewardMethod, said: str) -> None:
    with pytest.raises(PluginFault, match=f"^{said}$"):
        stepped(method)


@pytest.mark.parametrize(
    ("name", "function", "said"),
    [
        ("over", lambda _, memory: memory[:, 0] / 2, "over gives float64, the contract says whether: bool"),
        ("over", lambda _, memory: np.bool_(memory.all()), r"the shape of its over is \(\), the contract says \(3,\)"),
        ("counterfactual", lambda *words: np.full_like(words[3], NAN), "memory is nan at step 0 in 3 of 3 copies"),
    ],
)
def test_what_a_method_adds(name: str, function: Callable[..., Any], said: str) -> None:
    task = line(hold=2)
    environment = BatchEnvironment(task, odd(Latch, "Odd", **{name: function})(task.specification), 3, seed=0)
    environment.reset()
    with pytest.raises(PluginFault, match=f"^method Odd: {said}$"):
        _ = environment.step(STAY), environment.counterfactual(np.random.default_rng(0))


def test_an_installed_method_is_told_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Raw, "arrival", lambda self, signals, t: np.full(t.shape, INF))
    with pytest.raises(PluginFault, match=r"^method raw: reward is inf at step 1 in 3 of 3 copies$"):
        stepped(Raw(SPEC))


@pytest.mark.parametrize(
    ("name", "function", "said"),
    [
        (
            "step",
            lambda _, state, action: np.where(state > 1, NAN, state),
            "signal x is nan at step 1 in 1 of 3 copies",
        ),
        ("signals", lambda _, state: np.tile(state, 2), r"the shape of its signals is \(3, 2\), .* says \(3, 1\)"),
        ("features", lambda _, state, t: np.full((3, 2), INF), "feature 0 is inf at step 0 in 3 of 3 copies"),
    ],
)
def test_what_a_system_gives(name: str, function: Callable[..., Any], said: str) -> None:
    system = odd(Line, "Odd", **{name: function})(0.5)
    with pytest.raises(PluginFault, match=f"^task line: {said}$"):
        stepped(Probe(SPEC), Task(Choice("line"), line(hold=2).file, system))


def test_finite_features_may_have_an_infinite_sum() -> None:
    system = odd(Line, "Odd", features=lambda _, state, t: np.full((3, 2), 1e308))(0.5)
    stepped(Raw(SPEC), Task(Choice("line"), line(hold=2).file, system))


@pytest.mark.parametrize(
    ("action", "said"),
    [
        (np.array([1, 99, 1]), "the agent's action 99 is none of 0..2, at step 0 of copy 1"),
        (np.array([1, 1, -1]), "the agent's action -1 is none of 0..2, at step 0 of copy 2"),
        (np.array([1]), r"the agent's actions have shape \(1,\), for 3 copies it is \(3,\)"),
        (np.array([[1.0], [NAN], [0.0]]), "the agent's action nan is no finite number, at step 0 of copy 1"),
        (np.array(["a", "b", "c"]), "the agent's actions should be whole numbers or floats, they are <U1"),
    ],
)
def test_what_an_agent_gives(action: Any, said: str) -> None:
    simulator = Simulator(line(), Probe(SPEC))
    simulator.reset(np.zeros((3, 1)))
    with pytest.raises(PluginFault, match=f"^{said}$"):
        simulator.advance(action)


def test_indices_are_not_for_continuous_actions() -> None:
    simulator = Simulator(line(actions={"v": {"low": -1, "high": 1}}), Probe(SPEC))
    simulator.reset(np.zeros((3, 1)))
    with pytest.raises(PluginFault, match=r"^the agent's actions should be floats, as the task's are continuous"):
        simulator.advance(STAY)


@pytest.mark.parametrize("scale", [NAN, -1.0, 0.0])
def test_a_scale_that_nothing_can_be_divided_by(scale: float, monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"scale": scale, "specification": 1, "_floor": -1.0}
    monkeypatch.setattr(Raw, "__init__", lambda self, specification: self.__dict__.update(values))
    with pytest.raises(ValueError, match=r"^method raw: its scale should be finite and more than 0, it is"):
        build_method(line(), "raw")


NO_NUMBERS = "its rewards are {}, the contract says an array of real numbers, float64"
NOT_ONE_A_COPY = r"the shape of its rewards is \(.*\), the contract says \([12], 3\)"


@pytest.mark.parametrize(
    ("paid", "said"),
    [
        (lambda n: np.resize(["1", "2", "3"], n), NO_NUMBERS.format("<U1")),
        (lambda n: np.zeros(n, complex), NO_NUMBERS.format("complex128")),
        (lambda n: np.zeros(n, "timedelta64[s]"), NO_NUMBERS.format(r"timedelta64\[s\]")),
        (lambda n: np.ma.masked_array(np.ones(n), np.arange(n) == 1), NO_NUMBERS.format("a masked array")),
        (lambda n: np.array([Fraction(1, 2)] * n), NO_NUMBERS.format("object")),
        *((lambda n, shape=shape: np.zeros(shape), NOT_ONE_A_COPY) for shape in ((), (1,), (5,))),
    ],
)
@pytest.mark.parametrize(("hold", "size"), [(1, 1), (2, 0)])
def test_rewards_that_are_no_real_numbers_or_not_one_for_each_copy(
    paid: Callable[[int], Any], said: str, hold: int, size: int
) -> None:
    """NumPy would make floats of these types, and stretch one number to as many as there are."""

    class Odd(Stepwise):
        memory_size = size

        def step(self, signals: Array, action: Array, after: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
            return paid(len(t)), memory

    task = line(hold=hold)
    environment = BatchEnvironment(task, Odd(task.specification), 3, seed=0)
    environment.reset()
    with pytest.raises(PluginFault, match=f"^method Odd: {said}$"):
        environment.step(STAY)
