"""What a cell's process says is compared with what can be known without it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.synthetic_results import result

from stlbench.records.outputs import cell_files
from stlbench.records.result import MAIN, RANDOM, Measurement, Result, Score, Summary
from stlbench.records.saved_traces import save_samples
from stlbench.registry.choices import parse_choices
from stlbench.study import trial
from stlbench.study.cell import Cell
from stlbench.study.credibility import Examiner, contradiction
from stlbench.study.plan import plan_cells
from stlbench.study.results import Results
from stlbench.task import load_task


@pytest.fixture(scope="module")
def cell() -> Cell:
    (cell,) = plan_cells(parse_choices("hold-disc"), parse_choices("raw"), None, [0], "smoke")
    return cell


@pytest.fixture(scope="module")
def honest(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """A smoke cell, and its folder."""
    folder = tmp_path_factory.mktemp("results")
    return trial.run_cell(cell, folder), folder


def measured(found: Result) -> Measurement:
    assert found.measurement is not None
    return found.measurement


def test_an_honest_cell_is_believed_and_one_without_a_measurement_says_nothing(
    cell: Cell, honest: tuple[Result, Path]
) -> None:
    found, folder = honest
    assert contradiction(cell, found, folder, measured(found).wall_seconds) is None
    assert contradiction(cell, result(status="unsuitable"), folder) is None
    with Examiner([cell], folder) as examined:
        assert examined(cell, found, 60) is found


def told(found: Result, **changes: Any) -> Result:
    return replace(found, measurement=replace(measured(found), **changes))


MANY = Summary(0.2, -0.1, 0.9, 1000)


@pytest.mark.parametrize(
    ("of", "said"),
    [
        (Score((99.0,), (False,), {}), "robustness 99 from start 0, which is not satisfied"),
        (Score((0.1, -0.2), (True, True), {}), "robustness -0.2 from start 1, which is satisfied"),
        (Score((), (), {}, replace(MANY, satisfaction=0.0)), "the mean robustness is 0.2 beside 0 % satisfied"),
        (Score((), (), {}, replace(MANY, satisfaction=1.0)), "the least robustness is -0.1 beside 100 % satisfied"),
        (Score((), (), {}, replace(MANY, minimum=0.1)), "the least robustness is 0.1 beside 90 % satisfied"),
        (Score((), (), {}, replace(MANY, mean=-0.2)), "satisfaction 0.9, mean robustness -0.2, the least -0.1"),
        (Score((), (), {}, replace(MANY, satisfaction=1.5)), "satisfaction 1.5, mean robustness 0.2, the least -0.1"),
    ],
)
def test_robustness_and_satisfaction_that_cannot_be(
    cell: Cell, honest: tuple[Result, Path], of: Score, said: str
) -> None:
    found, folder = honest
    begin = f"policy's score by the protocol {RANDOM} cannot be: "
    for which in ("selected", "final"):
        scores = {**getattr(measured(found), which), RANDOM: of}
        assert contradiction(cell, told(found, **{which: scores}), folder) == f"the {which} {begin}{said}"


@pytest.mark.parametrize(
    ("changes", "seconds", "said"),
    [
        ({"training_cpu_seconds": 1e6}, 60, "its clocks cannot be right: training and all took"),
        ({"cpu_seconds": -1.0}, 60, "its clocks cannot be right: training and all took"),
        ({"wall_seconds": float("inf")}, 60, "its clocks cannot be right: training and all took"),
        ({"wall_seconds": 900.0}, 60, "its clock cannot be right: it says 900 s, and was away for 60 s"),
    ],
)
def test_clocks_that_cannot_be(
    cell: Cell, honest: tuple[Result, Path], changes: dict[str, float], seconds: float, said: str
) -> None:
    found, folder = honest
    assert str(contradiction(cell, told(found, **changes), folder, seconds)).startswith(said)


def test_a_score_that_is_not_that_of_the_traces(cell: Cell, honest: tuple[Result, Path]) -> None:
    found, folder = honest
    main = measured(found).selected[MAIN]
    better = replace(main, robustness=tuple(value + 1 for value in main.robustness), satisfied=(True,) * 64)
    lies = told(found, selected={**measured(found).selected, MAIN: better})
    assert str(contradiction(cell, lies, folder)).startswith("it says robustness ")


def test_traces_from_elsewhere(cell: Cell, honest: tuple[Result, Path], tmp_path: Path) -> None:
    """Where there are none, and where they begin in the middle of the disc or are too few: the files are removed."""
    found, task = honest[0], load_task("hold-disc")
    assert "has no traces at" in str(contradiction(cell, found, tmp_path))
    path = cell_files(tmp_path, cell.id, cell.key).traces
    still = np.zeros((64, task.file.steps + 1, len(task.signals)))
    fewer = (still[:3], "traces from 3 starts, and its row says 64")
    for samples, said in ((still, "do not begin at the report's starts"), fewer):
        save_samples(path, samples, task.signals)
        with Examiner([cell], tmp_path) as examined:
            failed = examined(cell, found, 60)
        assert (failed.status, failed.key, failed.measurement) == ("raised", cell.key, None)
        assert said in failed.reason
        assert not path.exists()


def test_what_is_recorded_in_the_reference_could_all_be() -> None:
    """18 tables of thousands of scores, by earlier versions: none is called impossible."""
    from stlbench.study.credibility import _of_scores

    folder = Path(__file__).parents[2] / "results" / "reference"
    found = [problem for each in Results.load(folder) if each.measurement for problem in _of_scores(each.measurement)]
    assert found == []
