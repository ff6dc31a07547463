"""A table of text as programs write it, and one that a stranger made to take memory and time."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stlbench.errors import UsageError
from stlbench.share import trace_table
from stlbench.share.trace_table import TraceTable, read_table, times_of


def table(path: Path, content: str | bytes) -> TraceTable:
    (path / "t.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_table(path / "t.csv")


def values(found: TraceTable, *names: str) -> list[list[float]]:
    return np.column_stack([found.column(name) for name in names]).tolist()


class TestAsProgramsWriteIt:
    def test_the_index_of_pandas_has_no_title(self, tmp_path: Path) -> None:
        found = table(tmp_path, pd.DataFrame({"x": [1.5, 2], "y": [3, 4]}).to_csv())
        assert found.names == ("x", "y")
        assert values(found, "y", "x") == [[3, 1.5], [4, 2]]
        again = pd.read_csv(io.StringIO(",x\n0,1\n")).to_csv(index=False)
        assert table(tmp_path, again).samples(["x"])[0].tolist()[1:] == [1.0]

    @pytest.mark.parametrize("first", ["sep=;\r\n", "SEP=;\n", "\ufeffsep=;\n"])
    def test_the_first_line_of_excel(self, tmp_path: Path, first: str) -> None:
        found = table(tmp_path, first + "x;y,z\n1;2\n")
        assert (found.delimiter, found.titles, values(found, "x")) == ("semicolons", ("x", "y,z"), [[1]])
        assert values(table(tmp_path, "sep=|\nx|y\n1|2\n"), "y") == [[2]]

    def test_an_end_of_line_is_no_delimiter(self, tmp_path: Path) -> None:
        with pytest.raises(UsageError, match="row 2 has 2 values, the header names 1 signals"):
            table(tmp_path, "sep=\r\nx,y\r\n1,2\r\n")

    def test_compressed_or_in_utf_16(self, tmp_path: Path) -> None:
        text = "x,µ\n1,2\n"
        for content in (gzip.compress(text.encode()), text.encode("utf-16"), gzip.compress(text.encode("utf-16"))):
            assert values(table(tmp_path, content), "x", "µ") == [[1, 2]]
        assert values(table(tmp_path, "\ufeffx\n1\n".encode("utf-16-be")), "x") == [[1]]

    @pytest.mark.parametrize(
        ("titles", "names"),
        [
            (["x [m/s]", "y (rad)", "z[m]"], ("x", "y", "z")),
            (["/robot/x", "robot.y", "x dot", "# t"], ("robot_x", "robot_y", "x_dot", "t")),
            (["x", "x [m]", "y [m]", "y [ft]"], ("x", "x [m]", "y [m]", "y [ft]")),
            (["_x", "x_", "größe", "1st", "(m)"], ("_x", "x_", "größe", "1st", "m")),
        ],
    )
    def test_titles_with_units_and_other_signs(self, tmp_path: Path, titles: list[str], names: tuple[str, ...]) -> None:
        found = table(tmp_path, ",".join(titles) + "\n" + ",".join("1" * len(titles)) + "\n")
        assert found.names == names
        assert found.titles == tuple(titles)

    @pytest.mark.parametrize(
        ("content", "form"),
        [
            (b'{"x": [1, 2]}', "JSON"),
            (b'\xef\xbb\xbf\n[{"x": 1}]', "JSON"),
            (b"MATLAB 5.0 MAT-file, Platform", "a MAT-file"),
            (b"\x89HDF\r\n\x1a\n", "HDF5, as MATLAB 7.3 writes it"),
            (b"PAR1\x15\x04", "Parquet"),
            (b"PK\x03\x04\x14", "a zip file"),
            (b"\x93NUMPY\x01\x00", "one array of NumPy"),
            ("x,y\n1,2\n".encode("utf-16-le"), "no text: it has a byte 0"),
            (gzip.compress(b'{"x": 1}', mtime=0), "JSON"),
        ],
    )
    def test_another_format_is_named_with_the_remedy(self, tmp_path: Path, content: bytes, form: str) -> None:
        with pytest.raises(UsageError, match=rf"t.csv is {form}.*; write a table of text \(CSV\), as writetable of"):
            table(tmp_path, content)


def test_whole_numbers_that_a_float_is_are_read(tmp_path: Path) -> None:
    texts = [
        *["9007199254740992", "1152921504606846976", "0.1", "1e23", "1700000000000010000.0", "-0"],
        "0" * 5000 + "8",
    ]
    assert table(tmp_path, "x\n" + "\n".join(texts) + "\n").column("x") == [float(text) for text in texts]


class TestLimits:
    def test_columns(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(trace_table, "COLUMNS", 3)
        assert len(table(tmp_path, "a,b,c\n1,2,3\n").names) == 3
        with pytest.raises(UsageError, match="the header names 4 columns; at most 3 are read"):
            table(tmp_path, "a,b,c,d\n1,2,3,4\n")

    def test_values(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(trace_table, "VALUES", 9)
        assert len(table(tmp_path, "a,b\n1,2\n3,4\n").rows) == 2
        for more in ("5,6\n", "\n\n\n\n"):
            with pytest.raises(UsageError, match="has too many values: at most 9 are read; leave rows or columns out"):
                table(tmp_path, "a,b\n1,2\n3,4\n" + more)

    @pytest.mark.parametrize("row", ["1," * 20, '"1\n",' * 7])
    def test_characters_of_a_row(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, row: str) -> None:
        monkeypatch.setattr(trace_table, "ROW", 30)
        assert len(table(tmp_path, "a\n" + "1\n" * 40).rows) == 40
        with pytest.raises(UsageError, match="a row has more than 30 characters; is a quotation mark missing"):
            table(tmp_path, "a\n" + row + "\n")

    def test_bytes_of_a_file_and_characters_of_its_text(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(trace_table, "LARGEST", 2**15)
        content = b"x\n" + b"1\n" * 2**15
        for data in (content, gzip.compress(content, mtime=0)):
            with pytest.raises(UsageError, match=r"is too large: at most .* MiB of text are read; leave rows"):
                table(tmp_path, data)
        with pytest.raises(UsageError, match="is too large"):
            read_table(Path("/dev/zero"))

    def test_forty_thousand_columns(self, tmp_path: Path) -> None:
        """Comparing each title with all before it would take 13 s."""
        titles = [f"x{i}" for i in range(40_000)]
        found = table(tmp_path, ",".join(titles) + "\n" + ",".join(map(str, range(40_000))) + "\n")
        assert found.samples(["x39999"])[0, -1] == 39_999
        with pytest.raises(UsageError, match="the header names 'x7' twice"):
            table(tmp_path, ",".join([*titles, "x7"]) + "\n1\n")


class TestTimes:
    @pytest.mark.parametrize(
        ("title", "texts", "dt"),
        [
            ("time", ["0", "0.1", "0.2", "0.30000000000000004"], 0.1),
            ("Time (s)", ["5.00", "5.33", "5.67", "6.00"], 1 / 3),
            ("t", ["-1", "-.75", "-.5"], 0.25),
            ("timestamp [ns]", ["1700000000000010000", "1700000000010010000", "1700000000020010000"], 0.01),
            ("t_ms", ["0", "17", "33", "50", "67"], 1 / 60),
            ("TIMESTAMP", ["100", "160", "220"], 60),
            ("stamp (min)", ["0", "1"], 60),
            ("time [µs]", ["0", "250"], 0.00025),
            ("# time", ["0", "0.0101", "0.0199", "0.0302", "0.0399"], 0.01),
            ("/clock", ["0", "1"], None),
            ("T", ["20.5", "20.5"], None),
            ("t (K)", ["280", "281"], None),
            ("time_index", ["0", "1"], None),
        ],
    )
    def test_the_sampling_time(self, tmp_path: Path, title: str, texts: list[str], dt: float | None) -> None:
        times = times_of(table(tmp_path, f"x,{title}\n" + "".join(f"0,{text}\n" for text in texts)))
        assert (times and times.sampling_time()) == dt

    def test_float32_times_give_a_round_number(self, tmp_path: Path) -> None:
        stamps = (np.arange(2000) * np.float32(0.02)).astype(np.float32)
        found = times_of(table(tmp_path, "t\n" + "\n".join(map(str, stamps)) + "\n"))
        assert found is not None
        assert found.sampling_time() == 0.02

    def test_times_beyond_all_floats_are_refused(self, tmp_path: Path) -> None:
        exponent = "has a time with an exponent that is too large"
        cases = ((("-1e308", "1e308"), "are too far apart"), (("0", "nan"), "'nan' is no finite number"))
        for texts, message in (*cases, (("0", "1e-9999999999999999999"), exponent)):
            times = times_of(table(tmp_path, "t\n" + "\n".join(texts) + "\n"))
            assert times is not None
            with pytest.raises(UsageError, match=message):
                times.check_rise()

    def test_a_signal_of_a_task_is_no_time(self, tmp_path: Path) -> None:
        found = table(tmp_path, "t,time\n5,0\n5,1\n")
        times = times_of(found, ["t", "x"])
        assert times is not None
        assert times.title == "time"
        assert times_of(found, ["t", "time"]) is None
