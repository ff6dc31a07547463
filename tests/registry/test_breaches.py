"""What of a plugin breaks its contract is named, with the rule, before any function of it is called."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.line_task import FILE, Line, line

from stlbench.contract import Agent, Policy, RewardMethod
from stlbench.registry import plugins
from stlbench.registry.breaches import breach, misfit
from stlbench.registry.choices import Choice
from stlbench.task import build_method

HEAD = "import numpy as np\nfrom stlbench.contract import RewardMethod\nclass One(RewardMethod):\n"
ARRIVAL = "    def arrival(self, signals, t): return signals[..., 0]\n"


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("extension = 7", "its extension is 7, the contract says a text"),
        ("scale = 'big'", "its scale is 'big', the contract says a number"),
        ("scale = np.ones(2)", "its scale is array([1., 1.]), the contract says a number"),
        ("floor = None", "its floor is None, the contract says a number"),
        ("memory_size = 1.5", "its memory_size is 1.5, the contract says a whole number"),
        ("input_size = 'x'", "its input_size is 'x', the contract says a whole number"),
        ("can_end = 'yes'", "its can_end is 'yes', the contract says True or False"),
        ("inputs = 3", "its inputs is int, the contract says a function of (memory)"),
        ("def over(self): pass", "its over takes (), the contract says a function of (memory)"),
        ("floor = property(lambda self: 1 / 0)", "its floor cannot be read: ZeroDivisionError: division by zero"),
        ("def __init__(self, specification): pass", "the constructor of One does not call super().__init__(spec"),
        ("def __init__(self): pass", "its constructor should take the specification, and parameters with a default by"),
        ("def __getattribute__(self, name): raise RuntimeError", "its specification cannot be read: RuntimeError"),
    ],
)
def test_a_method_is_refused_with_its_name_and_the_rule(site, body: str, said: str) -> None:
    site("acme", "[stlbench.methods]\nzz = zz_breach:One\n", {"zz_breach.py": f"{HEAD}    {body}\n{ARRIVAL}"})
    with pytest.raises(plugins.PluginError) as caught:
        plugins.build("methods", Choice("zz"), line().specification)
    assert str(caught.value).startswith(f"method 'zz' of acme 1.2 (zz_breach:One): {said}")


@pytest.mark.parametrize("name", ["memory_size", "input_size"])
def test_sizes_are_not_negative(site, name: str) -> None:
    site("acme", "[stlbench.methods]\nzz = zz_breach:One\n", {"zz_breach.py": f"{HEAD}    {name} = -1\n{ARRIVAL}"})
    with pytest.raises(ValueError, match=f"^method zz: its {name} should be at least 0, it is -1$"):
        build_method(line(), "zz")


class Odd(Agent):
    plans: Any = 7

    def train(self, training: Any) -> Any: ...


class Searched(Odd):
    plans = None
    search_space: Any = 7


class Still(Policy):
    def act(self) -> Any: ...  # type: ignore[override]


def test_agents_policies_and_systems() -> None:
    assert breach(Odd()) == "its plans is 7, the contract says 'reward' or 'formula' or None"
    assert breach(Searched()) == "its search_space is 7, the contract says a mapping"
    assert breach(Still()) == "its act takes (), the contract says a function of (observation)"
    assert breach(Line(FILE["sampling_time"])) == ""
    assert breach(type("Bad", (Line,), {"state": "x"})(1.0)) == "its state is 'x', the contract says a tuple of texts"


def test_numbers_of_numpy_are_numbers() -> None:
    kind = type("One", (RewardMethod,), {"arrival": lambda self, signals, t: signals, "scale": np.float32(2)})
    assert breach(kind(line().specification)) == ""
    assert misfit(kind, (line().specification,), {}) == ""


@pytest.mark.parametrize("kind", ["methods", "agents", "executors", "logs"])
def test_nothing_that_comes_with_stlbench_breaks_a_rule(kind: str) -> None:
    given = (line().specification,) if kind == "methods" else ()
    for name, plugin in plugins.available(kind).items():
        if plugin.is_own:
            assert misfit(plugin.load(), given, {}) == "", name
