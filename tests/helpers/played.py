"""A stand-in for the trainings of a solve, by a made-up clock."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from stlbench.records.identity import CellId
from stlbench.records.result import Result


class Played:
    """Stands for `run_study`: each cell takes a minute of a made-up clock, and satisfies from the share of its seed."""

    wall, trained, most = 2.0, 1.0, 6000
    """Seconds of a cell and of its training, and its steps, as it says."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, shares: dict[tuple[str, int], float]) -> None:
        self.shares, self.cells, self.now = shares, list[tuple[str, str, str, int]](), 0.0
        self.inits = list[Any]()
        self.steps: dict[str, int] = {}
        """Of each training of a method."""
        self.last: dict[tuple[str, int], float] = {}
        """The share of the last policy, where it is not that of the best."""
        monkeypatch.setattr("stlbench.solver.trainer.run_study", self)
        monkeypatch.setattr("stlbench.solver.trainer.time", SimpleNamespace(perf_counter=lambda: self.now))

    def __call__(self, **options: Any) -> list[Result]:
        results = list[Result]()
        self.inits.append(options["init"])
        for seed, method, agent in product(options["seeds"], options["methods"], options["agents"]):
            self.cells.append((options["budget"], method, agent, seed))
            self.now += 60.0
            results.append(self._result(*self.cells[-1]))
            if options["until"](results[-1]):
                break
        return results

    @staticmethod
    def begun(init: dict[str, Path]) -> str:
        """The method and the seed of the cell that trainings go on with."""
        ((_, path),) = init.items()
        return "/".join(path.name.split("_")[1:4:2])

    def _result(self, budget: str, method: str, agent: str, seed: int) -> Result:
        cell = CellId.parse(f"task/{method}/{agent}/{seed}/auto", budget)
        share = self.shares.get((method, seed), 0.4)
        measured = SimpleNamespace(
            selection=SimpleNamespace(satisfaction=share, robustness_mean=share),
            curve=[SimpleNamespace(satisfaction=self.last.get((method, seed), share), starts=64)],
            wall_seconds=self.wall,
            training_wall_seconds=self.trained,
            env_steps=self.steps.get(method, self.most),
        )
        return cast(Result, SimpleNamespace(id=cell, measurement=measured, key=f"{method}-{seed}"))
