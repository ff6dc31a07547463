"""TensorBoard: a run of it for each cell, in files that `tensorboard --logdir` reads."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stlbench.contract import LoggedCell, RunLog
from stlbench_logs import require

_SECONDS = 5
"""Between two writings at most."""


@dataclass(kw_only=True)
class TensorBoard(RunLog):
    """Learning curves and scores for TensorBoard, through tensorboardX.

    Args:
        folder: where the files go; DIR/tensorboard where it is empty, and DIR the folder of results.
    """

    folder: str = ""
    _place: Path = field(default=Path("tensorboard"), init=False, repr=False)
    _writers: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        require("tensorboardX", "tensorboard")

    def begin(self, folder: Path, cells: tuple[str, ...]) -> None:
        """See `RunLog.begin`."""
        self._place = Path(self.folder) if self.folder else folder / "tensorboard"

    def ended(self, cell: LoggedCell) -> None:
        """The referee's curve, `curve/...`, and its report, `report/...`; how it ended as text."""
        writer = self._writer(cell.cell)
        for point in cell.curve:
            _add(writer, "curve/satisfaction", point.satisfaction, point.steps)
            _add(writer, "curve/robustness", point.robustness, point.steps)
        for name, value in cell.numbers.items():
            _add(writer, f"report/{name}", value, 0)
        writer.add_text("status", f"{cell.status}: {cell.reason}" if cell.reason else cell.status)
        self._writers.pop(cell.cell).close()

    def end(self) -> None:
        """Close what cells left that did not end."""
        while self._writers:
            self._writers.popitem()[1].close()

    def _writer(self, cell: str) -> Any:
        from tensorboardX import SummaryWriter

        if cell not in self._writers:
            self._writers[cell] = SummaryWriter(str(self._place / cell), flush_secs=_SECONDS)
        return self._writers[cell]


def _add(writer: Any, name: str, value: float, steps: int) -> None:
    """Leave out what is no number, which TensorBoard would draw at 0."""
    if math.isfinite(value):
        writer.add_scalar(name, value, steps)
