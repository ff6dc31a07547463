"""Search over seeds, on an environment of Gymnasium that ends early: CartPole, pushed to one side all the time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.line_task import Rule
from helpers.made_subjects import still

from stlbench.contract import Array, Integers, RewardMethod
from stlbench.errors import UsageError
from stlbench.records.array_files import read_saved
from stlbench.report.figures.margins import place_of
from stlbench.search.actor import Actor, Seeds, of_policy, space_of
from stlbench.search.certify import Claim, certify
from stlbench.search.falsify import How, falsify
from stlbench.search.outputs import write
from stlbench.task import load_task

STEPS = 30


class Unpaid(RewardMethod):
    def arrival(self, signals: Array, t: Integers) -> Array:
        return np.zeros(t.shape)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Actor:
    """One direction for ever: the pole falls within some ten steps."""
    return actor(tmp_path_factory.mktemp("tasks"), f"G[0,{STEPS}] abs(x) <= 2.5", "violated")


def actor(folder: Path, formula: str, terminated: str, name: str = "pole") -> Actor:
    place = folder / f"{name}-{terminated}"
    place.mkdir()
    content = {
        "title": "A pole",
        "source": "made up",
        "formula": formula,
        "sampling_time": 0.02,
        "steps": STEPS,
        "environment": {"id": "CartPole-v1", "names": ["x", "v", "theta", "omega"], "scale": {"v": 3, "omega": 3}},
        "terminated": terminated,
        "signals": {"theta": {"low": -0.5, "high": 0.5, "unit": "rad"}, "x": {"low": -3, "high": 3}},
        "starts": 4,
        "agents": {"dqn": {}},
        "budgets": {"smoke": {"steps": 100}},
    }
    (place / "task.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    task = load_task(str(place))
    return of_policy("pushed", ("pushed",), task, Unpaid(task.specification), Rule(lambda observation: 1))


def test_a_counterexample_is_a_seed_that_plays_the_same_again(pushed: Actor) -> None:
    found = falsify(pushed, How(evaluations=40))
    assert (found.how.optimiser, found.found, found.first) == ("random", True, 1)
    assert found.start_text(4) == f"seed = {int(found.start['seed'])}"
    again = pushed.record(np.array([[found.start["seed"]]]))
    assert np.array_equal(again.traces[0], found.worst.trace, equal_nan=True)


def test_an_early_end_is_what_failed(pushed: Actor, tmp_path: Path) -> None:
    found = falsify(pushed, How(evaluations=5))
    assert found.witness is None
    assert 5 < found.steps < STEPS
    assert found.failed == f"ended early, at step {found.steps}"
    paths = write(found, tmp_path)
    assert all(path.stat().st_size for path in paths)
    assert read_saved(paths[0]).samples.shape == (1, STEPS + 1, 2)


def test_an_open_verdict_is_no_counterexample(tmp_path: Path) -> None:
    """The pole falls far inside of |x| <= 2.5, which the rest of the episode could keep or not."""
    cut = actor(tmp_path, f"G[0,{STEPS}] abs(x) <= 2.5", "interval", "open-pole")
    found = falsify(cut, How(evaluations=5))
    assert (found.worst.verdict, found.found, found.open, found.first) == ("open", False, True, 1)
    assert found.worst.robustness < 0
    assert found.failed == f"ended early, at step {found.steps}, verdict open"
    assert all(path.name.startswith("open-") for path in write(found, tmp_path))
    certified = certify(cut, Claim(starts=10))
    assert (certified.satisfied, certified.open, certified.violated) == (0, 10, 0)


def test_an_end_that_decides_is_a_counterexample_under_interval_too(tmp_path: Path) -> None:
    formula = f"G[0,{STEPS}] abs(theta) <= 0.05"
    found = falsify(actor(tmp_path, formula, "interval", "leaning"), How(evaluations=5))
    assert (found.worst.verdict, found.found, found.open) == ("violated", True, False)
    assert found.failed.startswith(f"{formula}, lost at step ")


def test_what_was_lost_before_an_early_end_is_what_failed(tmp_path: Path) -> None:
    """The pole falls through 0.05 rad long before it ends the episode at 0.21."""
    formula = f"G[0,{STEPS}] abs(theta) <= 0.05"
    found = falsify(actor(tmp_path, formula, "violated", "leaning-pole"), How(evaluations=5))
    first = int(np.argmax(np.abs(found.worst.trace[:, 0]) > 0.05))
    assert found.witness is None
    assert 0 < first < found.steps
    assert found.failed == f"{formula}, lost at step {first}"
    place = place_of(found.actor.task, found.worst.trace[: found.steps + 1], None)
    assert (place.step, place.explanation.partition(" (")[0]) == (first, f"{formula}: lost at step {first}")


def test_where_the_last_sample_stays_there_is_a_witness(tmp_path: Path) -> None:
    found = falsify(actor(tmp_path, f"G[0,{STEPS}] abs(theta) <= 0.2", "hold"), How(evaluations=5))
    assert found.witness is not None
    assert (str(found.witness.predicate), found.steps) == ("abs(theta) <= 0.2", STEPS)


def test_no_optimiser_searches_seeds(pushed: Actor) -> None:
    rule = r"direct cannot search task pole-violated: its starts are seeds, .* --optimiser random"
    with pytest.raises(UsageError, match=rule):
        falsify(pushed, How("direct"))


def test_a_certificate_over_seeds(pushed: Actor) -> None:
    found = certify(pushed, Claim(at_least=0.5))
    assert (found.verdict, found.satisfied, found.starts) == ("refuted", 0, 64)


def test_the_seeds_are_new(pushed: Actor) -> None:
    space = space_of(pushed.task)
    assert isinstance(space, Seeds)
    assert not space.single
    generator = np.random.default_rng(0)
    drawn = {seed for _ in range(5) for seed in space.draw(generator, 50)[:, 0].tolist()}
    assert len(drawn) == 250
    sets = pushed.task.starts
    others = [*sets.report_and_selection(), sets.at_random(500), sets.of_training(generator, 500)]
    assert not drawn & set(np.concatenate(others)[:, 0].tolist())


def test_of_a_system_many_more_are_simulated_at_a_time(pushed: Actor) -> None:
    assert pushed.rows < still().rows
