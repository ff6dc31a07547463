"""Files of PyTorch: torch itself is the oracle, and nothing in a file is run that could do more than compute."""

from __future__ import annotations

import builtins
import io
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from stlbench.contract import Policy
from stlbench.errors import UsageError
from stlbench.records.result import MAIN
from stlbench.share import torch_files
from stlbench.share.scoring import Shown, score
from stlbench.share.source import find_source
from stlbench.share.torch_files import load_state_dict, read_weights
from stlbench.simulation.baselines import Unpaid
from stlbench.simulation.referee import Referee
from stlbench.task import load_task

SEEN = np.random.default_rng(0).normal(size=(200, 4))
FORM = "mlp[4,16,16,6;relu]"


class Net(torch.nn.Module):
    """Not a Sequential: its layers have names of their own, and its output is one of two."""

    def __init__(self, activation: Any = torch.relu) -> None:
        super().__init__()
        self.first, self.second, self.last = torch.nn.Linear(4, 16), torch.nn.Linear(16, 16), torch.nn.Linear(16, 6)
        self.activation = activation

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, int]:
        return self.last(self.activation(self.second(self.activation(self.first(x))))), x.shape[0]


def made(module: torch.nn.Module) -> torch.nn.Module:
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for weight in module.parameters():
            weight.copy_(torch.randn(weight.shape, generator=generator))
    return module


def expected(module: torch.nn.Module, kind: torch.dtype = torch.float32) -> Any:
    with torch.no_grad():
        return module(torch.as_tensor(SEEN, dtype=kind))[0].numpy()


def written(path: Path, content: Any) -> Path:
    torch.save(content, path)
    return path


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_a_state_dict_acts_as_its_module(tmp_path: Path, activation: str, kind: torch.dtype) -> None:
    module = made(Net(getattr(torch, activation))).to(kind)
    path = written(tmp_path / "q.pt", module.state_dict())
    found = load_state_dict(path, f"mlp[4, 16,16,6; {activation}]", 4)(SEEN)
    assert found == pytest.approx(expected(module, kind), rel=1e-5 if kind == torch.float32 else 1e-12, abs=1e-5)
    assert len(np.unique(found.argmax(axis=1))) > 2


def test_it_is_scored_as_the_policy_itself(tmp_path: Path) -> None:
    """A grid of 21 x 9 actions: the action with the greatest value."""
    task = load_task("hold-disc-coarse")
    size = task.system.features(task.starts.report_and_selection()[0][:1], np.array([0])).shape[1] + 1
    module = made(torch.nn.Sequential(torch.nn.Linear(size, 32), torch.nn.Tanh(), torch.nn.Linear(32, 21 * 9)))
    assert task.actions.size == 21 * 9  # type: ignore[union-attr]

    class Greedy(Policy):
        def act(self, observation: Any) -> Any:
            with torch.no_grad():
                return module(torch.as_tensor(observation, dtype=torch.float32)).argmax(1).numpy()

    written(tmp_path / "q.pth", module.state_dict())
    own = Referee(task, Unpaid(task.specification), 20).assess(Greedy())
    found = score(task, find_source(str(tmp_path / "q.pth"), f"mlp[{size},32,189;tanh]"), Shown(), 20)
    assert found.measurement.selected == own.scores
    assert own.scores[MAIN].robustness != own.scores["paper"].robustness


OWN_V, OWN_OMEGA = np.linspace(-5, 5, 21), np.linspace(-2, 2, 9)


def test_own_actions_are_taken_as_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The networks of the paper's authors: 21 x 9 actions, not the task's. Beside it, dynamics stepped by hand."""
    task = load_task("hold-disc-coarse")
    table = np.array([(v, omega) for v in OWN_V for omega in OWN_OMEGA])
    rows = "".join(f"{v!r},{omega!r}\n" for v, omega in table.tolist())
    (tmp_path / "own.csv").write_text(f"v,omega\n{rows}")
    module = made(torch.nn.Sequential(torch.nn.Linear(3, 16), torch.nn.ReLU(), torch.nn.Linear(16, len(table))))
    path = written(tmp_path / "q.pt", module.state_dict())
    source = find_source(str(path), "mlp[3,16,189;relu]", str(tmp_path / "own.csv"))
    found = score(task, source, Shown("state"), 0)
    state, traces = task.starts.report_and_selection()[0], []
    for _ in range(task.file.steps):
        traces.append(task.system.signals(state))
        with torch.no_grad():
            best = module(torch.as_tensor(state, dtype=torch.float32)).argmax(1).numpy()
        state = task.system.step(state, table[best])
    assert np.array_equal(found.assessment.traces[:, :-1], np.stack(traces, axis=1))
    assert (found.moved, found.observation) == ("", "x, y, heading")
    act = "def act(state, t): return np.tile([0.5, 2.0], (len(state), 1))\n"  # omega 2 is between 1.5 and 2.25
    (tmp_path / "zz_own.py").write_text(f"import numpy as np\n{act}")
    monkeypatch.syspath_prepend(str(tmp_path))
    moved = score(task, find_source("zz_own:act"), Shown("state"), 0).moved
    assert moved.endswith(
        "(100 %) are not on the task's grid, and were moved to the nearest: omega by up to 0.25 rad/s"
    )


def weights(**changes: Any) -> dict[str, Any]:
    return made(Net()).state_dict() | changes


@pytest.mark.parametrize(
    ("content", "form", "message"),
    [
        (weights(), "mlp[4,16,16,6]", r"--architecture mlp\[4,16,16,6\]: expected are sizes and an activation, as in"),
        (weights(), f"mlp[{'9' * 5000},6;relu]", "expected are sizes and an activation, as in"),
        (weights(**{"last.bias": torch.zeros(6, dtype=torch.complex64)}), FORM, "'last.bias' is of complex64; weights"),
        (weights(), "lstm[4,6;relu]", r"--architecture lstm\[4,6;relu\]: expected are sizes"),
        (weights(), "mlp[4,16,16,6;gelu]", "no activation 'gelu'; did you mean 'relu'|there are: relu, tanh"),
        (weights(), "mlp[4,16,6;relu]", r"3 layers, first., second., last.; mlp\[4,16,6;relu\] has 2"),
        (weights(), "mlp[4,16,8,6;relu]", r"'second.weight' has the shape \(16, 16\); by .* it is \(8, 16\)"),
        (weights(), "mlp[5,16,16,6;relu]", r"'first.weight' has the shape \(16, 4\); by .* it is \(16, 5\)"),
        (weights(**{"last.bias": torch.zeros(7)}), FORM, r"'last.bias' has the shape \(7,\); by .* it is \(6,\)"),
        (weights(**{"norm.running_mean": torch.zeros(1)}), FORM, "'norm.running_mean' is no weight or bias of a layer"),
        ({n: w for n, w in weights().items() if n != "last.bias"}, FORM, "there is no 'last.bias', which mlp"),
        (weights(**{"last.bias": torch.full((6,), torch.nan)}), FORM, "has weights that are NaN or infinite"),
        ({"epoch": 3, "model": weights()}, FORM, "is no state_dict that can be read without running it; expected is"),
        (Net(), FORM, "is no state_dict that can be read without running it; expected is what torch.save"),
        ([1, 2], FORM, "is no state_dict that can be read without running it"),
    ],
)
def test_state_dicts_that_do_not_fit(tmp_path: Path, content: Any, form: str, message: str) -> None:
    path = written(tmp_path / "q.pt", content)
    with pytest.raises(UsageError, match=message) as caught:
        load_state_dict(path, form, 4)
    assert "\n" not in str(caught.value)
    assert "weights_only" not in str(caught.value)  # no advice to run what is in the file


def test_nothing_in_a_file_is_run(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (tmp_path / "run",)

    (tmp_path / "text.pt").write_text("garbage")
    (tmp_path / "pickle.pt").write_bytes(pickle.dumps(Trap()))
    written(tmp_path / "trap.pt", {"first.weight": Trap()})
    torch.jit.save(torch.jit.script(made(Net())), tmp_path / "script.pt")
    for name in ("text.pt", "pickle.pt", "trap.pt", "script.pt"):
        with pytest.raises(UsageError, match="is no state_dict that can be read without running it"):
            load_state_dict(tmp_path / name, FORM, 4)
    assert not (tmp_path / "run").exists()


def test_without_torch_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = builtins.__import__

    def without(name: str, *args: Any) -> Any:
        if name == "torch":
            raise ImportError("no torch")
        return plain(name, *args)

    path = written(tmp_path / "q.pt", weights())
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UsageError, match=r"q.pt needs PyTorch: pip install \"stlbench-rl\[sb3\]\""):
        load_state_dict(path, FORM, 4)


def test_an_architecture_and_a_table_are_for_what_has_a_use_for_them(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("x\n0\n")
    with pytest.raises(UsageError, match=r"my:act: --architecture is for a state_dict of PyTorch, .pt or .pth; leave"):
        find_source("my:act", FORM)
    (tmp_path / "q.pt").write_bytes(b"")
    with pytest.raises(UsageError, match=r"q.pt: a file of PyTorch has weights and no network; say --architecture"):
        find_source(str(tmp_path / "q.pt"))
    for policy in (str(tmp_path / "t.csv"), "hold-disc/funnel/dqn/0"):
        with pytest.raises(UsageError, match="--actions is for a policy from outside that acts; leave it out"):
            find_source(policy, None, "own.csv")


def test_what_would_take_all_memory_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tensor that repeats one number is small in its file, and so is a file that is packed once more."""
    path = written(tmp_path / "q.pt", weights(**{"last.bias": torch.zeros(1).expand(10**6, 10**6)}))
    with pytest.raises(UsageError, match=r"q.pt: its weights would take \d+ MiB, at most 2048 are read"):
        load_state_dict(path, FORM, 4)
    with zipfile.ZipFile(tmp_path / "z.pt", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("archive/data/0", bytes(2**21))
    monkeypatch.setattr(torch_files, "LARGEST", 2**20)
    with pytest.raises(UsageError, match=r"z.pt: it would take 2 MiB unpacked, at most 1 are read"):
        load_state_dict(tmp_path / "z.pt", FORM, 4)


def test_the_older_format_of_torch_is_read_from_bytes_too(tmp_path: Path) -> None:
    content = io.BytesIO()
    torch.save({"a.weight": torch.ones(2, 3)}, content, _use_new_zipfile_serialization=False)
    read = read_weights(tmp_path / "old.pt", io.BytesIO(content.getvalue()))
    assert read["a.weight"].tolist() == [[1.0] * 3] * 2
