"""The page of a folder of results."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.hostile_results import all_results
from helpers.pages import write
from helpers.synthetic_results import by_hand

from stlbench.records import result_files
from stlbench.records.result import MAIN
from stlbench.report.figures import trace_figures
from stlbench.report.figures.files import Drawing


@pytest.fixture(scope="session")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("<b>results")
    made = all_results(folder)
    assert made[0].measurement is not None
    assert made[0].measurement.selected[MAIN].robustness == (0.75, -0.5, 0.25)
    return write(made, (), by_hand(hold_disc=(0.4, 0.2)), folder)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write empty files as figures, since to write one takes a second."""

    def save(figure: object, folder: Path, name: str) -> list[Path]:
        return [result_files.write(folder / f"{name}.{end}", b"") for end in ("png", "svg", "pdf")]

    monkeypatch.setattr(Drawing, "write", lambda drawing, folder: save(None, folder, drawing.name))
    monkeypatch.setattr(trace_figures, "save", save)
