"""What trainings on drawn formulas say of a method."""

from __future__ import annotations

from stlbench.report.evidence import Trained, alike, rated

STAY, AVOID, PATROL = frozenset({"stay"}), frozenset({"stay", "invariant"}), frozenset({"again and again", "choice"})


def several(traits: frozenset[str], count: int, **scores: float) -> list[Trained]:
    """Formulas on which each method has one seed, a little better on each."""
    return [Trained(traits, {name: [score + place / 1000] for name, score in scores.items()}) for place in range(count)]


def test_the_best_first_and_how_far_the_others_are_behind() -> None:
    found = several(STAY, 10, raw=0.9, funnel=0.5) + several(STAY, 10, flag=0.89)
    first, *others = rated(found, ["flag", "funnel", "raw"])
    assert (first.method, first.tasks, first.behind) == ("raw", 10, None)
    by_name = {each.method: each for each in others}
    assert by_name["funnel"].is_told_apart
    assert by_name["flag"].behind is None, "no formula has both"
    assert not by_name["flag"].is_told_apart


def test_noise_tells_nothing_apart() -> None:
    noisy = [Trained(STAY, {"raw": [0.5 + 0.4 * (-1) ** place], "funnel": [0.5]}) for place in range(9)]
    assert not any(each.is_told_apart for each in rated(noisy, ["raw", "funnel"]))


def test_formulas_of_the_same_form() -> None:
    """The same traits, as soon as there are enough; else one trait may differ."""
    trained = several(STAY, 7, raw=0.5) + several(AVOID, 3, raw=0.5) + several(PATROL, 9, raw=0.5)
    assert len(alike(STAY, trained, ["raw"])) == 10
    assert len(alike(PATROL, trained, ["raw"])) == 9
    assert len(alike(STAY, [*trained, *several(STAY, 1, raw=0.5)], ["raw"])) == 8
    assert alike(STAY, trained, ["flag"]) == []


def test_too_few_formulas_say_nothing() -> None:
    assert rated(several(STAY, 7, raw=0.9), ["raw"]) == []
