"""A bundle's policies are scored again, and what it claims beyond that is said."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from helpers import bundles

from stlbench.errors import UsageError
from stlbench.records.result import MAIN, Score
from stlbench.share.rescored import Rescored, read_bundles, rescore
from stlbench.simulation.faults import ask_here


def here(monkeypatch):
    """Score in this process, whose functions a test can exchange."""
    monkeypatch.setattr("stlbench.share.rescored.ask", lambda questions, _: ask_here(questions))


def main_score(change):
    """A result with another main score."""

    def changed(result):
        measured = result.measurement
        selected = dict(measured.selected) | {MAIN: change(measured.selected[MAIN])}
        return replace(result, measurement=replace(measured, selected=selected))

    return changed


def better(score):
    return replace(score, robustness=tuple(value + 0.5 for value in score.robustness))


def test_what_was_recorded_is_found_again(bundle) -> None:
    (found,) = rescore(bundle)
    assert (found.cell.name, found.verdict) == ("zz-line/raw/zz-kept/0", "as recorded")
    assert found.found == found.recorded


def test_a_report_of_bundles_has_the_scores_that_are_found_and_not_the_claimed(bundle, tmp_path, monkeypatch) -> None:
    here(monkeypatch)
    claim, said = bundles.claiming(bundle, tmp_path / "claim.zip", main_score(better)), list[tuple[str, str]]()
    (claimed,) = read_bundles([claim], False, print)
    (again,) = read_bundles([claim], True, lambda *told: said.append(told))
    assert said == [("zz-line/raw/zz-kept/0", "claims more")]
    assert (claimed.is_fine, again.is_fine) == (True, False)
    assert str(again.results[0].id.method) == "raw[bundle=claim]"
    means = [each.results[0].measurement.selected[MAIN].mean for each in (claimed, again)]
    assert means[0] == pytest.approx(means[1] + 0.5)


@pytest.mark.parametrize(
    ("place", "error", "why"),
    [
        ("study.policies.own_task", UsageError("there is no task 'zz-line'"), "there is no task 'zz-line'"),
        ("share.rescored.score_again", IndexError("no such layer"), "IndexError: no such layer"),
    ],
)
def test_why_a_policy_cannot_be_scored_is_said(bundle, monkeypatch, place, error, why) -> None:
    def fails(*_):
        raise error

    here(monkeypatch)
    monkeypatch.setattr(f"stlbench.{place}", fails)
    (found,) = rescore(bundle)
    assert (found.found, found.verdict, found.why) == (None, "not scored", why)


@pytest.mark.parametrize(
    ("mean", "satisfied", "verdict"),
    [(1.0, 10, "as recorded"), (0.995, 10, "within rounding"), (0.98, 10, "claims more"), (1.0, 9, "claims more")],
)
def test_how_much_is_rounding(mean, satisfied, verdict) -> None:
    """Of a recorded robustness of 1 from 10 starts, which all satisfy."""

    def scored(value, count):
        return {MAIN: Score((value,) * 10, tuple(number < count for number in range(10)), {})}

    assert Rescored(None, scored(1.0, 10), scored(mean, satisfied)).verdict == verdict


def test_every_protocol_counts() -> None:
    one = Score((1.0,), (True,), {})
    assert Rescored(None, {MAIN: one, "random": one}, {MAIN: one}).verdict == "claims more"
    worse = {MAIN: one, "random": Score((0.5,), (True,), {})}
    assert Rescored(None, {MAIN: one, "random": one}, worse).verdict == "claims more"


@pytest.mark.filterwarnings("ignore:invalid value")  # the mean of both infinities
@pytest.mark.parametrize("other", [0.2, -math.inf])
def test_an_infinite_robustness_is_claimed_in_vain(other) -> None:
    claimed, found = Score((math.inf, other), (True, True), {}), Score((0.3, 0.2), (True, True), {})
    assert Rescored(None, {MAIN: claimed}, {MAIN: found}).verdict == "claims more"
    assert Rescored(None, {MAIN: claimed}, {MAIN: claimed}).verdict == "as recorded"
