"""What trainings on the suite answer."""

from __future__ import annotations

from types import ModuleType

import pytest
from helpers.studies import load

from stlbench import stl


@pytest.fixture
def answers() -> ModuleType:
    return load("suite_answers")


def task(answers: ModuleType, name: str, **scores: float):
    return answers.Drawn(name, stl.parse("F[0,9] x >= 1"), {method: (score,) for method, score in scores.items()})


def test_advise_reads_what_the_committed_studies_say(answers: ModuleType) -> None:
    assert answers.SCORES.read_text(encoding="utf-8") == answers.scores()


def test_the_sources_of_differences(answers: ModuleType) -> None:
    """Scores that depend on one source alone are explained by it alone."""
    pairs = [(system, template) for system in ("arm", "pair") for template in ("reach", "patrol", "tube")]
    own = {method: place / 10 for place, method in enumerate(answers.SHOWN)}
    by_method = [task(answers, f"{system}/{template}/1", **own) for system, template in pairs]
    shares = answers._shares(by_method)
    assert sum(shares.values()) == pytest.approx(1)
    assert shares["method"] == pytest.approx(1)
    level = {"reach": 0.9, "patrol": 0.4, "tube": 0.1}
    by_template = [
        task(answers, f"{system}/{template}/1", **dict.fromkeys(answers.SHOWN, level[template]))
        for system, template in pairs
    ]
    assert answers._shares(by_template)["template"] == pytest.approx(1)
    by_pair = [
        task(answers, f"{system}/{template}/1", **dict.fromkeys(answers.SHOWN, 0.0) | {"raw": float(system == "arm")})
        for system, template in pairs
    ]
    shares, methods = answers._shares(by_pair), len(answers.SHOWN)
    by_hand = {"system": 1, "method": methods - 1, "method and system": methods - 1}  # of 2 m - 1 parts
    assert {source: shares[source] * (2 * methods - 1) for source in by_hand} == pytest.approx(by_hand)
