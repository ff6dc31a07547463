"""Finding and loading plugins, with distributions made up in a folder on the path."""

from __future__ import annotations

import sys
import warnings

import pytest

from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choice

GOOD = '''
"""A module."""
from typing import Literal
from stlbench.contract import RewardMethod

class {name}(RewardMethod):
    """Pays one.

    More.
    """
    def __init__(self, specification, *, ginf: float = 0.01, variant: Literal["paper", "code"] = "paper"):
        self.specification, self.ginf, self.variant = specification, ginf, variant
    def arrival(self, signals, t):
        return 1 + 0 * signals[..., 0]
'''


def methods(**entries: str) -> str:
    return "[stlbench.methods]\n" + "".join(f"{name.replace('_', '-')} = {value}\n" for name, value in entries.items())


def test_nothing_is_imported_to_list_what_there_is(site):
    site("acme-rewards", methods(zz_one="zz_acme:One"), {"zz_acme.py": "raise RuntimeError('imported')"})
    found = plugins.available("methods")
    assert list(found) == sorted(found)
    plugin = found["zz-one"]
    assert (plugin.kind, plugin.distribution, plugin.version) == ("methods", "acme-rewards", "1.2")
    assert "zz_acme" not in sys.modules
    assert "zz-one" not in plugins.available("tasks")


def test_a_plugin_is_loaded_described_and_built(site):
    site("acme", methods(zz_one="zz_acme:One"), {"zz_acme.py": GOOD.format(name="One")})
    plugin = plugins.find("methods", "zz-one")
    assert plugin.summary == "Pays one."
    known = {name: (each.text, each.default) for name, each in plugins.parameters(plugin).items()}
    assert known == {"ginf": ("float", 0.01), "variant": ("paper | code", "paper")}
    method = plugins.build("methods", parse_choice("zz-one[ginf=0.02]"), "spec", defaults={"variant": "code"})
    assert (method.specification, method.ginf, method.variant) == ("spec", 0.02, "code")
    with pytest.raises(UsageError, match=r"zz-one\[ginf=x\]: ginf should be a number, got 'x'"):
        plugins.build("methods", parse_choice("zz-one[ginf=x]"), "spec")


@pytest.mark.parametrize(("word", "meant"), [("Dask", "dask"), ("locl", "local")])
def test_an_executor_is_found_by_what_it_runs_on(word, meant):
    with pytest.raises(UsageError, match=f"^no executor '{word}'; did you mean '{meant}'\\?$"):
        plugins.find("executors", word)


METHOD = "from stlbench.contract import RewardMethod\nclass One(RewardMethod):"
BROKEN = {
    "raises": ("raise RuntimeError('no\\nway')", "RuntimeError: no way"),
    "exits": ("raise SystemExit(3)", "SystemExit: 3"),
    "syntax": ("def", "SyntaxError"),
    "needs": ("import zz_no_such_module", "No module named 'zz_no_such_module'"),
    "nothing": ("", "has no attribute 'One'"),
    "function": ("def One(): pass", "it must be a subclass of stlbench.contract.RewardMethod"),
    "other": ("class One: pass", "it must be a subclass of stlbench.contract.RewardMethod"),
    "neither": (f"{METHOD} pass", "must have one of arrival and along, and has neither"),
    "both": (f"{METHOD} arrival = along = None", "One must have one of arrival and along, and has both"),
}


def test_what_an_abstract_class_lacks_is_named(site):
    source = "from stlbench.contract import System\nclass One(System):\n    def step(self, state, action): pass\n"
    site("acme", "[stlbench.tasks]\nzz-bad = zz_abstract:One\n", {"zz_abstract.py": source})
    with pytest.raises(plugins.PluginError, match=r"it lacks signals of stlbench\.contract\.System"):
        plugins.find("tasks", "zz-bad").load()


@pytest.mark.parametrize(("source", "cause"), BROKEN.values(), ids=BROKEN)
def test_a_broken_plugin_is_one_line_that_names_its_distribution_and_the_others_work(site, source, cause):
    site("acme", methods(zz_bad="zz_bad:One"), {"zz_bad.py": source})
    site("zebra", methods(zz_good="zz_good:Good"), {"zz_good.py": GOOD.format(name="Good")})
    loaded, problems = plugins.loadable("methods")
    assert loaded["zz-good"].__name__ == "Good"
    assert "zz-bad" not in loaded
    (task,) = (line for line in problems if "zz-bad" in line)
    assert task.startswith("method 'zz-bad' of acme 1.2 (zz_bad:One): ")
    assert cause in task
    assert "\n" not in task
    with pytest.raises(plugins.PluginError, match=r"of acme 1\.2"):
        plugins.build("methods", Choice("zz-bad"))


def test_a_class_has_its_name_beside_a_plugin_that_does_not_load(site):
    source = GOOD.format(name="Good") + "\n\ndef function(): pass\n"
    site("acme", methods(zz_a="zz_acme:function", zz_b="zz_acme:Good"), {"zz_acme.py": source})
    assert plugins.name_of("methods", plugins.find("methods", "zz-b").load()) == "zz-b"
    assert plugins.name_of("methods", int) is None


def test_annotations_that_name_nothing_are_the_plugins_fault(site):
    source = GOOD.format(name="One").replace("ginf: float", "ginf: 'Flaot'")
    site("acme", methods(zz_one="zz_acme:One"), {"zz_acme.py": source})
    with pytest.raises(plugins.PluginError, match=r"of acme 1\.2 .* 'Flaot' is not defined"):
        plugins.check("methods", Choice("zz-one"))


def test_a_name_of_two_distributions_is_a_warning_that_names_both(site):
    site("zebra", methods(zz_one="zz_a:One"), {"zz_a.py": GOOD.format(name="One")}, folder="a")
    site("acme", methods(zz_one="zz_b:One"), {"zz_b.py": GOOD.format(name="One")}, folder="b")
    with pytest.warns(plugins.PluginWarning, match="'zz-one' of zebra 1.2 is ignored.*'zz-one' of acme 1.2"):
        found = plugins.available("methods")
    assert found["zz-one"].distribution == "acme"
    site("stlbench-rl", methods(zz_one="zz_c:One"), folder="c")  # whose names nobody takes over
    with pytest.warns(plugins.PluginWarning, match="of acme 1.2 is ignored"):
        assert plugins.available("methods")["zz-one"].distribution == "stlbench-rl"


def test_the_same_distribution_twice_on_the_path_is_no_conflict(site):
    site("acme", methods(zz_one="zz_a:Far"), folder="a")
    site("acme", methods(zz_one="zz_a:Near"), folder="b")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert plugins.available("methods")["zz-one"].entry_point.attr == "Near"


@pytest.mark.parametrize("name", ["../../etc/x", "Upper", "under_score", "-x", "a b", "x[y"])
def test_a_name_that_could_not_be_a_path_is_ignored_with_a_warning(site, name):
    site("acme", f"[stlbench.methods]\n{name} = zz_a:One\n")
    with pytest.warns(plugins.PluginWarning, match="of acme 1.2 is ignored: a plugin's name consists of"):
        assert name not in plugins.available("methods")


@pytest.mark.parametrize(
    "broken", [{"metadata": False, "entries": methods(zz_bad="zz:Bad")}, {"entries": "[stlbench.methods]\njunk\n"}]
)
def test_a_distribution_with_broken_files_leaves_the_others_alone(site, broken):
    site("acme", **broken)
    site("zebra", methods(zz_good="zz_good:Good"))
    with pytest.warns(plugins.PluginWarning, match="cannot be read"):
        found = plugins.available("methods")
    assert "zz-good" in found
    assert "zz-bad" not in found


def test_an_unknown_name_gets_did_you_mean(site):
    site("acme", methods(zz_funnel="zz_a:One"))
    with pytest.raises(UsageError, match="no method 'zz-funel'; did you mean 'zz-funnel'"):
        plugins.find("methods", "zz-funel")
