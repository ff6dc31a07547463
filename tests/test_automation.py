"""What runs outside of this suite: workflows, hooks, the release. Read here, and checked against each other."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.version import Version

import stlbench

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WANTED = [*PROJECT["dependencies"], *(item for extra in PROJECT["optional-dependencies"].values() for item in extra)]


def read(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


AUTOMATED = [*WORKFLOWS, *sorted((ROOT / ".github" / "actions").rglob("action.yml")), ROOT / "docs/howto/share.md"]
USED = re.compile(r"^ *(?:- )?uses: *(?P<action>\S+)(?: +# (?P<version>.+))?$", re.MULTILINE)
OURS = ("./", "OWNER/stlbench/")  # in this repository


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_have_few_rights_and_an_end(path: Path) -> None:
    """A job may do what it says; no job may write into the repository, and one may sign in to the package index."""
    workflow = read(path)
    assert workflow["permissions"] == {}
    for name, job in workflow["jobs"].items():
        assert job["timeout-minutes"] <= 60, name
        assert job["permissions"] in ({}, {"contents": "read"}, {"id-token": "write"}), name
        needs = job.get("needs", [])
        assert set([needs] if isinstance(needs, str) else needs) <= set(workflow["jobs"])


@pytest.mark.parametrize("path", AUTOMATED, ids=lambda path: path.name)
def test_actions_of_others_are_pinned_by_their_commit(path: Path) -> None:
    """A tag can be moved to other code. The version stands beside it, for people and for Dependabot."""
    text = path.read_text(encoding="utf-8")
    used = list(USED.finditer(text))
    assert len(used) == text.count("uses:")
    for each in used:
        if not each["action"].startswith(OURS):
            assert re.fullmatch(r"[\w.-]+/[\w./-]+@[0-9a-f]{40}", each["action"]), each[0]
            assert re.fullmatch(r"v\d+\.\d+\.\d+", each["version"] or ""), each[0]


def test_an_action_has_one_version() -> None:
    pins = {each["action"]: each["version"] for path in AUTOMATED for each in USED.finditer(path.read_text("utf-8"))}
    names = [action.partition("@")[0] for action in pins]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_checkout_keeps_no_credentials(path: Path) -> None:
    """What a job runs afterwards, as tests of a pull request, could read them."""
    steps = [step for job in read(path)["jobs"].values() for step in job["steps"]]
    for step in steps:
        if step.get("uses", "").startswith("actions/checkout@"):
            assert step["with"]["persist-credentials"] is False


def test_the_versions_of_python_are_the_same_everywhere() -> None:
    said = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]
    assert read(ROOT / ".github" / "workflows" / "ci.yml")["jobs"]["test"]["strategy"]["matrix"]["python"] == said
    assert PROJECT["requires-python"] == f">={said[0]}"


def test_only_the_job_that_publishes_may_sign_in() -> None:
    """It runs nothing of ours: it uploads what another job has built, in which nothing but the build's own runs."""
    jobs = read(ROOT / ".github" / "workflows" / "release.yml")["jobs"]
    assert {name for name, job in jobs.items() if "id-token" in job["permissions"]} == {"publish"}
    assert all("run" not in step for step in jobs["publish"]["steps"])
    assert {"test", "build", "wheel"} <= set(jobs["publish"]["needs"])
    commands = [step["run"].split()[0] for step in jobs["build"]["steps"] if "run" in step]
    installed = [step["run"] for step in jobs["build"]["steps"] if "pip install" in step.get("run", "")]
    assert installed == ["python -m pip install -c constraints.txt hatchling"]
    assert "make" not in commands
    uploads = [name for name, job in jobs.items() for step in job["steps"] if "upload-" in step.get("uses", "")]
    assert uploads == ["build"]
    assert "secrets." not in (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")


def test_dependencies_are_audited_every_night_and_when_they_change() -> None:
    workflow = read(ROOT / ".github" / "workflows" / "audit.yml")
    assert [step["run"] for step in workflow["jobs"]["audit"]["steps"] if "run" in step] == ["make audit"]
    begun = workflow[True]  # YAML takes the key `on` for a truth value
    assert begun["schedule"]
    assert {"pyproject.toml", "constraints.txt"} <= set(begun["pull_request"]["paths"])


HOLES = {"distributed": "2026.1.0", "jinja2": "3.1.6", "lxml": "6.1.0", "mkdocs-material": "9.7.7", "onnx": "1.22.0"}
HOLES |= {"pillow": "13.0.0", "playwright": "1.55.1", "pyarrow": "23.0.1", "pytest": "9.0.3", "torch": "2.13.0"}
"""The first versions in which what was known in November 2026 is mended. `make audit` finds what has come since."""


@pytest.mark.parametrize("name", HOLES)
def test_no_lower_bound_has_a_known_hole(name: str) -> None:
    (bound,) = (each.specifier for each in map(Requirement, WANTED) if _plain(each.name) == name)
    (least,) = (each.version for each in bound if each.operator == ">=")
    assert Version(least) >= Version(HOLES[name])


def test_one_version() -> None:
    assert read(ROOT / "CITATION.cff")["version"] == stlbench.__version__
    assert stlbench.__version__ in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_what_is_installed_is_pinned() -> None:
    """Each name of pyproject.toml has its tested version in constraints.txt."""
    names = {re.split(r"[\[<>=;]", item)[0] for item in WANTED} - {PROJECT["name"]}
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {_plain(line.partition("==")[0]) for line in pins if "==" in line and not line.startswith("#")}
    assert {name for name in names if _plain(name) not in pinned} == set()


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
