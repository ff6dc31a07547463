"""Trainings after a race, by a made-up clock."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from helpers.played import Played
from solver.conftest import FORMULA

from stlbench.errors import UsageError
from stlbench.records.result import Result
from stlbench.records.result_files import TRAININGS, cell_files
from stlbench.solver.contestants import Contestant
from stlbench.solver.earlier import EarlierPolicy
from stlbench.solver.outlook import Outlook
from stlbench.solver.problem import Problem
from stlbench.solver.race import Race
from stlbench.solver.trainer import Clock
from stlbench.solver.workspace import workspace_of


def gone_on(
    monkeypatch: pytest.MonkeyPatch,
    satisfied: dict[int, int],
    lost: int = 0,
    shares: dict[tuple[str, int], float] | None = None,
) -> tuple[Played, list[int]]:
    """Ten minutes from a policy of seed 200 on, where each seed satisfies from so many of 100 further starts."""
    played = Played(monkeypatch, shares or {})
    monkeypatch.setattr(
        "stlbench.solver.race.outlook",
        lambda folder, result, starts: Outlook(100, satisfied.get(result.id.seed, 50), lost),
    )
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(10.0)
    first = played(budget="final", methods=["raw"], agents=["dqn"], seeds=[200], until=bool, init=None)
    trainer = Race(workspace, Clock(10.0, 0.0), lambda text: None, False, jobs=1)
    improved = trainer.improve(first)
    assert workspace.state["chosen"] == improved[0].key
    assert [each.id.seed for each in improved if each.key == improved[0].key] == [improved[0].id.seed]
    return played, [each.id.seed for each in improved]


def test_a_policy_that_satisfies_from_all_further_starts_is_not_trained_on(monkeypatch: pytest.MonkeyPatch) -> None:
    played, seeds = gone_on(monkeypatch, {200: 100})
    assert (len(played.cells), seeds) == (1, [200])
    played, seeds = gone_on(monkeypatch, {200: 75}, lost=25)  # from 25 nothing can satisfy
    assert (len(played.cells), seeds) == (1, [200])


def test_a_certificate_that_can_rise_is_trained_for_from_the_best_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    played, seeds = gone_on(monkeypatch, {200: 90, 202: 95, 204: 100})
    assert seeds[0] == 204
    assert [cell[::3] for cell in played.cells[1:]] == [("more-1", 202), ("more-2", 204)]
    assert [played.begun(init) for init in played.inits[1:]] == ["raw/200", "raw/202"]


def test_where_the_best_policy_leads_no_further_fresh_networks_are_trained(monkeypatch: pytest.MonkeyPatch) -> None:
    played, seeds = gone_on(monkeypatch, {200: 90, 202: 80, 204: 85, 206: 92})
    assert seeds[0] == 206
    assert [init is None for init in played.inits[1:4]] == [False, True, False]
    assert played.now - 60 < 510  # when the last one began; the rest is for the delivery


def test_fresh_networks_are_trained_only_if_they_have_more_time_than_the_best_policy_had(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, value in {"wall": 400.0, "trained": 399.0, "most": 60_000}.items():
        monkeypatch.setattr(Played, name, value)
    played, seeds = gone_on(monkeypatch, {200: 90, 202: 80, 204: 85, 206: 92})
    assert seeds[0] == 206
    assert [init is None for init in played.inits[1:4]] == [False, False, False]


def test_further_starts_and_those_for_selection_tell_together_which_policy_is_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    satisfied = {200: 90, 202: 89, **dict.fromkeys(range(204, 230), 50)}
    assert gone_on(monkeypatch, satisfied)[1][0] == 200
    shutil.rmtree("out")
    assert gone_on(monkeypatch, satisfied, shares={("raw", 202): 0.5})[1][0] == 202  # 0.4 of 64 starts, and 0.5


def test_what_the_next_training_begins_with_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    played, begun = Played(monkeypatch, {}), list[str]()
    monkeypatch.setattr("stlbench.solver.race.outlook", lambda folder, result, starts: Outlook(100, 90, 0))
    first = played(budget="final", methods=["raw"], agents=["dqn"], seeds=[200], until=bool, init=None)
    for start, place in ((None, "none"), (EarlierPolicy(Path("p.npz"), "", Contestant("raw", "dqn"), None), "some")):
        workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path(place))
        workspace.begin(10.0)
        played.now, said = 60.0, list[str]()
        Race(workspace, Clock(10.0, 0.0), said.append, False, jobs=1, start=start).improve(first)
        begun += [text.partition(":")[0].removeprefix("training on, from ") for text in said[:2]]
    assert begun == ["the best policy", "fresh networks", "the best policy", "the earlier solution"]


def test_no_further_starts_are_tried_in_the_time_of_the_delivery(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {})
    monkeypatch.setattr("stlbench.solver.race.outlook", lambda *given: pytest.fail("it looked"))
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(10.0)
    first = played(budget="final", methods=["raw"], agents=["dqn"], seeds=[200], until=bool, init=None)
    played.now = 515.0
    assert Race(workspace, Clock(10.0, 0.0), lambda text: None, False, jobs=1).improve(first) == first


def kept(result: Result, folder: Path = Path("out/race")) -> None:
    """Write a file from which a training goes on with that of a result."""
    path = cell_files(folder, result.id, result.key).training
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"")


class Keeping(Played):
    """Each training of the race can be gone on with."""

    def _result(self, *cell: Any) -> Result:
        result = super()._result(*cell)
        kept(result)
        return result


def test_each_training_of_a_race_goes_on_with_the_one_before_of_its_contestant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    played = Keeping(monkeypatch, {(method, 100): 0.45 for method in ("funnel", "tltl")})
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(60.0)
    race = Race(workspace, Clock(60.0), lambda text: None, False, jobs=1)
    winner = race.race()
    files = [init for init in played.inits if isinstance(init, dict)]
    begun = [{method: path.name for method, path in each.items()} for each in files]
    rungs = [cell for cell in played.cells if cell[0].startswith("rung")]
    first, second = (sorted({cell[1] for cell in rungs if cell[0] == f"rung-{rung}"}) for rung in (1, 2))
    assert len(second) < len(first)
    assert begun[-2] == {"funnel": "task_funnel_dqn_100_auto_funnel-100.npz"}  # that of the probe
    assert begun[-1] == {method: f"task_{method}_dqn_101_auto_{method}-101.npz" for method in second}
    assert race.final(winner) == []  # `improve` goes on with it


def test_fresh_seeds_need_more_time_than_all_trainings_that_the_winner_went_on_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    played = Keeping(monkeypatch, {})
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    race = Race(workspace, Clock(10.0), lambda text: None, False, jobs=1)
    who, results = [Contestant("raw", "dqn")], list[Result]()
    for seed in (100, 101, 102):
        results = race.train("probe", who, [seed], lambda result: False, after=results)
    assert race._lasted(results[0]) == 3 * played.wall
    assert played.begun(played.inits[-1]) == "raw/101"


def test_what_was_chosen_in_the_same_time_before_is_not_raced_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(10.0)
    race = Race(workspace, Clock(10.0), lambda text: None, False)
    known = [cast(Result, SimpleNamespace(key=key)) for key in "abc"]
    monkeypatch.setattr(Race, "kept", lambda self: known)
    assert race.chosen() is None
    workspace.remember(chosen="b")
    assert [result.key for result in race.chosen() or ()] == ["b", "a", "c"]
    workspace.begin(20.0)
    assert race.chosen() is None


def test_files_of_trainings_are_removed_but_through_no_link(tmp_path: Path) -> None:
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    for name in ("race", "final"):
        (workspace.folder / name / TRAININGS).mkdir(parents=True)
        (workspace.folder / name / TRAININGS / "a.npz").write_bytes(b"")
    workspace.drop_trainings()
    assert not [*workspace.folder.glob("*/trainings")]
    (tmp_path / "elsewhere").mkdir()
    (workspace.folder / "race" / TRAININGS).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UsageError, match="is a link"):
        workspace.drop_trainings()
    assert (tmp_path / "elsewhere").is_dir()


def test_what_learned_nothing_is_not_gone_on_with(monkeypatch: pytest.MonkeyPatch) -> None:
    methods = ("funnel", "tltl", "raw", "causation")
    played = Keeping(monkeypatch, {(method, seed): 0.0 for method in methods for seed in range(300)})
    monkeypatch.setattr("stlbench.solver.race.outlook", lambda *given: Outlook(100, 0, 0))
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(30.0)
    race = Race(workspace, Clock(30.0), lambda text: None, False, jobs=1)
    winner = race.race()
    finals = race.final(winner)
    race.improve([*finals, winner])
    assert {cell[0] for cell in played.cells} >= {"rung-1", "rung-2", "final", "more-1"}
    assert not any(isinstance(init, dict) for init in played.inits)


def test_trainings_that_fail_end_the_solve(monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(monkeypatch, {})
    monkeypatch.setattr("stlbench.solver.race.outlook", lambda *given: Outlook(100, 90, 0))
    workspace = workspace_of(Problem("CartPole-v1", FORMULA), Path("out"))
    workspace.begin(10.0)
    first = played(budget="final", methods=["raw"], agents=["dqn"], seeds=[200], until=bool, init=None)
    failed = cast(Result, SimpleNamespace(id=first[0].id, measurement=None, key="failed"))
    monkeypatch.setattr("stlbench.solver.trainer.run_study", lambda **options: [failed])
    assert Race(workspace, Clock(10.0, 0.0), lambda text: None, False, jobs=1).improve(first) == first
