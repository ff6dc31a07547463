"""Folders of tasks from a stranger, each of which would have code imported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from helpers import line_task

EVIL = "zz_evil"
"""The module that none of them may import. `plant` writes it; it leaves a mark."""
MARK = "marker"

ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "a module of PettingZoo": {"id": EVIL, "api": "pettingzoo"},
    "a module before an id": {"id": f"{EVIL}:Mine-v0"},
    "a module before a known id": {"id": f"{EVIL}:CartPole-v1"},
    "a module by a path in a package": {"id": f"{EVIL}.inner", "api": "pettingzoo"},
    "a class as an argument": {"id": "CartPole-v1", "kwargs": {"config": {"type": f"{EVIL}.Car"}}},
    "a class in a list": {"id": "CartPole-v1", "kwargs": {"vehicles": [1, [f"{EVIL}.Car"]]}},
    "a module as an argument": {"id": "GymV26Environment-v0", "kwargs": {"env_id": f"{EVIL}:Mine-v0"}},
    "a task as an argument": {"id": "stlbench/hold-disc-v0", "kwargs": {"task": f"./{EVIL}", "method": "raw"}},
    "bytes as an argument": {"id": "CartPole-v1", "kwargs": {"module": EVIL.encode()}},
    "a class for films": {"id": "CartPole-v1", "drawn": {"camera": f"{EVIL}.Camera"}},
}
"""What it is -> the entry `environment` of the task file."""
FILES = {"a system": "system.py", "a system in capitals": "system.PY", "another file": "helper.py"}
"""What it is -> a file with code beside the task file."""
KINDS = (*ENVIRONMENTS, *FILES)


def task_file(environment: dict[str, Any] | None) -> str:
    """That of a task on CartPole, or of a system."""
    if environment is None:
        return line_task.text()
    names = {"names": ["x", "v", "theta", "omega"]}
    return line_task.text(environment=environment | names, actions=None, initial=None)


def plant(home: Path, kind: str, here: Path) -> None:
    """Write the folder of such a task, and the module that it names into the folder `here`."""
    home.mkdir(parents=True, exist_ok=True)
    mark = f"import pathlib\npathlib.Path({str(here / MARK)!r}).touch()\n"
    (here / EVIL).mkdir(exist_ok=True)
    for name in ("__init__.py", "inner.py"):
        (here / EVIL / name).write_text(mark)
    (home / "task.yaml").write_text(task_file(ENVIRONMENTS.get(kind)))
    if kind in FILES:
        (home / FILES[kind]).write_text(mark + line_task.SYSTEM)


def asks(home: Path) -> dict[str, Any]:
    """The content of its task file."""
    content: dict[str, Any] = yaml.safe_load((home / "task.yaml").read_text())
    return content
