"""Weights & Biases: a run of it for each cell, in one group for each folder of results."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from stlbench.contract import LoggedCell, RunLog
from stlbench_logs import require


@dataclass(kw_only=True)
class WandB(RunLog):
    """Learning curves and scores for Weights & Biases.

    Args:
        project: name of the project there.
        entity: user or team; that of the login where it is empty.
        mode: `online` sends while the run goes on; `offline` writes files, which `wandb sync` sends later; `settings`
            is what wandb's own settings say, such as WANDB_MODE.
    """

    project: str = "stlbench"
    entity: str = ""
    mode: Literal["settings", "online", "offline"] = "settings"
    _folder: Path = field(default=Path(), init=False, repr=False)
    _runs: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        require("wandb", "wandb")

    def begin(self, folder: Path, cells: tuple[str, ...]) -> None:
        """See `RunLog.begin`."""
        self._folder = folder

    def ended(self, cell: LoggedCell) -> None:
        """The referee's curve, `curve/...`, and its report as the summary."""
        run = self._run(cell.cell)
        for point in cell.curve:
            scores = {"curve/satisfaction": point.satisfaction, "curve/robustness": point.robustness}
            run.log({"steps": point.steps, **_finite(scores)})
        run.summary.update({"status": cell.status, "reason": cell.reason, **_finite(dict(cell.numbers))})
        run.config.update({"budget": cell.budget})
        self._runs.pop(cell.cell).finish(exit_code=int(cell.status in ("raised", "timeout", "killed")))

    def end(self) -> None:
        """Finish what cells left that did not end."""
        while self._runs:
            self._runs.popitem()[1].finish(exit_code=1)

    def _run(self, cell: str) -> Any:
        import wandb

        if cell not in self._runs:
            parts = dict(zip(("task", "method", "agent", "seed", "track"), cell.split("/"), strict=False))
            where = {"entity": self.entity or None, "mode": None if self.mode == "settings" else self.mode}
            run = wandb.init(
                project=self.project,
                group=self._folder.name,
                name=cell,
                config=parts,
                dir=str(self._folder),
                reinit="create_new",
                settings=wandb.Settings(console="off", silent=True),
                **where,
            )
            run.define_metric("*", step_metric="steps")
            self._runs[cell] = run
        return self._runs[cell]


def _finite(values: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if math.isfinite(value)}
