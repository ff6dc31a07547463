"""How long the rest of a run takes, by a simulated clock: cells that tasks make dear, places, stops before."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.simulated_runs import Idle, Seen, simulate
from helpers.synthetic_results import result

from stlbench.records.identity import CellId
from stlbench.study import pace
from stlbench.study.live_cells import Running
from stlbench.study.outlook import Took
from stlbench.study.pace import Ended, Pace, reward_of, unfit

SECONDS = {
    "short and long": {"integrator-or": 2.1, "hold-disc-coarse": 9.0, "annulus": 21.0},
    "far apart": {"hold-disc": 3.0, "overlap": 12.0, "robot-nav": 90.0},
    "one task": {"hold-disc": 25.0},
}
METHODS = {"flag": 1.0, "funnel": 1.15, "raw": 0.95}
STEPS = 40_000


def study(tasks: dict[str, float], seeds: int, number: int) -> list[tuple[CellId, float]]:
    """Seeds outermost, as plans have them; cells that differ in the seed alone differ by 15 %."""
    generator = np.random.default_rng(number)
    return [
        (CellId.parse(f"{task}/{method}/dqn/{seed}", "quick"), seconds * factor * generator.uniform(0.85, 1.15))
        for seed in range(seeds)
        for task, seconds in tasks.items()
        for method, factor in METHODS.items()
    ]


def paced(seen: Seen, allowed: int, earlier: list[Took] | None = None, zero: float = 1e9) -> Pace:
    """What the run and the one who watches it know, who do not know when it began."""
    ended = [Ended(took.cell, took.seconds, zero + at) for took, at in zip(seen.took, seen.recorded, strict=True)]
    running = [
        Running(
            one.cell.name, "quick", STEPS, zero + seen.now - one.seconds, round(STEPS * one.share),
            zero + seen.now - one.seconds + one.at,
        )
        for one in seen.begun
    ]  # fmt: skip
    missing = [*(one.cell for one in seen.begun), *seen.waiting]
    return Pace(zero + seen.now, missing, running, ended, allowed, earlier or [])


@pytest.fixture(autouse=True)
def steps(monkeypatch):
    """All tasks have as many steps, so that these tell nothing of how long cells take."""
    monkeypatch.setattr(pace, "_size", lambda cell: STEPS)


@pytest.mark.parametrize("tasks", SECONDS.values(), ids=SECONDS)
@pytest.mark.parametrize("jobs", [1, 2, 4])
@pytest.mark.parametrize("idle", [Idle(), Idle(14, 0.3, 0.2), Idle(30, 1.5, 0.4)], ids=["none", "some", "much"])
def test_after_a_quarter_of_the_run_it_is_right_within_a_fifth(tasks, jobs, idle):
    for number in range(10):
        seen = simulate(study(tasks, 10, number), jobs, 0.25, idle=idle)
        assert paced(seen, jobs).seconds == pytest.approx(seen.left, rel=0.2)


@pytest.mark.parametrize("tasks", SECONDS.values(), ids=SECONDS)
@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("slower", [0.5, 1.0, 3.0])
def test_a_run_that_goes_on_on_a_machine_that_is_busier_or_less(tasks, jobs, slower):
    """Four seeds of ten were done before; the one who watches knows of them, the run itself does not."""
    for number in range(10):
        cells = study(tasks, 10, number)
        before, rest = cells[: 4 * len(cells) // 10], cells[4 * len(cells) // 10 :]
        earlier = [Took(cell, seconds) for cell, seconds in before]
        run = [(cell, slower * seconds) for cell, seconds in rest]
        seen = simulate(run, jobs, 0.25, idle=Idle(14, 0.3, 0.2))
        assert paced(seen, jobs, earlier).seconds == pytest.approx(seen.left, rel=0.2)


def test_by_hand():
    """The first of two places was free for 2 seconds, the other for 4, and the rest waits 3 each time."""
    done = [CellId.parse(f"hold-disc/flag/dqn/{seed}", "quick") for seed in range(8)]
    ended = [Ended(done[0], 10.0, 110.0), Ended(done[1], 10.0, 110.0), Ended(done[2], 10.0, 122.0),
             Ended(done[3], 10.0, 124.0)]  # fmt: skip
    assert Pace(124.0, done[4:], [], ended, 2).between == 3.0
    assert Pace(124.0, done[4:], [], ended, 2).seconds == 26.0
    assert Pace(124.0, [], [], ended, 2).seconds is None
    assert Pace(124.0, [], [], ended, 2).words == ""
    assert Pace(124.0, done[4:], [], ended, 2).words == "about 26 s left"


def test_what_overlapped_says_how_many_run_at_a_time_and_no_more_than_are_allowed():
    cells = [CellId.parse(f"hold-disc/flag/dqn/{seed}", "quick") for seed in range(3)]
    ended = [Ended(cell, 10.0, 110.0 + number) for number, cell in enumerate(cells)]
    assert Pace(200.0, [], [], ended).jobs == 3
    assert Pace(200.0, [], [], ended, 2).jobs == 2
    assert Pace(200.0, [], [], ended, 256).jobs == 3
    assert Pace(200.0, [], [], []).jobs == 1


def test_methods_that_do_not_fit():
    results = [result("tau-mdp", status="intractable"), result("machine", status="unsuitable"), result("raw")]
    assert unfit(results) == {reward_of(each.id) for each in results[:2]}


def test_of_a_cell_that_takes_longer_than_all_before_it_nothing_is_said():
    """As of plans, which tell of no steps: a second method takes 100 s where the first took 25."""
    raw, funnel = (CellId.parse(f"overlap/{method}/planner/0", "quick") for method in ("raw", "funnel"))

    def at(now):
        return Pace(now, [funnel], [Running(funnel.name, "quick", STEPS, 1000, 0, 1000)], [Ended(raw, 25, 1000)], 1)

    assert at(1010).words == "about 15 s left"
    assert at(1025).words == at(1090).words == ""
