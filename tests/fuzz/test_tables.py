"""Damaged tables of text and files of arrays, in the place of traces."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fuzz.answers import answer, fuzz, sizes
from fuzz.inputs import damaged, soup
from hypothesis import strategies as st

TABLE = b"time,x,y\n0,0.5,1\n0.5,0.25,3\n1,0.125,-1\n1.5,0,0\n2,-0.5,2\n"
CHANGES = ((b",", b";"), (b",", b"\t"), (b"time", b"\xef\xbb\xbftime"), (b"0.5", b'"0.5"'))
OTHERS = [TABLE.replace(*change) for change in CHANGES]
CELL = """time x y 0 1 0.5 -1e308 1e999 nan inf 1_0 0x1 ٣ , , ; " ' "" # =1+1"""
CELLS = [*CELL.split(), "x,y\n", " ", "9" * 400, "x" * 200]
CELLS += ["\t", "\n", "\n", "\r\n", "\r", "\x00", "\x1b[2J", "\ufeff"]
TABLES = st.one_of(damaged([TABLE, *OTHERS]), soup(CELLS).map(lambda text: text.encode("utf-8", "surrogatepass")))


def _packed(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def _zipped(**members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return file.getvalue()


def _array(value: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, value, allow_pickle=True)
    return file.getvalue()


TRACES, SIGNALS = np.linspace(-1, 0.75, 10).reshape(2, 5, 1), np.array(["x"])
GOOD = _packed(traces=TRACES, signals=SIGNALS)
WITH_STATES = _packed(traces=TRACES, signals=SIGNALS, extremes=np.array([0, 1]), states=TRACES)
ODD = [np.array(each) for each in (None, "x", [b"x"], [1j], [{}, {}], 7, [["x"]])]
ODD += [np.zeros((0, 5, 1)), np.full((2, 5, 1), np.nan)]
ODD += [np.zeros((2, 5, 1), kind) for kind in ("M8[s]", [("a", "f8")])]
ANY = st.sampled_from([TRACES, SIGNALS, *ODD])
ARRAYS = st.one_of(
    damaged([GOOD, WITH_STATES]),
    st.builds(lambda traces, signals: _zipped(traces=_array(traces), signals=_array(signals)), ANY, ANY),
    st.builds(  # each member damaged by itself, with a checksum that is right
        lambda traces, signals: _zipped(traces=traces, signals=signals),
        damaged(_array(TRACES)),
        damaged(_array(SIGNALS)),
    ),
)


@sizes(25, 2_500)
def test_the_monitor_judges_a_table_or_refuses_it(say, examples):
    def check(data: bytes) -> None:
        Path("trace.csv").write_bytes(data)
        answer(say("monitor", "G[0,2] x <= 1", "trace.csv"))
        answer(say("monitor", "F[0,1] time <= x", "trace.csv", "--dt", "0.5", "--policy", "clip", "--json"))

    fuzz(examples, TABLES, check)


@sizes(25, 2_000)
def test_the_monitor_judges_arrays_or_refuses_them(say, examples):
    def check(data: bytes) -> None:
        Path("traces.npz").write_bytes(data)
        answer(say("monitor", "G[0,2] x <= 1", "traces.npz"))
        answer(say("monitor", "G[0,2] x <= 1", "traces.npz", "--start", 1))

    fuzz(examples, ARRAYS, check)


@pytest.mark.parametrize(("name", "inputs"), [("traces.csv", TABLES), ("traces.npz", ARRAYS)])
@sizes(10, 2_000)
def test_traces_are_scored_or_refused(say, toy, examples, name, inputs):
    def check(data: bytes) -> None:
        Path(name).write_bytes(data)
        answer(say("score", "toy-line", name, "--json"))

    fuzz(examples, inputs, check)
