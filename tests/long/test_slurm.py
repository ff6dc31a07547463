"""Shards of a study as an array of jobs of a real Slurm, and what becomes of them when jobs or nodes are lost.

The jobs are those of the page: its script, with another study and fewer shards.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from executors.test_local import alive
from helpers.reader import ROOT
from helpers.waiting import wait_for
from long import slurm_cluster

from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result_files import writer
from stlbench.records.upkeep import merge
from stlbench.study.study import Study

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not slurm_cluster.is_possible(), reason="needs root, and Debian's slurm-wlm and munge"),
]
STUDY = "tasks: hold-disc\nmethods: raw,flag\nseeds: 6\nbudget: smoke\n"


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[slurm_cluster.Cluster]:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    monkeypatch.chdir(tmp_path)
    Path("study.yaml").write_text(STUDY)
    with slurm_cluster.cluster(tmp_path / "slurm") as made:
        yield made


def queue(*options: str) -> None:
    page = (ROOT / "docs/howto/cluster.md").read_text()
    (script,) = re.findall(r'^```bash title="shards.sh"\n(.*?)^```$', page, re.MULTILINE | re.DOTALL)
    ours = {"studies/reference.yaml": "study.yaml", "1-40": "1-2", "/40": "/2", "--mem=9G": "--mem=4G", " 4G": " 1G"}
    for there, here in ours.items():
        assert there in script
        script = script.replace(there, here)
    script = script.replace("exec stlbench", f"exec {sys.executable} -m stlbench")
    Path("shards.sh").write_text(script)
    subprocess.run(["sbatch", *options, "shards.sh"], check=True)


def recorded(number: int) -> int:
    file = Path(f"study/shard-{number}-of-2") / LEDGER
    if not file.exists():
        return 0
    with Ledger(file, create=False) as ledger:
        return len(ledger.listed())


def ended(cluster: slurm_cluster.Cluster) -> bool:
    return not {"RUNNING", "PENDING", "COMPLETING", "CONFIGURING"} & set(cluster.states().values())


def check_merged() -> None:
    """Both folders together have each cell, measured once."""
    counts = [merge(Path("study"), folder) for folder in sorted(Path("study").glob("shard-*"))]
    assert [count.added for count in counts] == [6, 6]
    with Ledger(Path("study") / LEDGER, create=False) as ledger:
        assert {result.key for result in ledger.results()} == {cell.key for cell in Study.of({}, "study.yaml").cells()}
        assert {result.status for result in ledger.results()} == {"done"}


def test_an_array_of_shards_gives_the_study(cluster: slurm_cluster.Cluster) -> None:
    queue()
    wait_for(lambda: set(cluster.states().values()) == {"COMPLETED"}, 1200)
    check_merged()


def test_a_cancelled_shard_leaves_no_process_and_goes_on_when_it_is_queued_again(
    cluster: slurm_cluster.Cluster,
) -> None:
    queue("--array=1")
    wait_for(lambda: 0 < recorded(1) < 6, 1200)
    holder = writer(Path("study/shard-1-of-2"))
    assert holder is not None
    (job,) = cluster.states()
    subprocess.run(["scancel", job], check=True)
    wait_for(lambda: ended(cluster) and not alive(int(holder.split()[1])), 120)
    before = recorded(1)
    assert before < 6
    queue()
    wait_for(lambda: ended(cluster), 1200)
    assert f"6 cells, {before} of them done before" in "".join(file.read_text() for file in Path().glob("*.out"))
    check_merged()


def test_a_shard_whose_node_is_lost_goes_on_at_another(cluster: slurm_cluster.Cluster) -> None:
    """Slurm queues the job again by itself, as the script says."""
    queue("--array=1")
    wait_for(lambda: 0 < recorded(1) < 6, 1200)
    (job,) = cluster.states()
    cluster.lose(cluster.node_of(job))
    wait_for(lambda: recorded(1) == 6, 1200)
    queue("--array=2")
    wait_for(lambda: recorded(2) == 6 and ended(cluster), 1200)
    check_merged()
