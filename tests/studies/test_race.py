"""The race of `solve` against peers: medians over seeds, where some gave up."""

from __future__ import annotations

from typing import Any

from helpers.studies import load

race: Any = load("race")


def line(cpu: float, reached: bool, whole: float = 0.0, best: float = 0.0) -> dict[str, Any]:
    return {"cpu": cpu, "reached": reached, "whole": whole, "best": str(best)}


def test_medians_over_seeds_count_who_gave_up_as_longer_than_all_others() -> None:
    seeds = {
        0: {"solve-3": line(10, True, 20), "PPO": line(50, True), "DQN": line(100, False, best=0.25)},
        1: {"solve-3": line(20, True, 40), "PPO": line(60, False, best=0.5), "DQN": line(200, False, best=0.75)},
        2: {"solve-3": line(30, True, 30), "PPO": line(90, True), "DQN": line(300, True)},
    }
    assert race.medians(seeds) == ("20", "30", {"PPO": "90", "DQN": "> 100 (25 %)"}, "5")
    # 5, > 3 and 3: what is greater than 3 may be greater than 5


def test_who_gave_up_takes_longer_than_all_others_also_with_its_certificate() -> None:
    seeds = {
        0: {"solve-3": line(100, True, 150)},
        1: {"solve-3": line(200, True, 900)},
        2: {"solve-3": line(500, False, 510)},
    }
    assert race.medians(seeds)[:2] == ("200", "900")


def test_a_later_line_of_solve_goes_on_from_the_one_before() -> None:
    seeds = {0: {"solve-3": line(170, False, 180), "solve-9": line(100, True, 200), "PPO": line(560, True)}}
    assert race.medians(seeds) == ("280", "380", {"PPO": "560"}, "2")


def test_nobody_learned() -> None:
    seeds = {0: {"solve-3": line(170, False, 180), "PPO": line(560, False)}}
    assert race.medians(seeds)[:3] == ("> 170", "", {"PPO": "> 560 (0 %)"})
