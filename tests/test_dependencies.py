"""What the package imports is what it declares: the core has no more than its dependencies, and needs all of them."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]
KINDS = ("agents", "executors", "logs", "methods", "planning")
PACKAGES = ("stlbench", *(f"plugins/stlbench_{kind}" for kind in KINDS))
EXTRAS = ("torch", "stable_baselines3", "mujoco", "dm_control", "gymnasium_robotics", "pettingzoo", "optuna")
EXTRAS += ("Box2D", "highway_env", "onnx", "onnxruntime", "jinja2", "dask", "distributed")
EXTRAS += ("tensorboardX", "wandb", "shimmy", "mpe2")
OWN = {"stlbench", "stlbench_tasks", *(f"stlbench_{kind}" for kind in KINDS)}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def declared(requirements: list[str]) -> set[str]:
    return {_plain(re.split(r"[\[<>=;]", item)[0]) for item in requirements}


def imported() -> Iterator[str]:
    """The top-level packages that any module of ours imports, also within functions."""
    for folder in (*PACKAGES, "tasks/stlbench_tasks"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    yield from (alias.name.partition(".")[0] for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                    yield node.module.partition(".")[0]


def test_all_that_is_imported_is_declared_and_all_that_is_declared_is_imported() -> None:
    extras = PROJECT["optional-dependencies"]
    names = ("sb3", "mujoco", "multi", "onnx", "tune", "field", "page", "dask", "tensorboard", "wandb")
    names += ("dm", "minari", "parquet", "petting")
    chosen = (extras[name] for name in names)
    wanted = declared([*PROJECT["dependencies"], *(line for extra in chosen for line in extra)])
    providers = packages_distributions()
    third = {name for name in imported() if name not in sys.stdlib_module_names and name not in OWN}
    providers.setdefault("wandb", ["wandb"])  # which need not be installed
    needed = {_plain(distribution) for name in third for distribution in providers[name]}
    models = {"dm-control", "gymnasium-robotics"}  # of these the models are read, and nothing is imported
    models |= {"box2d", "highway-env", "pygame-ce"}  # Gymnasium imports them to make an environment
    models |= {"pyarrow"}  # pandas imports it to write a table
    models |= {"shimmy", "mpe2"}  # tasks of users name them
    assert (needed - {"pydantic-core"}) | models == wanted  # pydantic-core is a part of pydantic


def test_without_an_extra_every_plugin_can_be_listed() -> None:
    program = f"import sys\nsys.modules |= dict.fromkeys({EXTRAS})\nfrom stlbench.registry import plugins\n"
    program += "print([problem for kind in plugins.KINDS for problem in plugins.loadable(kind)[1]])"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ran.stdout == "[]\n"


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
