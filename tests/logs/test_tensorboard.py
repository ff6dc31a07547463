"""What TensorBoard reads of what is written for it."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from stlbench.contract import LoggedCell, LoggedCheckpoint, Unsuitable
from stlbench.testing import check_log

events = pytest.importorskip("tensorboardX.proto.event_pb2")

CELL = "hold-disc/funnel[ginf=0.02]/dqn/0"


def records(content: bytes) -> Iterator[bytes]:
    """Of a file of events: the length of each, a checksum, the event, a checksum."""
    while content:
        (length,) = struct.unpack("<Q", content[:8])
        yield content[12 : 12 + length]
        content = content[16 + length :]


def read(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """Scalars by their names, as TensorBoard has them: steps and values."""
    found = dict[str, list[tuple[int, float]]]()
    for path in sorted(folder.glob("events.out.tfevents.*")):
        for record in records(path.read_bytes()):
            event = events.Event.FromString(record)
            for value in event.summary.value:
                if value.WhichOneof("value") == "simple_value":
                    found.setdefault(value.tag, []).append((event.step, value.simple_value))
    return found


def test_it_keeps_the_rules() -> None:
    from stlbench_logs.tensorboard import TensorBoard

    check_log(TensorBoard)


def test_tensorboard_reads_curves_and_scores(tmp_path: Path) -> None:
    from stlbench_logs.tensorboard import TensorBoard

    log = TensorBoard()
    log.begin(tmp_path, (CELL,))
    curve = (LoggedCheckpoint(CELL, 1000, 0.25, -0.5), LoggedCheckpoint(CELL, 2000, 1.0, float("nan")))
    log.ended(LoggedCell(CELL, "quick", "done", "", {"robustness": 0.375}, curve))
    log.end()
    assert read(tmp_path / "tensorboard" / CELL) == {
        "curve/satisfaction": [(1000, 0.25), (2000, 1.0)],
        "curve/robustness": [(1000, -0.5)],
        "report/robustness": [(0, 0.375)],
    }


def test_another_folder(tmp_path: Path) -> None:
    from stlbench_logs.tensorboard import TensorBoard

    log = TensorBoard(folder=str(tmp_path / "elsewhere"))
    log.begin(tmp_path / "results", ())
    log.ended(LoggedCell(CELL, "quick", "raised", "ValueError: no"))
    assert list((tmp_path / "elsewhere" / CELL).iterdir())


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import stlbench_logs
    from stlbench_logs import tensorboard

    monkeypatch.setattr(stlbench_logs, "find_spec", lambda name: None)
    with pytest.raises(Unsuitable, match=r'pip install "stlbench-rl\[tensorboard\]"'):
        tensorboard.TensorBoard()
