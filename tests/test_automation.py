"""What runs outside of this suite: workflows, hooks, the release. Read here, and checked against each other."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import stlbench

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def read(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_have_few_rights_and_an_end(path: Path) -> None:
    workflow = read(path)
    assert workflow["permissions"] == {"contents": "read"}
    for name, job in workflow["jobs"].items():
        assert job["timeout-minutes"] <= 60, name
        assert set(job.get("needs", "").split()) <= set(workflow["jobs"])


def test_the_versions_of_python_are_the_same_everywhere() -> None:
    said = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]
    assert read(ROOT / ".github" / "workflows" / "ci.yml")["jobs"]["test"]["strategy"]["matrix"]["python"] == said
    assert PROJECT["requires-python"] == f">={said[0]}"


def test_only_the_job_that_publishes_may_sign_in() -> None:
    jobs = read(ROOT / ".github" / "workflows" / "release.yml")["jobs"]
    assert {name for name, job in jobs.items() if "id-token" in job.get("permissions", {})} == {"publish"}
    assert "secrets." not in (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")


def test_one_version() -> None:
    assert read(ROOT / "CITATION.cff")["version"] == stlbench.__version__
    assert stlbench.__version__ in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_what_is_installed_is_pinned() -> None:
    """Each name of pyproject.toml has its tested version in constraints.txt."""
    wanted = [
        *PROJECT["dependencies"],
        *(item for extra in PROJECT["optional-dependencies"].values() for item in extra),
    ]
    names = {re.split(r"[\[<>=;]", item)[0] for item in wanted} - {PROJECT["name"]}
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {_plain(line.partition("==")[0]) for line in pins if "==" in line and not line.startswith("#")}
    assert {name for name in names if _plain(name) not in pinned} == set()


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
