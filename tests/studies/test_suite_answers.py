"""What trainings on the suite answer."""

from __future__ import annotations

from types import ModuleType

import numpy as np
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
    same = {template: dict.fromkeys(answers.SHOWN, value) for template, value in level.items()}
    by_template = [task(answers, f"{system}/{template}/1", **same[template]) for system, template in pairs]
    assert answers._shares(by_template)["template"] == pytest.approx(1)
    none = dict.fromkeys(answers.SHOWN, 0.0)
    by_pair = [task(answers, f"{one}/{form}/1", **none | {"raw": float(one == "arm")}) for one, form in pairs]
    shares, methods = answers._shares(by_pair), len(answers.SHOWN)
    by_hand = {"system": 1, "method": methods - 1, "method and system": methods - 1}  # of 2 m - 1 parts
    assert {source: shares[source] * (2 * methods - 1) for source in by_hand} == pytest.approx(by_hand)


def test_seeds_that_scatter_explain_nothing_but_themselves(answers: ModuleType) -> None:
    """Means of two seeds scatter by half of the variance of seeds, which would count for `method and task`."""
    generator = np.random.default_rng(0)
    names = [f"{one}/{form}/{n}" for one in ("arm", "pair") for form in ("reach", "patrol", "tube") for n in range(10)]
    scores = [{method: tuple(generator.normal(size=2)) for method in answers.SHOWN} for _ in names]
    formula = stl.parse("F[0,9] x >= 1")
    tasks = [answers.Drawn(name, formula, own) for name, own in zip(names, scores, strict=True)]
    shares = answers._shares(tasks)
    assert shares["seed"] > 0.9
    assert shares["method and task"] < 0.06
    assert min(shares.values()) >= 0
    alike = [answers.Drawn(task.name, task.formula, dict.fromkeys(task.scores, (0.2, 0.4))) for task in tasks]
    assert answers._shares(alike)["seed"] == pytest.approx(1)


def test_a_way_to_choose_is_judged_by_seeds_and_templates_that_it_has_not_seen(
    answers: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lucky seed does not count for the method that was chosen by it."""
    formula, one = stl.parse("F[0,9] x >= 1"), {"steady": (0.5, 0.5), "lucky": (1.0, 0.0)}
    tasks = [answers.Drawn(f"arm/{form}/{number}", formula, one) for form in ("reach", "tube") for number in range(8)]
    monkeypatch.setattr(answers, "drawn", lambda: tuple(tasks))
    first, second = answers._chosen(0, 1), answers._chosen(1, 0)
    assert {way: (first[way][0], second[way][0]) for way in first} == {
        "always the best of all forms": (0.0, 0.5),
        answers._ADVISE: (0.0, 0.5),
        answers._BEST: (0.0, 0.5),
        "any method": (0.25, 0.75),
    }
    assert answers.held_out().splitlines()[-1] == "`advise` answers for 100 % of the tasks."
