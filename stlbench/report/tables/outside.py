"""What stlbench did not train and scored (`stlbench score`): it stands beside what was trained, never among it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from stlbench.report.tables.rows import Group

MARK = "o"
"""In the column `mark` of tables."""


def outside(groups: Iterable[Group]) -> tuple[Group, ...]:
    """The groups of policies that were trained elsewhere, or by nobody."""
    return tuple(group for group in groups if group.outside)


def trained(groups: Iterable[Group]) -> tuple[Group, ...]:
    """All others."""
    return tuple(group for group in groups if not group.outside)


def outside_notes(groups: Sequence[Group]) -> tuple[str, ...]:
    """What the mark means, and a line for each policy: where it comes from."""
    if not groups:
        return ()
    rule = "not trained by stlbench: its budget is unknown. It is in no comparison and in no statistic."
    return (f"Marked {MARK}: {rule}", *(_origin(group) for group in groups))


def _origin(group: Group) -> str:
    sources = []
    for row in group.rows:
        facts = row.provenance
        starts = ", from starts of its own" if facts.get("begun_at") == "starts of its own" else ""
        sources.append(f"{facts.get('source', 'unknown')} (sha256 {facts.get('sha256', 'unknown')[:12]}){starts}")
    return f"{group.setting.agent} on {group.setting.task}: {'; '.join(dict.fromkeys(sources))}."
