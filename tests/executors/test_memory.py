"""Amounts of memory, from texts and from what Linux says of control groups."""

from __future__ import annotations

import psutil
import pytest
from pydantic import TypeAdapter, ValidationError

from stlbench_executors.item_process import Memory, allowed, share, text_of

read = TypeAdapter(Memory).validate_python


@pytest.mark.parametrize(
    ("text", "size"),
    [("4G", 4 * 2**30), ("1.5GiB", 3 * 2**29), (" 512 mb ", 2**29), ("2T", 2**41), ("2048K", 2**21), (2**20, 2**20)],
)
def test_amounts(text, size):
    assert read(text) == size


@pytest.mark.parametrize("text", ["", "4", "G", "-4G", "4 G B", "lots", "4X", "1K", 0, "nan", "9" * 400 + "T"])
def test_what_is_no_amount_of_memory(text):
    with pytest.raises(ValidationError):
        read(text)


def test_texts():
    assert [text_of(size) for size in (300 * 2**20, 2**30, int(4.26 * 2**30))] == ["300 MiB", "1.0 GiB", "4.3 GiB"]


def test_the_share_of_several_is_a_part_of_the_machines():
    assert share(4) == pytest.approx(share(1) / 4, abs=1)
    assert share(1) <= 0.9 * psutil.virtual_memory().total


def test_limits_of_control_groups_are_those_of_all_above(tmp_path):
    job = tmp_path / "slurm" / "job" / "step"
    job.mkdir(parents=True)
    (job / "memory.max").write_text("max\n")
    (job.parent / "memory.max").write_text("8000\n")
    (tmp_path / "memory.max").write_text("9000\n")
    old = tmp_path / "memory" / "docker"
    old.mkdir(parents=True)
    (old / "memory.limit_in_bytes").write_text("7000\n")
    assert allowed(tmp_path, "0::/slurm/job/step\n") == [8000, 9000]
    assert allowed(tmp_path, "3:cpu:/docker\n7:memory:/docker\n") == [7000]
    assert allowed(tmp_path, "0::/elsewhere\n") == [9000]
    assert allowed(tmp_path, "") == []
