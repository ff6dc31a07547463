"""The Dockerfile, the development container and the workflows agree with pyproject.toml."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")
PYTHONS = {each.rpartition(" ")[2] for each in PYPROJECT["project"]["classifiers"] if "Python :: 3." in each}


def test_the_image_copies_all_that_the_wheel_is_built_from() -> None:
    copied = [source for line in re.findall(r"^COPY (.*) \S+$", DOCKERFILE, re.MULTILINE) for source in line.split()]
    assert all((ROOT / source).exists() for source in copied)
    project = PYPROJECT["project"]
    needed = [*PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"], project["readme"]]
    for path in [*needed, *project["license-files"], "pyproject.toml", "constraints.txt"]:
        assert path.split("/")[0] in copied, f"{path} is missing in the Dockerfile"


def test_the_containers_have_a_supported_python() -> None:
    container = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text(encoding="utf-8"))
    for text in (DOCKERFILE, container["image"]):
        assert set(re.findall(r"python:(3\.\d+)", text)) <= PYTHONS


def test_the_workflow_builds_extras_that_exist() -> None:
    extras = _workflow("container")["jobs"]["build"]["strategy"]["matrix"]["extras"]
    assert set(extras) - {""} <= set(PYPROJECT["project"]["optional-dependencies"])


def test_ci_and_the_nightly_installation_run_on_each_supported_python() -> None:
    for name, job in (("ci", "test"), ("nightly", "install")):
        assert set(_workflow(name)["jobs"][job]["strategy"]["matrix"]["python"]) == PYTHONS


def _workflow(name: str) -> dict:
    return yaml.safe_load((ROOT / ".github" / "workflows" / f"{name}.yml").read_text(encoding="utf-8"))
