"""What a bundle has to be to stand on the leaderboard, as far as that can be seen in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from stlbench.records.identity import OUTSIDE, Setting
from stlbench.records.result import Result
from stlbench.share.crate import About

FIRST_SEED = 10
"""The reference has seeds 0 to 9; a submission those from here on, without a gap, so that nobody picks."""
LEAST_SEEDS = 5
NOT_REPORTED = "smoke"
"""The budget that is for tests."""


def broken(about: About, results: Iterable[Result]) -> Iterator[str]:
    """Each rule that a bundle breaks, in a line."""
    by_setting = dict[Setting, list[Result]]()
    for result in results:
        by_setting.setdefault(result.id.setting, []).append(result)
    if not any(name.strip() for name in about.authors):
        yield "it names nobody: pack it with `stlbench bundle --author NAME`"
    if not by_setting:
        yield "it has no cell"
    for setting, members in sorted(by_setting.items()):
        for problem in _of_setting(setting, members):
            yield f"{setting.name}: {problem}"


def _of_setting(setting: Setting, members: list[Result]) -> Iterator[str]:
    seeds = sorted(result.id.seed for result in members)
    if setting.track == OUTSIDE:
        yield "stlbench did not train it, so that nobody knows its budget"
        return
    if setting.budget == NOT_REPORTED:
        yield f"the budget {NOT_REPORTED} is for tests"
    if seeds != list(range(FIRST_SEED, FIRST_SEED + len(seeds))) or len(seeds) < LEAST_SEEDS:
        asked = f"{FIRST_SEED}, {FIRST_SEED + 1}, ... without a gap, at least {LEAST_SEEDS}"
        yield f"its seeds are {', '.join(map(str, seeds[:12]))}; asked are {asked}, with those that failed"
    without = [result.id.seed for result in members if result.measurement and result.measurement.policies is None]
    if without:
        yield f"no policy of seed {', '.join(map(str, sorted(without)))} is stored, so that nobody can score it"
