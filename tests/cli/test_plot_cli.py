"""`stlbench plot` and `stlbench render`, on made-up plugins, from the words to the files."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from helpers.refusals import refused
from PIL import Image

RUN = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--executor", "toy-here", "--methods")
CELL = "toy-line/toy-raw/toy-agent/0"


@pytest.fixture
def run(say, toy):
    """Say `run` with these methods."""
    return lambda methods: say(*RUN, methods)


def test_plot_prints_the_files_it_wrote(run, say):
    run("toy-raw,toy-large")
    done = say("plot", "results", "--out", "pictures")
    assert done.exit_code == 0
    kinds = ("time", "trajectories")
    names = ["learning-toy-line", *(f"{kind}-toy-line-toy-raw-toy-agent-quick" for kind in kinds)]
    written = [f"pictures/{name}.{end}" for name in names for end in ("png", "svg", "pdf")]
    assert done.stdout.splitlines() == written
    assert {str(path) for path in Path("pictures").iterdir()} == set(written)
    assert done.stderr.splitlines() == [
        "[1/2] toy-line/toy-large/toy-agent quick: 0 files",
        "[2/2] toy-line/toy-raw/toy-agent quick: 6 files",
    ]


def test_plot_draws_the_rewarded_form_where_it_is_asked_for(run, say, toy):
    task = toy / "toy_plugins/line/task.yaml"
    content = yaml.safe_load(task.read_text())
    task.write_text(yaml.safe_dump(content | {"rewarded": "G[0,4] 2 * x <= 2"}, sort_keys=False))
    run("toy-raw")
    form = {f"pictures/rewarded-toy-line-toy-raw-toy-agent-quick.{end}" for end in ("png", "svg", "pdf")}
    written = {*say("plot", "results", "--out", "pictures", "--rewarded").stdout.splitlines()}
    assert form < written
    assert {*say("plot", "results", "--out", "pictures", "--only", "rewarded").stdout.splitlines()} == form


def test_plot_draws_what_is_asked_for_beside_the_report(run, say):
    run("toy-raw,toy-raw[weight=2]")
    done = say("plot", "results", "--methods", "toy-raw[weight=2]", "--tasks", "toy-line")
    assert done.exit_code == 0
    assert len(done.stdout.splitlines()) == 9
    assert "results/figures/time-toy-line-toy-raw[weight=2]-toy-agent-quick.svg" in done.stdout
    assert "toy-raw-toy-agent" not in done.stdout


def test_bad_input_is_one_line(run, say):
    run("toy-raw,toy-large")
    for words, message in (
        (("plot", "resluts"), "error: there is neither resluts/ledger.sqlite nor cells.jsonl"),
        (("render", "resluts", CELL), "error: there is neither resluts/ledger.sqlite nor cells.jsonl"),
        (("render", "results", "toy-lime/toy-raw/toy-agent/0"), "did you mean 'toy-line/toy-raw/"),
        (("render", "results", "toy-line/toy-large/toy-agent/0"), "has no policy to film: intractable: needs 6003"),
    ):
        assert message in refused(say(*words))


def test_render_writes_a_film_of_the_cell(ran, say, drawn):
    done = say("render", "results", CELL)
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout == "results/films/film-toy-line-toy-raw-toy-agent-0-quick.gif\n"
    with Image.open(done.stdout.strip()) as image:
        assert image.format == "GIF"
        assert image.n_frames > 1


def test_a_cell_whose_traces_are_gone(ran, say):
    for path in Path("results/traces").iterdir():
        path.unlink()
    assert f"error: {CELL} has no traces at results/traces/" in refused(say("render", "results", CELL))
    done = say("plot", "results")
    assert done.exit_code == 0
    told = [line.partition(" has no traces")[0] for line in done.stderr.splitlines()[:2]]
    assert told == [f"warning: toy-line/toy-raw/toy-agent/{seed}" for seed in (0, 1)]


def test_two_budgets_of_one_cell_are_told_apart(ran, say, toy):
    task = toy / "toy_plugins/line/task.yaml"
    quick = "  quick: {steps: 8, seeds: 2, deadline: 60, checkpoints: 2, random_starts: 0}\n"
    task.write_text(task.read_text().replace(quick, quick + quick.replace("quick: {steps: 8", "other: {steps: 16")))
    say(*RUN, "toy-raw", "--budget", "other")
    assert refused(say("render", "results", CELL)).endswith("has the budgets other, quick; say which")
    done = say("render", "results", CELL, "--budget", "other")
    assert done.stdout == "results/films/film-toy-line-toy-raw-toy-agent-0-other.gif\n"
