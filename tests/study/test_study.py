"""A study's description: from Python values, from the words of the command line, from a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.study.study import Shard, Study, parse_seeds


def test_python_values_and_texts_say_the_same():
    words = Study.of({"tasks": "overlap, hold-disc", "methods": "funnel[ginf=0.02,variant=code]", "seeds": "3"})
    said = {"tasks": ["overlap", Choice("hold-disc")], "methods": ("funnel[variant=code,ginf=0.02]",)}
    values = Study.of({**said, "seeds": range(3)})
    assert words == values
    assert words.seeds == (0, 1, 2)
    assert words.methods == (Choice("funnel", (("ginf", "0.02"), ("variant", "code"))),)


@pytest.mark.parametrize(
    ("seeds", "read"),
    [(2, (0, 1)), ("2", (0, 1)), ([2], (2,)), ("7, 0-2,1", (0, 1, 2, 7)), ([7, 3], (3, 7)), (None, None)],
)
def test_a_lone_number_is_a_count_and_a_list_is_what_it_says(seeds, read):
    assert Study.of({"tasks": "a", "methods": "b", "seeds": seeds}).seeds == read


@pytest.mark.parametrize("text", ["", "0", "3-1", "1,,2", "0-99999", "123456"])
def test_seeds_that_mean_nothing(text):
    with pytest.raises(UsageError, match="seed"):
        parse_seeds(text)


def test_what_is_left_out():
    study = Study.of({"tasks": "a", "methods": "b"})
    assert (study.agents, study.budget, study.jobs, study.retry) == (None, "quick", None, ())
    assert (study.results, study.executor) == (Path("results"), Choice("local"))


@pytest.fixture(scope="module")
def planned():
    """Two tasks, four methods and five seeds."""
    return Study.of({"tasks": "hold-disc,overlap", "methods": "funnel,flag,raw,tltl", "seeds": "5"}).cells()


@pytest.mark.parametrize("count", [1, 4, 7, 60])
def test_shards_are_equal_parts_of_the_plan(planned, count):
    parts = [Shard(number, count).of(planned) for number in range(1, count + 1)]
    assert sorted(cell.id for part in parts for cell in part) == sorted(cell.id for cell in planned)
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    assert all([cell for cell in planned if cell in part] == list(part) for part in parts)
    assert [Shard(number, count).of(planned[::-1])[::-1] for number in range(1, count + 1)] == parts


def test_no_shard_gets_one_method_alone(planned):
    """Four methods, in four shards: an order of the plan would give each shard one."""
    assert all(len({cell.id.method for cell in Shard(number, 4).of(planned)}) >= 3 for number in (1, 2, 3, 4))


def test_a_shard_has_a_folder_of_its_own():
    study = Study.of({"tasks": "hold-disc", "methods": "raw,flag", "seeds": 2, "shard": " 2/3", "results": "here"})
    assert (study.folder, study.results) == (Path("here/shard-2-of-3"), Path("here"))
    assert study.cells() == Shard(2, 3).of(Study.of({"shard": None}, study).cells())


@pytest.mark.parametrize("text", ["0/4", "5/4", "3", "3/", "1/0", "-1/4", "1/4/2", "a/b", 3, "1.5/4", "²/4"])
def test_shards_that_mean_nothing(text):
    with pytest.raises(UsageError, match=r"^shard: K/N is expected, as in 3/40, with K from 1 to N, got "):
        Study.of({"tasks": "a", "methods": "b", "shard": text})


@pytest.mark.parametrize("shard", [Shard(0, 2), Shard(5, 2), Shard(1, 0), Shard(-1, 2)])
def test_a_shard_in_python_is_checked_too(shard):
    with pytest.raises(UsageError, match=r"^shard: K/N is expected, as in 3/40, with K from 1 to N, got Shard\("):
        Study.of({"tasks": "a", "methods": "b", "shard": shard})
    assert Study.of({"tasks": "a", "methods": "b", "shard": Shard(2, 2)}).shard == Shard(2, 2)


def test_options_go_before_the_file(tmp_path):
    file = tmp_path / "study.yaml"
    file.write_text('tasks: [hold-disc]\nmethods: ["funnel[ginf=0.02]", flag]\nseeds: 5\nresults: here\n')
    study = Study.of({"seeds": [7], "budget": "smoke"}, file)
    assert (study.seeds, study.budget, study.results) == ((7,), "smoke", Path("here"))
    assert [str(method) for method in study.methods] == ["funnel[ginf=0.02]", "flag"]
    assert Study.of({"seeds": 1}, study) == Study.of({"seeds": 1, "budget": "smoke"}, file)


def test_all_errors_at_once(tmp_path):
    file = tmp_path / "study.yaml"
    file.write_text("tasks: [A B]\nmethds: funnel\nseeds: [-1]\njobs: 0\nretry: maybe\n")
    with pytest.raises(UsageError) as caught:
        Study.of({}, file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    for part in (
        "tasks: 'A B': a name consists of",
        "methods must be given",
        "no key 'methds'; did you mean 'methods'?",
        "seeds: a count, as in 3, or seeds below 10000",
        "jobs: should be at least 1",
        "retry: no failure 'maybe'; there are: failed, killed, raised, timeout",
    ):
        assert part in message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2", "is no YAML: while parsing"),
        ("- hold-disc\n", "a study has keys such as tasks and methods, got ['hold-disc']"),
        ("", "a study has keys such as tasks and methods, got None"),
        ("tasks: !!python/object/apply:os.system [ls]\n", "is no YAML: could not determine a constructor"),
        ("tasks: a\nseeds: 2\ntasks: b\n", "study.yaml has the key 'tasks' in line 1 and again in line 3"),
        ("- " * 5000, "nests too deep"),
        ("tasks: []\nmethods: 3\n", "tasks: should not be empty"),
        ("methods: {raw: 1}\n", "methods: a name or a list of names is expected, got {'raw': 1}"),
        ("tasks: {a: 1}\n", "tasks: a name or a list of names is expected, got {'a': 1}"),
        ("seeds: {1: 2}\n", "seeds: a count, as in 3, or seeds below 10000, as in [3, 7], are expected, got {1: 2}"),
        ("executor: {name: local}\n", "executor: a name is expected, got {'name': 'local'}"),
        ("retry: {raised: 1}\n", "retry: no failure '{'raised': 1}'"),
        ("results: [1]\nkeep_old: 7\n", "results: should be a path; keep_old: should be true or false"),
        ("tasks: hold_disc\n", "tasks: 'hold_disc': a name consists of a-z, 0-9 and -; did you mean 'hold-disc'?"),
    ],
)
def test_a_file_that_is_no_study(tmp_path, text, message):
    (tmp_path / "study.yaml").write_text(text)
    with pytest.raises(UsageError) as caught:
        Study.of({}, tmp_path / "study.yaml")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


NOT_THERE = "cannot read the study {}: No such file or directory"
LIST = "several stand in a list with commas, without spaces"
NAME = "a name consists of a-z, 0-9 and -"
NO_FILE = f"{NOT_THERE}; a study is a YAML file; did you mean `{{}}`? {LIST}"


@pytest.mark.parametrize(
    ("words", "file", "said"),
    [
        ({}, "there-is-none.yaml", NOT_THERE.format("there-is-none.yaml")),
        ({}, "hold_disc", NO_FILE.format("hold_disc", "--tasks hold-disc")),
        ({}, "funnel[ginf=0.1]", NO_FILE.format("funnel[ginf=0.1]", "--methods funnel[ginf=0.1]")),
        ({}, None, "tasks must be given; methods must be given"),
        # as Python reads bytes that are no UTF-8 from the command line
        ({"tasks": "\udcff", "methods": "raw"}, None, f"'\\udcff': {NAME}, as in funnel or tau-mdp"),
    ],
)
def test_what_is_no_study_at_all(words: dict[str, str], file: str | None, said: str) -> None:
    with pytest.raises(UsageError) as caught:
        Study.of(words, file)
    assert str(caught.value) == said


STUDIES = sorted((Path(__file__).parents[2] / "studies").glob("*.yaml"))


@pytest.mark.parametrize("file", [STUDIES[0], *(pytest.param(file, marks=pytest.mark.slow) for file in STUDIES[1:])])
def test_the_committed_studies_are_studies(file):
    assert Study.of({}, file).cells()
