"""Conformance checks: what the contract asks of each kind of plugin, for a plugin author's own tests.

    from stlbench.testing import check_method

    def test_it_keeps_the_contract() -> None:
        check_method(MyMethod)  # or by name, with parameters: check_method("my-method[beta=2]")

A check runs the plugin and returns nothing. The first rule that is broken is an `AssertionError` that names the rule
and what there was instead. That a reward is the right one is not checked: compute some by hand. `stlbench check NAME`
does the same and lists the rules.
"""

from stlbench.testing.agents import check_agent
from stlbench.testing.methods import check_method
from stlbench.testing.rules import RuleBroken, Rules
from stlbench.testing.run import check_executor, check_log
from stlbench.testing.tasks import check_suite, check_task

__all__ = [
    "RuleBroken",
    "Rules",
    "check_agent",
    "check_executor",
    "check_log",
    "check_method",
    "check_suite",
    "check_task",
]
