"""The same training gives the same bits: in processes that compile or load the code, and with plain kernels."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from stlbench import run_study

_TRAINED = """
import hashlib, sys
import numba.core.registry
if sys.argv[4:] == ["changed"]:
    del numba.core.registry.CPUDispatcher  # a private interface of Numba, on which the fast kernels build
from stlbench.contract import Training
from stlbench.registry.choices import choice_of
from stlbench.simulation.environment import BatchEnvironment
from stlbench.task import build_agent, build_method, load_task
from stlbench.contract.compiled import folder

task = load_task(choice_of(sys.argv[1]))
method, agent = build_method(task, choice_of("raw")), build_agent(task, choice_of(sys.argv[2]))
make = lambda count: BatchEnvironment(task, method, count, 0)
policy = agent.train(Training(make, int(sys.argv[3]), 0, lambda policy, steps: None, 1))
weights = policy.weights if hasattr(policy, "weights") else [part for layer in policy.layers for part in layer]
count = len(list(folder("stlbench_agents").rglob("*.nbc")))
print(count, hashlib.sha256(b"".join(part.tobytes() for part in weights)).hexdigest())
"""

_TRAININGS = {
    "joint": ("hold-disc", "dqn[gradient_steps=2]", "4800"),
    "one axis": ("pendulum", "dqn[head=additive]", "4800"),  # a head that once differed
    "continuous": ("cartpole", "td3", "6000"),
}


def trained(cache: Path, *arguments: str) -> tuple[int, str, str]:
    """How many functions are compiled then, the weights' digest, and warnings."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", _TRAINED, *arguments]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    count, digest = ended.stdout.split()
    return int(count), digest, ended.stderr


@pytest.mark.slow
@pytest.mark.parametrize("training", _TRAININGS.values(), ids=_TRAININGS)
def test_in_a_process_that_compiles_and_in_one_that_loads(training: tuple[str, ...], tmp_path: Path) -> None:
    compiled = trained(tmp_path, *training)
    assert compiled[0] > 0
    assert trained(tmp_path, *training) == compiled


@pytest.mark.slow
@pytest.mark.parametrize("training", _TRAININGS.values(), ids=_TRAININGS)
def test_in_plain_numba_where_a_private_interface_has_changed(training: tuple[str, ...], tmp_path: Path) -> None:
    _, digest, _ = trained(tmp_path, *training)
    _, plain_digest, warnings = trained(tmp_path, *training, "changed")
    assert plain_digest == digest
    assert warnings.count("the fast kernels do not work with Numba") == 1


@pytest.mark.slow
def test_with_one_job_and_with_two_and_in_any_order_of_cells(tmp_path: Path) -> None:
    """Workers are used again: a cell must not depend on those that its worker trained before."""

    def robustness(name: str, tasks: list[str], jobs: int) -> dict[str, list[float]]:
        results = run_study(tasks=tasks, methods=["raw"], seeds=1, budget="smoke", jobs=jobs, results=tmp_path / name)
        found = results.robustness()
        return {task: sorted(found[found["task"] == task]["robustness_mean"]) for task in tasks}

    tasks = ["integrator-or", "pendulum"]
    one = robustness("one", tasks, 1)
    assert all(len(values) >= 2 for values in one.values())  # of the selected and the final policy
    assert robustness("two", tasks, 2) == one
    assert robustness("reversed", tasks[::-1], 1) == one
