"""Agents that start from a stored policy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stlbench.errors import UsageError
from stlbench.records import array_files
from stlbench.records.array_files import digest
from stlbench.records.result_files import cell_files
from stlbench.registry.choices import choice_of, parse_choice, parse_choices
from stlbench.study.cell import Cell
from stlbench.study.initial import Initial, Stored, arrays_of, read
from stlbench.study.plan import check_cells, plan_cells
from stlbench.study.run import run_study
from stlbench.study.study import Study
from stlbench.task.reading import dump_yaml
from stlbench_agents.q_policy import GreedyPolicy, QNetwork

GRID = (21, 13)  # of hold-disc


def policy(path: Path, seed: int = 0, grid: tuple[int, ...] = GRID) -> Path:
    """A policy as `solve` stores it."""
    network = QNetwork(5, (8,), grid, "joint")
    array_files.write_arrays(path, GreedyPolicy(network, [network.initial(np.random.default_rng(seed))]).arrays())
    return path


def planned(init: Path | None = None, agent: str = "dqn") -> Cell:
    start = None if init is None else {choice_of("raw"): Initial.of(init)}
    agents = parse_choices(agent)
    (cell,) = plan_cells(parse_choices("hold-disc"), parse_choices("raw"), agents, [0], "smoke", init=start)
    return cell


def test_the_hash_of_the_policy_is_in_the_name_and_so_in_the_key(tmp_path: Path) -> None:
    one, other = policy(tmp_path / "one.npz"), policy(tmp_path / "other.npz", seed=1)
    start = Initial.of(one)
    cells = [planned(), planned(one), planned(other)]
    assert str(cells[1].id.agent) == f"dqn[init={start.digest[:16]}]"
    assert len({cell.key for cell in cells}) == 3
    assert planned(policy(tmp_path / "copy.npz")).key == cells[1].key
    assert str(start.given_to(parse_choice("dqn[init=0,gamma=0.9]"))) == f"dqn[gamma=0.9,init={start.digest[:16]}]"


def test_an_option_of_a_study(tmp_path: Path) -> None:
    one = policy(tmp_path / "one.npz")
    options = {"tasks": "hold-disc", "methods": "raw", "seeds": "1", "budget": "smoke"}
    (cell,) = Study.of(options | {"init": str(one)}).cells()
    assert cell.key == planned(one).key
    (plain,) = Study.of(options).cells()
    assert plain.key == planned().key


def test_of_a_cells_two_policies_it_is_the_selected_one(tmp_path: Path) -> None:
    arrays = read(policy(tmp_path / "one.npz"))
    both = {f"selected/{name}": each for name, each in arrays.items()} | {"final/weights": np.zeros(3)}
    array_files.write_arrays(tmp_path / "cell.npz", both)
    assert Initial.of(tmp_path / "cell.npz").digest == Initial.of(tmp_path / "one.npz").digest


def test_what_is_no_policy_is_refused_in_a_line(tmp_path: Path) -> None:
    one = policy(tmp_path / "one.npz")
    (tmp_path / "link.npz").symlink_to(one)
    (tmp_path / "text.npz").write_text("no arrays")
    np.savez(tmp_path / "objects.npz", weights=np.array([{}], dtype=object))
    for name, problem in (
        ("none.npz", "there is no policy at"),
        ("link.npz", "link.npz is a link"),
        ("text.npz", "it is no file of arrays"),
        ("objects.npz", "it is no file of arrays"),
    ):
        with pytest.raises(UsageError, match=problem):
            read(tmp_path / name)
    array_files.write_arrays(tmp_path / "other.npz", {"numbers": np.zeros(3)})
    with pytest.raises(UsageError, match=r"other\.npz on task hold-disc: it is no policy of agent dqn$"):
        check_cells([planned(tmp_path / "other.npz")])


def test_what_cannot_start_from_it_is_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="on task hold-disc: the policy chooses among 2 actions, the task has 21 x 13"):
        check_cells([planned(policy(tmp_path / "two.npz", grid=(2,)))])
    one = policy(tmp_path / "one.npz")
    with pytest.raises(UsageError, match=r"^--init .*one\.npz on task hold-disc: agent sb3-dqn cannot start from"):
        check_cells([planned(one, "sb3-dqn")])
    with pytest.raises(UsageError, match=r"^agent dqn\[init=12\] starts from a policy; name its file with --init$"):
        check_cells([planned(agent="dqn[init=12]")])


def test_a_file_that_changed_since_the_plan_is_refused(tmp_path: Path) -> None:
    cell = planned(policy(tmp_path / "one.npz"))
    assert arrays_of(cell) is not None
    policy(tmp_path / "one.npz", seed=1)
    with pytest.raises(UsageError, match="is no longer the policy"):
        arrays_of(cell)


def test_each_method_may_start_from_its_own_policy(tmp_path: Path) -> None:
    one, other = policy(tmp_path / "one.npz"), policy(tmp_path / "other.npz", seed=1)
    options = {"tasks": "hold-disc", "methods": "raw,funnel,flag", "seeds": "1", "budget": "smoke", "agents": "dqn"}
    cells = Study.of(options | {"init": {"raw": one, "funnel": other}}).cells()
    assert [cell.init for cell in cells] == [one, other, None]
    assert [str(cell.id.agent) for cell in cells] == [
        f"dqn[init={Initial.of(one).digest[:16]}]",
        f"dqn[init={Initial.of(other).digest[:16]}]",
        "dqn",
    ]
    with pytest.raises(UsageError, match=r"^init: dense is no method of this study$"):
        Study.of(options | {"init": {"dense": one}}).cells()
    for wrong in (3, {"raw": 3}, [str(one)]):
        with pytest.raises(
            UsageError, match=r"^init: a file, or one for each method as in \{raw: FILE\}, is expected, got"
        ):
            Study.of(options | {"init": wrong})


def test_a_training_goes_on_with_one_of_the_same_task_and_method(tmp_path: Path) -> None:
    """As a user: a budget that keeps the training, then `--init` with its file."""
    home = tmp_path / "swing"
    home.mkdir()
    content = {
        "title": "Swing",
        "source": "made up",
        "formula": "F[0,20] height >= 0.9",
        "environment": {"id": "Pendulum-v1", "names": ["height", "side", "speed"]},
        "sampling_time": 0.05,
        "steps": 20,
        "signals": {"height": {"low": -1, "high": 1}},
        "starts": 4,
        "budgets": {"kept": {"steps": 2000, "checkpoints": 1, "random_starts": 0, "resumable": True}},
    }
    (home / "task.yaml").write_text(dump_yaml(content), encoding="utf-8")
    asked: dict[str, Any] = {"tasks": str(home), "agents": "td3[batch_size=8]", "seeds": 1, "budget": "kept", "jobs": 1}
    (first,) = run_study(**asked, methods="raw", results=tmp_path / "first")
    (path,) = (tmp_path / "first" / "trainings").iterdir()
    assert path == cell_files(tmp_path / "first", first.id, first.key).training
    stored = Stored.among(read(path))
    assert first.measurement
    assert first.measurement.policies
    assert digest(stored.policy) == first.measurement.policies.final
    assert len(stored.training["reward"]) == 2000
    (second,) = run_study(**asked, methods="raw", results=tmp_path / "second", init=path)
    assert str(second.id.agent) == f"td3[batch_size=8,init={Initial.of(path).digest[:16]}]"
    (path,) = (tmp_path / "second" / "trainings").iterdir()
    assert len(read(path)["training/reward"]) == 4000
    with pytest.raises(UsageError, match=r"should be a training of swing/funnel, got swing/raw; a policy starts any"):
        run_study(**asked, methods="funnel", results=tmp_path / "third", init=path)
    arrays = {name: array for name, array in read(path).items() if name != "training/critics"}
    array_files.write_arrays(tmp_path / "damaged.npz", arrays)
    (damaged,) = run_study(**asked, methods="raw", results=tmp_path / "fourth", init=tmp_path / "damaged.npz")
    assert (damaged.status, damaged.reason) == (
        "unsuitable",
        "the training to go on with is damaged: KeyError: 'critics'",
    )
    with pytest.raises(UsageError, match="should be a training of swing/funnel, got swing/raw"):
        run_study(**asked, methods="raw,funnel", results=tmp_path / "fifth", init=path)
