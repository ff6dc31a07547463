"""What pages take for granted: the folders and files that a reader has before the first command of a page."""

from __future__ import annotations

import lzma
import re
import shutil
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import numpy as np

from helpers.reader import ROOT, stlbench
from stlbench.records.result_files import LINES, PACKED
from stlbench.task import load_task

TITLED = re.compile(r'^```(?:yaml|python|csv) title="([^"]+)"\n(.*?)^```$', re.MULTILINE | re.DOTALL)
STUDY = "tasks: ./cart-reach\nmethods: funnel\nseeds: 1\nbudget: smoke\n"
CONTROLLERS = "import numpy as np\ndef energy(state, t): return np.zeros((len(state), 1))\n"
FIRST = ("--tasks", "hold-disc,reach-stay,robot-nav", "--methods", "funnel,funnel[variant=code],flag,raw")


def titled(page: str, folder: Path) -> None:
    """The files that a page shows with their names."""
    for name, text in TITLED.findall((ROOT / "docs" / page).read_text(encoding="utf-8")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def results(folder: Path) -> None:
    """A first run: `results` in the folder."""
    done = stlbench(["run", *FIRST, "--results", str(folder / "results")])
    assert done.exit_code == 0, done.output


def committed(name: str, words: str, folder: Path) -> None:
    """Of results of the repository the lines with these words: `results/NAME` in the folder."""
    (folder / "results" / name).mkdir()
    kept = "".join(f"{line}\n" for line in committed_lines(ROOT / "results" / name) if words in line)
    (folder / "results" / name / LINES).write_text(kept, encoding="utf-8")


def committed_lines(folder: Path) -> list[str]:
    """The lines of a study in git, as they are."""
    packed = folder / PACKED
    data = lzma.decompress(packed.read_bytes()) if packed.exists() else (folder / LINES).read_bytes()
    return data.decode().splitlines()


def own_task(folder: Path) -> None:
    """The task of howto/task.md, also as `my-task`."""
    titled("howto/task.md", folder)
    shutil.copytree(folder / "cart-reach", folder / "my-task")


def policies(folder: Path) -> None:
    """Policies and traces from outside, for reach-stay and lunar-lander, and a controller for the pendulum."""
    import gymnasium
    import stable_baselines3
    import torch

    import_module("stlbench.gym")  # registers its environments

    (folder / "my_controllers.py").write_text(CONTROLLERS)
    titled("howto/policies.md", folder)
    traces(folder / "recorded.csv", "reach-stay")
    sizes = pairwise((3, 256, 256, 256, 21 * 9))
    layers = [part for pair in sizes for part in (torch.nn.Linear(*pair), torch.nn.ReLU())]
    torch.save(torch.nn.Sequential(*layers[:-1]).state_dict(), folder / "authors.pth")
    own = gymnasium.make("stlbench/reach-stay-v0", method="raw")
    for name, environment in {"model": own, "lander": gymnasium.make("LunarLander-v3", continuous=True)}.items():
        stable_baselines3.PPO("MlpPolicy", environment, device="cpu", seed=0).save(folder / name)
    assert stlbench(["export-policy", "reach-stay/flag/dqn/0", "policy.onnx", "--results", "results"]).exit_code == 0


def file_of_study(folder: Path) -> None:
    """The first file that howto/python.md shows."""
    text = (ROOT / "docs/howto/python.md").read_text(encoding="utf-8")
    (folder / "study.yaml").write_text(text.partition("```yaml\n")[2].partition("```")[0])


def example(folder: Path) -> None:
    """The distribution `plugins/example`, installed."""
    (folder / "stlbench_example").symlink_to(ROOT / "plugins/example/src/stlbench_example")
    info = folder / "docs_verdict-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: docs-verdict\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[stlbench.methods]\nverdict = stlbench_example.verdict:Verdict\n")


def traces(path: Path, task: str) -> None:
    """A trace that stays where it is, as `stlbench monitor` reads them."""
    found = load_task(task)
    rows = np.tile([2.1, 2.0], (found.file.steps + 1, 1))
    np.savetxt(path, rows, delimiter=",", header=",".join(found.signals), comments="")


def machines(folder: Path) -> None:
    """What two machines have, each a half of a study, and two folders to compare."""
    for name, methods in {"machine-a/results": "funnel", "machine-b/results": "raw"}.items():
        _ran(folder / name, methods)
    for name in ("results-before", "results-after", "study"):
        shutil.copytree(folder / "machine-a/results", folder / name)


def bundles(folder: Path, theirs: str = "ten") -> None:
    """Bundles: of ten seeds or, as `theirs` may be, of cells that are in `results` too."""
    _ran(folder / "ten", "funnel", "--seeds", "10-14")
    _ran(folder / "other", "funnel")
    for name, of in {"mine": "ten", "submission": "ten", "theirs": theirs}.items():
        words = ["bundle", of, f"{name}.zip", "--author", "Ada Lovelace", "--title", name]
        assert stlbench(words).exit_code == 0


def reference(folder: Path) -> None:
    """A file of a study and a gate's reference, small ones, and traces to monitor."""
    own_task(folder)
    (folder / "studies").mkdir()
    (folder / "studies/reference.yaml").write_text(STUDY)
    gated = ["gate", "results/gate-reference", "--update", "--tasks", "hold-disc", "--methods", "funnel"]
    assert stlbench([*gated, "--results", "results/gate"]).exit_code == 0
    traces(folder / "trace.csv", "hold-disc")
    (folder / "requirements.txt").write_text("# one per line\nG[0,2] x <= 3\n")
    stored_traces = next((folder / "results/traces").glob("hold-disc*.npz"))
    (folder / "recorded").mkdir(exist_ok=True)  # beside the results: `verify` names files that no cell has
    shutil.copy(stored_traces, folder / "recorded/CELL.npz")


def _ran(folder: Path, methods: str, *words: str) -> None:
    done = stlbench(["run", "--tasks", "hold-disc", "--methods", methods, "--results", str(folder), *words])
    assert done.exit_code == 0, done.output
