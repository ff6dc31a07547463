"""The scripts of the GitHub action and the GitLab template, run here as far as that goes without a server."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
ACTION = ROOT / ".github" / "actions" / "gate"
GITLAB = yaml.safe_load((ROOT / ".gitlab" / "gate.yml").read_text(encoding="utf-8"))["stlbench-gate"]


@pytest.fixture
def command(tmp_path, monkeypatch):
    """A command of this name that notes its words, one line per call, and ends as told."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")

    def make(name: str, script: str) -> Path:
        calls = tmp_path / f"{name}.calls"
        path = tmp_path / "bin" / name
        path.write_text(f'#!/usr/bin/env bash\nprintf "%s|" "$@" >> {calls}\necho >> {calls}\n{script}\n')
        path.chmod(0o755)
        return calls

    return make


def bash(script: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    words, known = ["bash", str(script)], os.environ | environment
    return subprocess.run(words, env=known, capture_output=True, text=True, check=False, timeout=60)


def gate(tmp_path: Path, **changed: str) -> subprocess.CompletedProcess[str]:
    files = {name: str(tmp_path / name) for name in ("GITHUB_OUTPUT", "GITHUB_STEP_SUMMARY")}
    inputs = {"STLBENCH": "stlbench", "REFERENCE": "a reference", "AGAINST": "", "BUDGET": "smoke", "OPTIONS": ""}
    inputs |= {"RESULTS": "out"}
    return bash(ACTION / "gate.sh", **files, **(inputs | changed))


@pytest.mark.parametrize(
    ("code", "verdict", "ends"),
    [(0, "no worse", 0), (1, "worse", 1), (3, "cannot tell", 0), (4, "missing", 4), (2, "none", 2), (130, "none", 130)],
)
def test_each_exit_code_of_the_gate_is_told_to_github(command, tmp_path, code, verdict, ends) -> None:
    calls = command("stlbench", f"mkdir -p out; echo '# said' > out/gate.md; exit {code}")
    done = gate(tmp_path)
    assert done.returncode == ends
    assert calls.read_text() == "gate|a reference|--budget|smoke|--results|out|\n"
    assert (tmp_path / "GITHUB_OUTPUT").read_text() == f"verdict={verdict}\n"
    assert (tmp_path / "GITHUB_STEP_SUMMARY").exists() == (verdict != "none")
    assert ("::warning::" in done.stdout) == (code == 3)


def test_options_are_words_and_never_code(command, tmp_path) -> None:
    calls = command("stlbench", "exit 0")
    done = gate(tmp_path, OPTIONS="--jobs 2 $(touch hacked) ; touch hacked")
    assert done.returncode == 0
    assert calls.read_text().endswith("out|--jobs|2|$(touch|hacked)|;|touch|hacked|\n")
    assert not (tmp_path / "hacked").exists()


def test_costs_are_compared_with_the_base_of_a_pull_request(command, tmp_path) -> None:
    inputs = yaml.safe_load((ACTION / "action.yml").read_text(encoding="utf-8"))["inputs"]
    assert inputs["against"]["default"] == "${{ github.event.pull_request.base.sha }}"
    calls = command("stlbench", "exit 0")
    assert gate(tmp_path, AGAINST="abc $(touch hacked)", OPTIONS="--seeds 3").returncode == 0
    assert calls.read_text().endswith("out|--seeds|3|--against|abc $(touch hacked)|\n")
    assert not (tmp_path / "hacked").exists()


def test_the_jobs_that_use_the_action_have_the_history_of_the_base() -> None:
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))["jobs"]
    every = [job["steps"] for job in jobs.values()]
    uses = [steps for steps in every if any("actions/gate" in step.get("uses", "") for step in steps)]
    assert uses
    assert all(any(step.get("with", {}).get("fetch-depth") == 0 for step in steps) for steps in uses)


COMMENT = {"GITHUB_REPOSITORY": "one/two", "NUMBER": "7", "RESULTS": "out"}


@pytest.mark.parametrize(("found", "asked"), [("", "--method|POST|repos/one/two/issues/7/comments"), ("11\n12", "11")])
def test_a_comment_is_written_once_and_then_replaced(command, tmp_path, found, asked) -> None:
    calls = command("gh", f'[ "$2" = --paginate ] && printf "{found}"; exit 0')
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "comment.md").write_text("<!-- stlbench gate -->\n# text\n")
    assert bash(ACTION / "comment.sh", **COMMENT).returncode == 0
    wanted = asked if "|" in asked else f"--method|PATCH|repos/one/two/issues/comments/{asked}"
    assert calls.read_text().splitlines()[-1] == f"api|{wanted}|--field|body=@out/comment.md|"


def test_without_a_verdict_there_is_no_comment(command) -> None:
    calls = command("gh", "exit 1")
    done = bash(ACTION / "comment.sh", **COMMENT)
    assert (done.returncode, done.stdout) == (0, "nothing to say: out/comment.md is not there\n")
    assert not calls.exists()


def test_the_action_gives_its_scripts_every_variable_they_read() -> None:
    steps = yaml.safe_load((ACTION / "action.yml").read_text(encoding="utf-8"))["runs"]["steps"]
    for step in steps:
        script = step["run"].partition("$GITHUB_ACTION_PATH/")[2].strip('"')
        text = (ACTION / script).read_text(encoding="utf-8")
        assert all(f"${name}" in text for name in step["env"] if name != "GH_TOKEN")
        assert "${{" not in step["run"] + text


def test_the_gitlab_job_does_what_the_action_does(command, tmp_path) -> None:
    calls = command("stlbench", "exit 3")
    script = tmp_path / "script.sh"
    script.write_text("\n".join(GITLAB["script"]))
    for base in ("", "abc"):
        done = bash(script, CI_MERGE_REQUEST_DIFF_BASE_SHA=base, **GITLAB["variables"])
        assert done.returncode in GITLAB["allow_failure"]["exit_codes"]
    plain = "gate|results/gate-reference|--budget|smoke|--results|results/gate|"
    assert calls.read_text().splitlines() == [plain, f"{plain}--against|abc|"]
    assert GITLAB["variables"]["GIT_DEPTH"] == "0"
    assert GITLAB["artifacts"]["reports"]["junit"] == "results/gate/gate.xml"
