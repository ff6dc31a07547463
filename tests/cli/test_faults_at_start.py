"""What ends a command or prints before it does anything: plugins while they are imported, and broken installations."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import line_task

from stlbench.registry import plugins

FATAL = """
import os
from stlbench.contract import RewardMethod
if os.environ.get("ZZ_PRINT"):
    print("hello from the import")
    os.system("echo hello from a program")
else:
    os._exit(0)
class Raw(RewardMethod):
    scale = 1.0
"""


def test_a_plugin_that_ends_the_process_while_it_is_imported_is_named(toy, site, say, monkeypatch):
    site("bad-plugins", "[stlbench.methods]\nbad-exit = bad_exit:Raw\n", {"bad_exit.py": FATAL})
    done = say("run", "--tasks", "toy-line", "--agents", "toy-agent", "--methods", "bad-exit")
    assert done.exit_code == 2
    said = "error: method 'bad-exit' of bad-plugins 1.2 (bad_exit:Raw): SystemExit: it called os._exit(0)\n"
    assert done.stderr == said
    assert not Path("results/ledger.sqlite").exists()


def test_what_is_printed_at_import_is_not_in_the_json(toy, site, tmp_path):
    site("bad-plugins", "[stlbench.methods]\nbad-exit = bad_exit:Raw\n", {"bad_exit.py": FATAL})
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "ZZ_PRINT": "1"}
    words = [sys.executable, "-c", "from stlbench.cli import main; main()", "list", "methods", "--json"]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert any(each["name"] == "toy-raw" for each in json.loads(done.stdout))
    assert "hello from the import" in done.stderr
    assert "hello from a program" in done.stderr


def test_a_task_that_ends_the_process_while_it_is_made_is_named(say, tmp_path):
    folder = tmp_path / "zz-exits"
    folder.mkdir()
    (folder / "task.yaml").write_text(line_task.text())
    lines = line_task.SYSTEM.replace("class Line(System):", "class Line(System):\n    def __init__(self, dt): quit(0)")
    (folder / "system.py").write_text(f"from sys import exit as quit\n{lines}")
    done = say("run", "--tasks", folder, "--methods", "raw", "--seeds", 1, "--budget", "smoke")
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: {folder}/system.py, line 5, ended the command: SystemExit: 0")
    plugins._ADDED["tasks"].pop("zz-exits")


@pytest.mark.parametrize("command", ["list methods --json", "--help"])
def test_a_closed_stdout_is_no_traceback(command):
    words = f"exec {sys.executable} -c 'from stlbench.cli import main; main()' {command} >&-"
    done = subprocess.run(["sh", "-c", words], stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "content", [pytest.param(b"[x]\nfoo\n", marks=pytest.mark.slow), b"[stlbench.methods]\n\xff\xfe = = x"]
)
def test_a_broken_distribution_is_named(tmp_path, content):
    place = tmp_path / "zz_broken-1.0.dist-info"
    place.mkdir()
    (place / "METADATA").write_text("Metadata-Version: 2.1\nName: zz-broken\nVersion: 1.0\n")
    (place / "entry_points.txt").write_bytes(content)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    words = [sys.executable, "-c", "from stlbench.cli import main; main()", "run", "--methods", "raw"]
    done = subprocess.run(words, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    last = done.stderr.splitlines()[-1]
    assert last.startswith("error: an installed distribution cannot be read; install it again, or remove it: ")
    assert str(place) in last
    assert "Traceback" not in done.stderr
