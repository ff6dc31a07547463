"""Cards of policies and data sets, under the headings of Hugging Face's hub, filled from what is recorded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from string import Template
from typing import Literal

from stlbench.errors import UsageError
from stlbench.records.outputs import cell_files
from stlbench.records.result import Result, reported
from stlbench.study.plugin_guard import load_guarded

CARD = "README.md"
"""The file name under which the hub finds a card."""
_VERSIONS = ("python", "stlbench-rl", "numpy", "numba")


def card(kind: Literal["model", "data"], words: Mapping[str, object]) -> str:
    """The text of a card. Raises `KeyError` where a word of the template is missing."""
    template = (Path(__file__).parent / f"{kind}.md").read_text(encoding="utf-8")
    return Template(template).substitute(words)


def model_card(result: Result) -> str:
    """Of the selected policy of a cell. Raises `UsageError` if it has none."""
    measured, facts = result.measurement, result.provenance
    if measured is None or measured.policies is None:
        raise UsageError(f"{result.id.name} has no stored policy")
    score, cell, policies = reported(measured.selected), result.id, measured.policies
    words = {
        "cell": cell.name,
        **cell.plain,
        "key": result.key,
        "digest": policies.selected,
        "file": cell_files(Path(), cell, result.key).policies,
        "observation": policies.observation or f"{policies.observation_size} numbers",
        "steps": f"{measured.env_steps:,}",
        "seconds": f"{measured.training_cpu_seconds:.3g}",
        "machine": facts.get("machine", "an unknown machine"),
        "versions": ", ".join(f"{name} {facts[name]}" for name in _VERSIONS if name in facts),
        "formula": _formula(result),
        "robustness": f"{score.mean:.4g}",
        "satisfied": f"{100 * score.satisfaction:.4g}",
        "starts": score.starts or "the",
    }
    return card("model", words)


def _formula(result: Result) -> str:
    try:
        return f"`{load_guarded(result.id.task).formula}` (intervals in steps)"
    except UsageError:
        return "unknown here, as the task is not installed"
