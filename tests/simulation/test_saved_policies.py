"""The file of a cell's policies: what is read is what was written, and nothing else."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import synthetic_results

from stlbench.contract import Array, Arrays, Integers, Policy, StatePolicy
from stlbench.errors import UsageError
from stlbench.records import array_files
from stlbench.records.array_files import digest, read_policy, save_policies
from stlbench.records.result import Result, StoredPolicies
from stlbench.records.result_files import cell_files

SELECTED = {"weights": np.array([[1.5, -0.0], [np.nan, np.inf]], np.float32), "kind": np.array("additive")}
FINAL = {"weights": np.zeros((0, 3)), "kind": np.array("joint")}


class Kept(Policy):
    def __init__(self, arrays: Arrays | None) -> None:
        self._arrays = arrays

    def act(self, observation: Array) -> Integers:
        return np.zeros(len(observation), dtype=np.int64)

    def arrays(self) -> Arrays | None:
        return self._arrays


class OnState(StatePolicy):
    def episode(self):  # type: ignore[no-untyped-def]
        return lambda state, t, memory: np.zeros(len(state), dtype=np.int64)


def stored(folder: Path, selected: Arrays, final: Arrays) -> Result:
    """A cell with these policies in its file."""
    made = synthetic_results.result()
    made = replace(made, key=hashlib.sha256(made.key.encode()).hexdigest())
    digests = save_policies(cell_files(folder, made.id, made.key).policies, Kept(selected), Kept(final))
    assert digests is not None
    assert made.measurement is not None
    return replace(made, measurement=replace(made.measurement, policies=StoredPolicies(*digests, 3)))


def same(one: Arrays, other: Arrays) -> bool:
    return one.keys() == other.keys() and all(
        (one[name].dtype, one[name].shape, one[name].tobytes())
        == (other[name].dtype, other[name].shape, other[name].tobytes())
        for name in one
    )


def test_what_was_written_is_read_bit_for_bit(tmp_path: Path) -> None:
    result = stored(tmp_path, SELECTED, FINAL)
    assert same(read_policy(tmp_path, result, "selected"), SELECTED)
    assert same(read_policy(tmp_path, result, "final"), FINAL)
    (file,) = (tmp_path / "policies").iterdir()
    assert file.name == f"hold-disc_funnel_dqn_0_{result.key[:12]}.npz"


def test_a_selected_policy_that_is_the_final_one_is_there_once(tmp_path: Path) -> None:
    result = stored(tmp_path, SELECTED, dict(SELECTED))
    with np.load(cell_files(tmp_path, result.id, result.key).policies) as file:
        assert sorted(file.files) == ["selected/kind", "selected/weights"]
    assert same(read_policy(tmp_path, result, "final"), SELECTED)


@pytest.mark.parametrize("policy", [Kept(None), OnState()])
def test_of_policies_that_cannot_be_kept_there_is_no_file(tmp_path: Path, policy: Policy | StatePolicy) -> None:
    assert save_policies(tmp_path / "a.npz", Kept(SELECTED), policy) is None
    assert list(tmp_path.iterdir()) == []


def test_objects_are_no_arrays(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="array 'selected/x' has objects"):
        save_policies(tmp_path / "a.npz", Kept({"x": np.array([{}])}), Kept(FINAL))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "changed",
    [
        {"weights": SELECTED["weights"] + 0, "kind": np.array("joint")},
        {"weights": SELECTED["weights"].astype(float), "kind": SELECTED["kind"]},
        {"weights": SELECTED["weights"].reshape(4), "kind": SELECTED["kind"]},
        {"weight": SELECTED["weights"], "kind": SELECTED["kind"]},
        {"weights": np.abs(SELECTED["weights"]), "kind": SELECTED["kind"]},
        {"kind": SELECTED["kind"]},
    ],
)
def test_the_digest_tells_arrays_apart(changed: Arrays) -> None:
    assert digest(changed) != digest(SELECTED)


def test_the_digest_does_not_depend_on_order_or_layout() -> None:
    turned = {"kind": SELECTED["kind"], "weights": np.asfortranarray(SELECTED["weights"])}
    assert digest(turned) == digest(SELECTED)


def test_another_content_than_the_recorded_one_is_refused(tmp_path: Path) -> None:
    result = stored(tmp_path, SELECTED, FINAL)
    stored(tmp_path, SELECTED, SELECTED)
    assert same(read_policy(tmp_path, result, "selected"), SELECTED)
    with pytest.raises(UsageError, match="does not have the final policy of hold-disc/funnel/dqn/0: its hash"):
        read_policy(tmp_path, result, "final")


def test_half_a_file_is_refused(tmp_path: Path) -> None:
    result = stored(tmp_path, SELECTED, FINAL)
    path = cell_files(tmp_path, result.id, result.key).policies
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(UsageError, match=r"cannot read .* as policies of stlbench"):
        read_policy(tmp_path, result, "selected")


def test_why_there_is_no_policy(tmp_path: Path) -> None:
    done = synthetic_results.result()
    with pytest.raises(UsageError, match="no stored policy: its agent stores none"):
        read_policy(tmp_path, done, "selected")
    failed = synthetic_results.result(status="timeout", reason="no result after 60 s")
    with pytest.raises(UsageError, match="no policy: timeout: no result after 60 s"):
        read_policy(tmp_path, failed, "selected")
    result = stored(tmp_path, SELECTED, FINAL)
    with pytest.raises(UsageError, match="has no policy at"):
        read_policy(tmp_path / "elsewhere", result, "selected")


def test_a_write_that_fails_leaves_the_file_of_before(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    array_files.write_arrays(path, SELECTED)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        array_files.write_arrays(path, {"x": np.array([None])})
    assert path.read_bytes() == before
