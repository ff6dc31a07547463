"""Two methods on the tasks that both take, by Wilcoxon's test and Holm's correction."""

from __future__ import annotations

from types import ModuleType

import pytest
from helpers.studies import load


@pytest.fixture
def paired() -> ModuleType:
    return load("paired")


def cells(more: list[float]) -> list[dict[str, str]]:
    """One method that has so much more than `raw` on each task, in two seeds; and one that takes the first alone."""
    rows = [("raw", 0.0, 0.2, n) for n in range(len(more))] + [("funnel", each, 1.0, n) for n, each in enumerate(more)]
    columns = ("task", "method", "status", "robustness_mean", "satisfaction")
    values = (
        (f"suite-arm-tube-{n}", method, status, str(value + offset), str(share))
        for method, value, share, n in [*rows, ("flag", 5.0, 1.0, 0)]
        for offset, status in ((-0.1, "done"), (0.1, "done"), (9.0, "raised"))
    )
    return [dict(zip(columns, row, strict=True)) for row in values]


def given(paired: ModuleType, monkeypatch: pytest.MonkeyPatch, more: list[float]) -> None:
    monkeypatch.setattr(paired.recorded, "table", lambda folder, name: cells(more))
    monkeypatch.setattr(paired.recorded, "scored", lambda task, robustness: robustness)


def test_the_p_value_by_hand(paired: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 2^8 signs of eight differences two have no negative rank or no positive one: p = 2 / 256."""
    given(paired, monkeypatch, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    own = paired.runs("any")
    found = paired.compared(own, "funnel", "raw")
    assert found.chance == pytest.approx(2 / 256)
    assert found.told.startswith("0.45 [")
    assert len(found.pairs) == 8
    assert len(paired.compared(own, "flag", "raw").pairs) == 1
    given(paired, monkeypatch, [0.1] * 16)
    assert paired.compared(paired.runs("any", "learned"), "funnel", "raw").shares_told == "1.00 [0.65, 1.00]"


def test_methods_that_are_the_same_do_not_differ(paired: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    given(paired, monkeypatch, [0.0] * 8)
    assert paired.compared(paired.runs("any"), "funnel", "raw").chance == 1.0


def test_stated_differences_are_corrected_together(paired: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two, Holm takes 2 / 256 times 2."""
    given(paired, monkeypatch, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    monkeypatch.setattr(paired, "STATED", (("funnel", "raw"), ("raw", "raw")))
    *_, first, second = paired.stated("any").splitlines()
    assert first.startswith("| `funnel` less `raw` | 8 | 0.45 [")
    assert first.endswith("| 0.016 |")
    assert second.endswith("| 1.000 |")
