"""plugins/example as a third party would ship it: two wheels in a fresh environment, found and run. No network.

torch and the other dependencies are not installed again: a .pth file shows the fresh environment those of this one.
Python does not follow .pth files of a folder that it came to by a .pth file, so an editable stlbench there stays
invisible, and what is tested is the wheel.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "plugins" / "example"


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Distribution -> its wheel, built from this tree."""
    folder = tmp_path_factory.mktemp("wheels")
    offline = ("--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check")
    _run(sys.executable, "-m", "pip", "wheel", *offline, "--wheel-dir", str(folder), str(ROOT), str(EXAMPLE))
    return {path.name.partition("-")[0]: path for path in folder.glob("*.whl")}


@pytest.fixture(scope="module")
def fresh(wheels: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual environment with the two wheels, and with this environment's packages behind them."""
    folder = tmp_path_factory.mktemp("fresh")
    venv.create(folder, symlinks=True, with_pip=False)
    pip = (sys.executable, "-m", "pip", "--python", str(folder), "--disable-pip-version-check")
    _run(*pip, "install", "--no-deps", "--no-index", *map(str, wheels.values()))
    (site,) = folder.glob("lib/python*/site-packages")
    behind = [path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")]
    (site / "behind.pth").write_text("\n".join(behind) + "\n", encoding="utf-8")
    return folder


def test_the_wheel_holds_the_task_files_and_no_tests(wheels: dict[str, Path]) -> None:
    names = zipfile.ZipFile(wheels["stlbench_rl"]).namelist()
    for file in ("task.yaml", "by_hand.yaml"):
        tasks = sorted(path.parent.name for path in (ROOT / "tasks" / "stlbench_tasks").glob(f"*/{file}"))
        assert sorted(name.split("/")[1] for name in names if name.endswith(f"/{file}")) == tasks
    templates = [path.name for path in (ROOT / "stlbench/cli/templates").iterdir()]
    assert sorted(name.split("/")[-1] for name in names if "/cli/templates/" in name) == sorted(templates)
    assert [name for name in names if "test_" in name or "conftest" in name] == []
    tops = {name.partition("/")[0] for name in names if ".dist-info/" not in name}
    kinds = ("agents", "executors", "logs", "methods", "planning", "tasks")
    plugins = {f"stlbench_{kind}" for kind in kinds}
    assert tops == {"stlbench", *plugins}
    assert any(name.endswith("/licenses/LICENSE") for name in names)


def test_it_is_the_wheel_that_is_imported(fresh: Path) -> None:
    code = "import stlbench, stlbench_methods, stlbench_example as e; print(stlbench.__file__, e.__file__, sep='\\n')"
    for file in _run(fresh / "bin" / "python", "-c", code, cwd=fresh).splitlines():
        assert Path(file).is_relative_to(fresh)


def test_it_is_listed_with_its_distribution(fresh: Path) -> None:
    listed = json.loads(_run(fresh / "bin" / "stlbench", "list", "methods", "--json", cwd=fresh))
    origins = {entry["name"]: entry["distribution"] for entry in listed}
    assert origins["verdict"] == "stlbench-example"
    assert origins["funnel"] == "stlbench-rl"
    shown = _run(fresh / "bin" / "stlbench", "list", "methods", cwd=fresh)
    assert re.search(r"^verdict +stlbench-example 0\.1\.0 ", shown, re.MULTILINE)


def test_a_smoke_cell_of_it(fresh: Path, tmp_path: Path) -> None:
    options = ("--methods", "verdict", "--tasks", "hold-disc", "--budget", "smoke", "--seeds", "1", "--jobs", "1")
    _run(fresh / "bin" / "stlbench", "run", *options, "--results", str(tmp_path / "results"), cwd=tmp_path)
    found = json.loads(_run(fresh / "bin" / "stlbench", "report", "--json", str(tmp_path / "results"), cwd=tmp_path))
    (cell,) = found["cells"]
    assert (cell["task"], cell["method"], cell["seed"], cell["status"]) == ("hold-disc", "verdict", 0, "done")
    assert cell["inputs_added"] == 1
    assert 0 <= cell["satisfaction"] <= 1
    assert -1.83 < cell["robustness_mean"] < 0.38  # the square's corner; the best that the starts allow


def test_its_own_tests_pass(fresh: Path) -> None:
    _run(fresh / "bin" / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", str(EXAMPLE), cwd=fresh)


def _run(*command: str | Path, cwd: Path | None = None) -> str:
    """The command's output. No path of this environment leaks into it by a variable."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "PYTEST"))}
    environment |= {"PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1", "COLUMNS": "160"}
    found = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300)
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout
