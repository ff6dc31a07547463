"""The rules of a suite: names that stay, splits of them, and tasks that keep the rules of a task."""

from __future__ import annotations

import re

from stlbench.registry import plugins, suites
from stlbench.testing.rules import Rules
from stlbench.testing.tasks import check_task

_NAME = re.compile(r"[a-z0-9][a-z0-9-]*(/[a-z0-9-]+)*")


def check_suite(suite: str, rules: Rules | None = None) -> None:
    """Check a suite, and the first task of each of its splits.

    The rules: names are parts of a-z, 0-9 and - with slashes between them, each of a task of its own; splits have these
    names; all tasks have the same kinds of groups; a name gives the same task twice; a task keeps the rules of
    `check_task`.

    Args:
        suite: the name of an installed suite.
        rules: takes those that are kept, for a caller that lists them.

    Raises:
        AssertionError: the rule that is broken.
        UsageError: no such suite, or a task file with errors.
    """
    rules, made = rules or Rules(), suites.made(plugins.find("suites", suite))
    wrong = [name for name in made.names if not _NAME.fullmatch(name)]
    rules.keep(not wrong, "names are parts of a-z, 0-9 and - with slashes between them", wrong[:1])
    joined = [name.replace("/", "-") for name in made.names]
    rules.keep(len(set(joined)) == len(joined), "no two names are alike with - in place of /", joined)
    unknown = [name for names in made.splits.values() for name in names if name not in made.names]
    rules.keep(not unknown, "splits have names of the suite", unknown[:1])
    kinds = {tuple(made.groups(name)) for name in made.names}
    rules.keep(len(kinds) <= 1, "all tasks have the same kinds of groups", kinds)
    for name in dict.fromkeys(names[0] for names in made.splits.values() if names):
        rules.keep(made.task(name) == made.task(name), "a name gives the same task twice", name)
        check_task(f"{suite}:{name}", rules)
