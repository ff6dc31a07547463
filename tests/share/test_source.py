"""What a text names, and functions of modules."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from stlbench.errors import UsageError
from stlbench.share.source import Source, find_source, load_function


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("zz_mine", "zz_broken", "zz_needs"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


@pytest.mark.parametrize(
    ("text", "kind", "name"),
    [
        ("my_policy:Act2", "function", "my-policy-act2"),
        ("a.b:act", "function", "a-b-act"),
        ("hold-disc/funnel[ginf=0.02]/dqn/0", "cell", ""),
        ("hold-disc/funnel/dqn/12/tuned", "cell", ""),
        ("Net_3.ONNX", "onnx", "net-3"),
        ("x/model.zip", "sb3", "model"),
        ("_.csv", "traces", "policy"),
        ("t.npz", "traces", "t"),
        ("t.csv.gz", "traces", "t-csv"),
    ],
)
def test_what_a_text_names(here: Path, text: str, kind: str, name: str) -> None:
    if "." in text and kind not in ("function", "cell"):
        (here / text).parent.mkdir(exist_ok=True)
        (here / text).write_text("")
    source = find_source(text)
    assert source.kind == kind
    if name:
        assert source.name == name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no.onnx", "there is no file no.onnx"),
        ("mine", "'mine' names no policy; one is a cell's name task/method/agent/seed, module:function, or a file"),
        ("mine:", "names no policy"),
        ("a/b/c", "names no policy"),
        ("", "names no policy"),
    ],
)
def test_what_names_nothing(here: Path, text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        find_source(text)


def test_a_function_of_the_working_directory(here: Path) -> None:
    (here / "zz_mine.py").write_text("def act(observation): return observation + 1\n")
    assert load_function("zz_mine:act")(np.zeros(2)).tolist() == [1, 1]
    source = Source("function", "zz_mine:act")
    before = source.digest
    (here / "zz_mine.py").write_text("def act(observation): return observation + 2\n")
    assert source.digest != before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("zz_nothing:act", "there is no module 'zz_nothing' here or installed"),
        ("zz_mine.sub:act", "there is no module 'zz_mine.sub' here or installed"),
        ("zz_mine:atc", "the module has no 'atc'; did you mean 'act'"),
        ("zz_mine:NUMBER", "'NUMBER' is int, which cannot be called"),
        ("zz_broken:act", "the module cannot be imported: ZeroDivisionError: division by zero"),
        ("zz_needs:act", "the module cannot be imported: No module named 'zz_absent'"),
    ],
)
def test_functions_that_are_not_there(here: Path, text: str, message: str) -> None:
    (here / "zz_mine.py").write_text("NUMBER = 3\ndef act(observation): ...\n")
    (here / "zz_broken.py").write_text("1 / 0\n")
    (here / "zz_needs.py").write_text("import zz_absent\n")
    with pytest.raises(UsageError, match=message):
        load_function(text)
