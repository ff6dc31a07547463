"""The JSON schemas accept what stlbench accepts, and refuse wrong keys and kinds of values."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.study.study import json_schema

jsonschema = pytest.importorskip("jsonschema")
ROOT = Path(__file__).parents[2]
TASKS = sorted([*ROOT.glob("tasks/*/*/task.yaml"), *ROOT.glob("examples/*/task.yaml")])
STUDIES = sorted((ROOT / "studies").glob("*.yaml"))


def content(path: Path) -> dict[str, Any]:
    """Of a file, and of the `by_hand.yaml` beside a task file."""
    files = [file for file in (path, path.with_name("by_hand.yaml")) if file.is_file()]
    return {key: value for file in files for key, value in yaml.safe_load(file.read_text(encoding="utf-8")).items()}


TASK = content(ROOT / "tasks/stlbench_tasks/overlap/task.yaml")


SCHEMAS = {kind: json_schema(kind) for kind in ("task", "study")}


@pytest.mark.parametrize(("kind", "paths"), [("task", TASKS), ("study", STUDIES)])
def test_every_file_of_the_repository_is_right(kind: str, paths: list[Path]) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMAS[kind])
    for path in paths:
        jsonschema.validate(content(path), SCHEMAS[kind])


@pytest.mark.parametrize("path", [*(ROOT / "examples").glob("*/task.yaml"), *STUDIES], ids=lambda path: path.name)
def test_editors_find_the_schema_of_examples_and_studies(path: Path) -> None:
    """`stlbench show schema study > studies/study.schema.json`, and task to examples/, write what is compared here."""
    (hint,) = (line for line in path.read_text(encoding="utf-8").splitlines() if "yaml-language-server" in line)
    schema = path.parent / hint.removeprefix("# yaml-language-server: $schema=")
    kind = "study" if path in STUDIES else "task"
    assert json.loads(schema.read_text(encoding="utf-8")) == json_schema(kind)


@pytest.mark.parametrize(
    ("kind", "wrong"),
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
def test_what_is_wrong_is_refused(kind: Any, wrong: Any) -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(wrong, SCHEMAS[kind])


def test_the_command_prints_it_with_descriptions_and_a_study_may_be_empty() -> None:
    schema = json.loads(CliRunner().invoke(app, ["show", "schema", "task"]).stdout)
    assert schema == SCHEMAS["task"]
    assert schema["properties"]["sampling_time"]["description"] == "Seconds a step."
    jsonschema.validate({}, SCHEMAS["study"])
