"""Which cells run, and how far they are."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stlbench.records.identity import CellId
from stlbench.study import live_cells as room
from stlbench.study.live_cells import FOLDER, announce, clear, ended, running

CELL = CellId.parse("hold-disc/funnel/dqn/0", "quick")


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time; set the only entry."""
    seconds = [1000.0]
    monkeypatch.setattr(room.time, "time", lambda: seconds[0])
    return seconds


def test_a_cell_is_among_those_that_run_while_it_does_with_its_curve_so_far(tmp_path: Path, clock: list[float]) -> None:
    notice = announce(tmp_path, CELL, 4000)
    (found,) = running(tmp_path)
    assert (found.id, found.steps, found.share, found.began) == (CELL, 0, 0.0, 1000.0)
    for steps, mean in ((1000, -0.25), (2000, 0.5)):
        clock[0] += 60.0
        notice.at(steps, lambda mean=mean: (0.5, mean))
    (found,) = running(tmp_path)
    assert (found.share, found.told, found.satisfaction, found.robustness) == (0.5, 1120.0, 0.5, 0.5)
    assert found.curve == ((1000, 0.5, -0.25), (2000, 0.5, 0.5))
    ended(tmp_path, CELL)
    assert running(tmp_path) == []


def test_of_cells_whose_names_begin_alike_one_ends(tmp_path: Path) -> None:
    cells = [CELL, CellId.parse("hold-disc/funnel/dqn/0/tuned", "quick"), CellId.parse(CELL.name, "smoke")]
    for cell in cells:
        announce(tmp_path, cell, 4000)
    ended(tmp_path, CELL)
    assert {one.id for one in running(tmp_path)} == {*cells[1:]}


def test_scores_that_only_a_watcher_needs_take_a_fiftieth_of_the_time(tmp_path: Path, clock: list[float]) -> None:
    asked = list[int]()

    def glance() -> tuple[float, float]:
        asked.append(1)
        clock[0] += 10.0
        return 1.0, 1.0

    notice = announce(tmp_path, CELL, 100_000)
    for step in range(1, 1001):
        clock[0] += 1.0
        notice.at(100 * step, glance)
    assert sum(asked) * 10.0 <= 0.02 * (clock[0] - 1000.0) + 10.0
    assert len(asked) >= 2


def test_a_score_that_raises_is_none(tmp_path: Path, clock: list[float]) -> None:
    notice = announce(tmp_path, CELL, 4000)
    clock[0] = 1001.0
    notice.at(1000, lambda: (1 // 0, 0.0))
    assert running(tmp_path)[0].robustness is None
    assert running(tmp_path)[0].steps == 1000


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "{", '{"name": 3}', json.dumps({"name": "no cell", "budget": "quick"})),
        *('"curve": "x"', '"curve": [[1]]', '"curve": [[1, "a", 2]]', '"curve": 3'),
    ],
)
def test_files_that_say_nothing_are_passed_over(tmp_path: Path, text: str) -> None:
    announce(tmp_path, CELL, 4000)
    (path,) = (tmp_path / FOLDER).iterdir()
    whole = json.loads(path.read_text())
    path.write_text(json.dumps(whole | json.loads(f"{{{text}}}")) if text.startswith('"curve"') else text)
    assert running(tmp_path) == []
    clear(tmp_path)
    assert not (tmp_path / FOLDER).exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"of": 10**400},
        {"steps": -1},
        {"steps": "many"},
        {"began": float("nan")},
        {"satisfaction": "all"},
        {"robustness": []},
        {"curve": [[1, 2, 3]]},
        {"budget": "\x1b[31m"},
        {"name": "a/b/c/0\n"},
        {"name": "x"},
    ],
)
def test_what_no_cell_says_is_passed_over(tmp_path: Path, changes: dict[str, object]) -> None:
    announce(tmp_path, CELL, 100)
    (path,) = (tmp_path / FOLDER).iterdir()
    said = json.loads(path.read_text())
    path.with_name("other.json").write_text(json.dumps(said | changes))
    assert [one.name for one in running(tmp_path)] == [CELL.name]


def test_without_a_folder_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    announce(None, CELL, 4000).at(1000, lambda: pytest.fail("scored for nobody"))
    assert not any(tmp_path.iterdir())
