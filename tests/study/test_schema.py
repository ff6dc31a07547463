"""The JSON schemas accept what stlbench accepts, and refuse wrong keys and kinds of values."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from stlbench.study.schema import json_schema

jsonschema = pytest.importorskip("jsonschema")
ROOT = Path(__file__).parents[2]
TASKS = sorted([*ROOT.glob("tasks/*/*/task.yaml"), *ROOT.glob("examples/*/task.yaml")])
STUDIES = sorted((ROOT / "studies").glob("*.yaml"))
TASK: dict[str, Any] = yaml.safe_load((ROOT / "tasks/stlbench_tasks/overlap/task.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", [*TASKS, *STUDIES], ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_file_of_the_repository_is_right(path: Path) -> None:
    schema = json_schema("study" if path in STUDIES else "task")
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(yaml.safe_load(path.read_text(encoding="utf-8")), schema)


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("task", TASK | {"formulas": "x >= 1"}),
        ("task", TASK | {"steps": "many"}),
        ("task", TASK | {"formula": 3}),
        ("task", TASK | {"initial": {"box": {"x": [0, 1, 2]}}}),
        ("task", {name: value for name, value in TASK.items() if name != "formula"}),
        ("study", {"task": "reach-stay"}),
        ("study", {"tasks": {"reach-stay": 1}}),
        ("study", {"seeds": [-1]}),
    ],
)
def test_what_is_wrong_is_refused(kind: Any, content: Any) -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content, json_schema(kind))


def test_a_study_may_leave_everything_to_the_command_line() -> None:
    jsonschema.validate({}, json_schema("study"))


def test_the_command_prints_it_with_descriptions() -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "stlbench", "show", "schema", "task"], capture_output=True, text=True, check=True
    )
    schema = json.loads(ran.stdout)
    assert schema == json_schema("task")
    assert schema["properties"]["sampling_time"]["description"] == "Seconds a step."
