"""Base against head: the rule on made-up turns, by hand where it is arithmetic, and real runs of two interpreters."""

from __future__ import annotations

import json
import math
import os
import sys
import sysconfig
import venv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest
from benchmarks.versus import Comparison, Judgement, Turn, facts, judge, main, markdown, order, read

from stlbench.gate.judge import EXIT


def turns(*seconds: float, name: str = "a") -> list[Turn]:
    return [Turn({name: each}) for each in seconds]


def together(many: Iterable[Sequence[Turn]]) -> list[Turn]:
    """The benchmarks of several lists of turns in one."""
    return [
        Turn({name: each for turn in same for name, each in turn.seconds.items()}) for same in zip(*many, strict=True)
    ]


def only(judgement: Judgement) -> Comparison:
    (comparison,) = judgement.comparisons
    return comparison


def slower(*losses: float, name: str = "a") -> tuple[list[Turn], list[Turn]]:
    """Base and head with these logarithms of their ratio."""
    return turns(*[0.002] * len(losses), name=name), turns(*(0.002 * math.exp(loss) for loss in losses), name=name)


# ----------------------------------------------------------------------------------------------------------- the rule


def test_both_go_first_equally_often() -> None:
    assert list(order(3)) == ["base", "head", "head", "base", "base", "head"]


def test_twice_the_time_by_hand() -> None:
    two = math.log(2)
    found = only(judge(*slower(*[two - 0.1, two + 0.1] * 3)))
    # Standard deviation 0.1 sqrt(6/5), error of the mean 0.1/sqrt(5) = 0.04472; 5 degrees of freedom, 95 %: 2.015.
    assert found.ratio == pytest.approx(2)
    assert found.high == pytest.approx(2 * math.exp(0.04472 * 2.015), rel=1e-4)
    assert found.base == pytest.approx(0.002)
    assert found.verdict == "worse"
    assert found.turns == 6


@pytest.mark.parametrize(
    ("ratio", "verdict"), [(0.1, "no worse"), (1.0, "no worse"), (1.24, "no worse"), (1.26, "worse"), (5.0, "worse")]
)
def test_where_turns_agree_the_tolerated_ratio_decides(ratio: float, verdict: str) -> None:
    assert only(judge(*slower(*[math.log(ratio)] * 4))).verdict == verdict


def test_a_pair_is_a_turn() -> None:
    base = turns(1.0, 2.0, 4.0, 8.0)
    found = only(judge(base, turns(*(2 * turn.seconds["a"] for turn in base))))
    assert (found.ratio, found.verdict) == (pytest.approx(2), "worse")


def test_scatter_leaves_it_open() -> None:
    assert only(judge(*slower(0.0, 0.9, 0.1, 0.8))).verdict == "cannot tell"
    assert only(judge(*slower(-0.9, 0.9, -0.9, 0.9))).verdict == "cannot tell"


def test_two_turns_say_nothing() -> None:
    assert only(judge(*slower(3.0, 3.0))).verdict == "cannot tell"


def test_more_benchmarks_need_more_evidence() -> None:
    # Mean 0.5, standard deviation 0.5 sqrt(3)/12: t = 12, and with 2 degrees of freedom p = 1/2 - 6/sqrt(146).
    step = 0.5 * math.sqrt(3) / 12
    base, head = slower(0.5 - step, 0.5, 0.5 + step)
    alone = only(judge(base, head))
    assert alone.chance == pytest.approx(0.5 - 6 / math.sqrt(146), rel=1e-6)
    assert alone.verdict == "worse"
    others = [turns(1, 1, 1, name=name) for name in "bcd"]
    found = judge(together([base, *others]), together([head, *others])).comparisons
    assert found[0].chance == pytest.approx(4 * alone.chance)
    assert [(entry.benchmark, entry.verdict) for entry in found] == [
        ("a", "cannot tell"),
        *((name, "no worse") for name in "bcd"),
    ]


def test_equal_code_raises_no_alarm_and_twice_the_time_does() -> None:
    generator = np.random.default_rng(0)
    alarms = 0
    for _ in range(50):
        noise = generator.normal(0, 0.1, (2, 20, 6))
        sides = [together(turns(*np.exp(row), name=str(i)) for i, row in enumerate(side)) for side in noise]
        alarms += judge(*sides).verdict == "worse"
        noise[1, 7] += math.log(2)
        sides = [together(turns(*np.exp(row), name=str(i)) for i, row in enumerate(side)) for side in noise]
        assert [entry.benchmark for entry in judge(*sides).comparisons if entry.verdict == "worse"] == ["7"]
    assert alarms == 0


# ---------------------------------------------------------------------------------------------------- what is not there


def test_what_the_base_cannot_run_is_named() -> None:
    same, new = turns(1, 1, 1), turns(1, 1, 1, name="new")
    found = judge(same, together([same, new]))
    assert (found.verdict, found.head_alone, found.missing) == ("no worse", ("new",), ())
    assert "- the base cannot run it: new\n" in markdown(found)


def test_what_the_head_cannot_run_is_missing() -> None:
    same, old = turns(1, 1, 1), turns(1, 1, 1, name="old")
    found = judge(together([same, old]), same)
    assert (found.verdict, found.missing) == ("missing", ("old",))
    line = "FAILED test_speed.py::old - TypeError"
    found = judge(together([same, old]), [turn._replace(failed=(line,)) for turn in same])
    assert (found.verdict, found.missing) == ("missing", (line,))


def test_the_worst_counts() -> None:
    base, head = slower(1, 1, 1)
    gone = turns(1, 1, 1, name="gone")
    assert judge(together([base, gone]), head).verdict == "worse"
    assert judge([Turn({})] * 3, head).verdict == "cannot tell"
    assert judge([Turn({})] * 3, [Turn({})] * 3).verdict == "missing"


def test_a_turn_that_failed_once_is_left_out() -> None:
    base, head = slower(*[0.0] * 4)
    assert only(judge([*base[:3], Turn({})], head)).turns == 3


def test_the_fastest_round_is_read(tmp_path: Path) -> None:
    file = tmp_path / "benchmarks.json"
    assert read(file) == {}
    entries = [{"fullname": name, "stats": {"min": least, "median": 5.0}} for name, least in (("a", 2.0), ("b", 0.0))]
    file.write_text(json.dumps({"benchmarks": entries}), encoding="utf-8")
    assert read(file) == {"a": 2.0}


def test_what_is_said_has_all_numbers_and_no_infinity() -> None:
    found = judge(*slower(3.0, 3.0))
    text = json.dumps(facts(found), allow_nan=False)
    assert json.loads(text)["exit_code"] == EXIT["cannot tell"]
    row = next(line for line in markdown(found).splitlines() if "| a " in line)
    assert [cell.strip() for cell in row.split("|")[1:-1]] == [
        "cannot tell",
        "a",
        "2",
        "40.2",
        "x20.09",
        "xinf",
        "2",
        "1",
    ]


# ------------------------------------------------------------------------------------------------------------- really


@pytest.fixture(autouse=True)
def _few_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pytest starts three times as fast."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")


BENCHMARKS = """
import pytest
import thing

def test_work(benchmark):
    benchmark.pedantic(thing.work, rounds=5, warmup_rounds=1)
"""

LATER = """
from thing import later

def test_later(benchmark):
    benchmark.pedantic(later, rounds=1)
"""


def interpreter(folder: Path, text: str) -> str:
    """A virtual environment with all that is installed here, and a package `thing` of this text before it."""
    (folder / "thing").mkdir(parents=True)
    (folder / "thing/__init__.py").write_text(text, encoding="utf-8")
    venv.create(folder / "venv", symlinks=os.name != "nt")
    place = sysconfig.get_path(
        "purelib", "venv", {"base": str(folder / "venv"), "installed_base": str(folder / "venv")}
    )
    paths = [str(folder), *(path for path in sys.path if path.endswith("-packages"))]
    Path(place, "thing.pth").write_text("\n".join(paths), encoding="utf-8")
    return str(folder / "venv/bin/python")


def work(count: int, more: str = "") -> str:
    return f"def work():\n    return sum(i for i in range({count}))\n{more}"


@pytest.fixture(scope="module")
def sides(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Interpreters of base and head; the head is ten times slower, and the base lacks a function."""
    folder = tmp_path_factory.mktemp("versus")
    later = "def later():\n    return sum(range(1000))\n"
    return interpreter(folder / "base", work(20_000)), interpreter(folder / "head", work(200_000, later))


def suite(folder: Path, text: str = BENCHMARKS) -> str:
    """A folder of benchmarks: one file for both sides, one that the base cannot even import."""
    folder.mkdir(exist_ok=True)
    (folder / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    (folder / "test_speed.py").write_text(text, encoding="utf-8")
    (folder / "test_unknown.py").write_text(LATER, encoding="utf-8")
    return str(folder)


def versus(
    base: str,
    head: str,
    results: Path,
    *arguments: str,
    package: str = "thing",
    count: int = 3,
    tolerated: float = 1.25,
) -> int:
    options = ("--benchmark-timer=time.process_time", "-p", "no:cacheprovider", "-p", "pytest_benchmark.plugin")
    where = ["--base", base, "--head", head, "--package", package, "--turns", str(count), "--results", str(results)]
    return main([*where, "--tolerated", str(tolerated), "--", *arguments, *options])


def test_a_slower_head_is_caught(sides: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    head = Path(sides[1]).parents[2]
    monkeypatch.chdir(head)  # neither the current folder nor PYTHONPATH may give the head's package to the base
    monkeypatch.setenv("PYTHONPATH", str(head))
    assert versus(*sides, tmp_path / "results", suite(tmp_path), count=5) == EXIT["worse"]
    found = json.loads((tmp_path / "results/versus.json").read_text(encoding="utf-8"))
    assert [entry["benchmark"] for entry in found["comparisons"]] == ["test_speed.py::test_work"]
    assert found["comparisons"][0]["ratio"] > 3
    assert found["head_alone"] == ["test_unknown.py::test_later"]
    assert (tmp_path / "results/versus.md").read_text(encoding="utf-8").startswith("# Speed, head against base: worse")


def test_one_interpreter_twice(sides: tuple[str, str], tmp_path: Path) -> None:
    """A busy machine may make one side look slower, so that nothing short of a hundredfold counts here."""
    code = versus(sides[1], sides[1], tmp_path / "results", suite(tmp_path), "-k", "work", tolerated=100)
    assert code in (EXIT["no worse"], EXIT["cannot tell"])


def test_one_package_twice_is_refused(
    sides: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head = Path(sides[1]).parents[2]
    text = f"import sys\nsys.path.insert(0, {str(head)!r})\n{BENCHMARKS}"
    assert versus(*sides, tmp_path / "results", suite(tmp_path, text)) == 2
    assert f"error: base and head both import thing from {head}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"package": "thong"}, "error: the benchmarks do not import thong"),
        ({"base": "/nowhere/python"}, "/nowhere/python"),
        ({"file": "nowhere.py"}, "file or directory not found: nowhere.py"),
        ({"count": 2}, "error: --turns is at least 3"),
    ],
)
def test_bad_input_is_one_line(
    sides: tuple[str, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: dict[str, str],
    message: str,
) -> None:
    given = {"base": sides[0], "file": suite(tmp_path), "package": "thing", "count": 3} | arguments
    base, file, package, count = (given[name] for name in ("base", "file", "package", "count"))
    assert versus(str(base), sides[1], tmp_path / "r", str(file), package=str(package), count=int(count)) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("[")]
    assert len(said) == 1
    assert message in said[0]


def test_an_interpreter_without_pytest(
    sides: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    venv.create(tmp_path / "bare", symlinks=os.name != "nt")
    assert versus(str(tmp_path / "bare/bin/python"), sides[1], tmp_path / "r", suite(tmp_path)) == 2
    assert "cannot run the benchmarks: No module named 'pytest'" in capsys.readouterr().err
