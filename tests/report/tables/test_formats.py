"""Tables as Markdown, CSV, LaTeX, plain values and on a terminal."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace

import pytest
from helpers.reports import summary
from helpers.synthetic_results import by_hand, result
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from stlbench.registry.choices import Choice
from stlbench.report import condense
from stlbench.report.tables.runs import overview, robustness_table
from stlbench.report.tables.table import (
    Column,
    FirstFailed,
    Learned,
    Seeds,
    Table,
    show,
    to_csv,
    to_latex,
    to_markdown,
    to_records,
    to_screen,
)
from stlbench.report.tables.yardsticks import Known
from stlbench.statistics.intervals import Interval

OTHER = Choice("a-task-with-a-longer-name")
TABLE = Table(
    "Scores",
    (Column("method", right=False), Column("share", unit="%", digits=1), Column("gain", digits=3, kind=Interval)),
    (("funnel[ginf=0.02]", 98.04, Interval(-0.1, 0.2)), ("a|b_c*d & <e>", None, None)),
    ("One note.",),
)


def screen(table, width):
    console = Console(width=width, file=io.StringIO(), color_system=None)
    to_screen(table, console)
    return console.file.getvalue()


def test_parts_of_a_wide_table_keep_the_order_of_columns():
    columns = (Column("first"), Column("method", right=False), Column("second"), Column("third"))
    lines = screen(Table("Wide", columns, ((1, "raw", 2, 3), (4, "flag", 5, 6))), 24).splitlines()
    assert [line.split() for line in lines if "method" in line] == [["first", "method", "second"], ["method", "third"]]


def test_a_note_in_markdown_has_no_html():
    (note,) = to_markdown(replace(TABLE, notes=("of a stranger: \\<img src=x> `y`",))).splitlines()[-1:]
    assert note == "- of a stranger: \\&lt;img src=x> `y`"


def test_markdown():
    assert to_markdown(TABLE) == (
        "## Scores\n\n"
        "| method            | share [%] |            gain |\n"
        "| ----------------- | --------: | --------------: |\n"
        "| funnel[ginf=0.02] |      98.0 | [-0.100, 0.200] |\n"
        "| a\\|b_c\\*d & \\<e>  |         - |               - |\n"
        "\n- One note.\n"
    )


def test_csv_has_all_digits_both_ends_of_an_interval_and_nothing_is_empty():
    assert list(csv.reader(io.StringIO(to_csv(TABLE)))) == [
        ["method", "share [%]", "gain low", "gain high"],
        ["funnel[ginf=0.02]", "98.04", "-0.1", "0.2"],
        ["a|b_c*d & <e>", "", "", ""],
    ]


def test_latex():
    assert to_latex(TABLE).splitlines() == [
        "% Scores",
        "% One note.",
        r"{\fontsize{8}{9.5}\selectfont\setlength{\tabcolsep}{3pt}%",
        r"\begin{tabular}{@{}lrr@{}}",
        r"\toprule",
        r"method & share {[}\%{]} & gain \\",
        r"\midrule",
        r"funnel{[}ginf=0.02{]} & 98.0 & {[}$-$0.100, 0.200{]} \\",
        r"a\textbar{}b\_c*d \& \textless{}e\textgreater{} & -- & -- \\",
        r"\bottomrule",
        r"\end{tabular}}",
    ]


@pytest.mark.parametrize(("width", "most"), [("column", 64), ("page", 130)])
def test_latex_fits_the_width_and_says_what_it_left_out(width, most):
    others = [replace(each, id=replace(each.id, task=OTHER, agent=Choice("sb3-dqn"))) for each in RESULTS]
    tables = summary(condense([*RESULTS, *others]), {})
    nested = re.compile(r"\\begin\{tabular\}\[[tb]\]\{@\{\}[lr]@\{\}\}(.*?)\\end\{tabular\}")
    for table in tables[1:4]:
        text = to_latex(table, width)
        plain = nested.sub(lambda found: max(found[1].split(r" \\ "), key=len), text)
        for tabular in plain.split(r"\toprule")[1:]:
            rows = [line.removesuffix(r" \\").split(" & ") for line in tabular.splitlines() if line.endswith(r" \\")]
            shown = [[re.sub(r"\\text\w+\{\}|[\\{}$]", "", each) for each in row] for row in rows]
            assert sum(max(map(len, column)) + 2 for column in zip(*shown, strict=True)) <= most
        assert text.count(r"\begin{tabular}{@") == text.count(r"\end{tabular}}")
    assert "% Left out: " in to_latex(tables[1], "column")


def test_latex_is_split_only_where_it_is_too_wide():
    columns = (Column("task", right=False, shared=True), Column("share"))
    assert to_latex(Table("Two", columns, (("one", 1), ("two", 2)))).count(r"\begin{tabular}") == 1


@pytest.mark.parametrize("text", ["\\", "100 %", "#1 {x} $y$ ~z^2", "line\nbreak", "x > -1"])
def test_latex_leaves_no_special_character(text):
    body = to_latex(Table("t", (Column("c", right=False),), ((text,),))).splitlines()[6]
    bare = re.sub(r"\\(textbackslash|textasciicircum|textasciitilde|textgreater)\{\}|\\[&%$#_{}]|\$-\$", "", body)
    assert not re.search(r"[\\%#&$_^~{}<>|]", bare.removesuffix(r" \\"))


def test_the_parts_of_compound_values_are_columns():
    (record,) = to_records(
        robustness_table(condense([result(robustness=(-0.3, 0.1), first_failed={"G[0,9] x > 0": 1})]), Known())
    )
    parts = {"seeds done": 1, "seeds planned": 1, "seeds unfinished": None, "median 95 % interval low": None}
    parts |= {"failed first formula": "G[0,9] x > 0", "failed first starts": 1, "failed first violating starts": 1}
    assert parts.items() <= record.items()


@given(st.floats())
def test_csv_and_records_lose_no_digit(value):
    table = Table("t", (Column("x", unit="m", digits=1),), ((value,),))
    (record,) = to_records(table)
    assert repr(record["x [m]"]) == repr(value)
    assert repr(float(to_csv(table).splitlines()[1])) == repr(value)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (-0.0001, 3, "0.000"),
        (0.16666, 3, "0.167"),
        (float("-inf"), 3, "-inf"),
        (0.1234567, None, "0.123457"),
        (1000000, None, "1000000"),
        (None, 3, "-"),
        ("as it is", None, "as it is"),
        (Interval(-0.1, 0.2), 1, "[-0.1, 0.2]"),
        (Seeds(9, 10, "1 timeout"), None, "9 of 10, 1 timeout"),
        (Seeds(3, 3), None, "3 of 3"),
        (FirstFailed("F[0,2] b > 0", 5, 8), None, "F[0,2] b > 0 (62 % of 8 violating starts)"),
        (Learned(-0.1, None, None, 1, 0, 1), 3, "-0.100 (1, 0 of 1)"),
        (Learned(-0.1, -0.2, 0.01, 2, 1, 3, "*="), 2, "-0.10 (2, 1 of 3) *=\n[-0.20, 0.01]"),
    ],
)
def test_how_values_are_shown(value, digits, text):
    assert show(value, digits) == text


RESULTS = [
    *(
        result(seed=seed, robustness=(0.1 * seed, 0.4), further={"centre": (0.9,), "paper": (0.8,)})
        for seed in range(3)
    ),
    *(
        result("funnel[ginf=0.02,variant=code]", seed, robustness=(-0.3,), first_failed={"G[0,9] x > 0": 1})
        for seed in range(3)
    ),
    *(result("tau-mdp", seed, "intractable", reason="needs 6003 inputs, limit 512") for seed in range(3)),
    result("mine", status="raised", reason="ValueError: [bold]no[/bold] :smile:"),
]


@pytest.mark.parametrize("width", [80, 100, 120, 200])
def test_tables_fit_the_screen(width):
    for table in summary(condense(RESULTS), by_hand(hold_disc=(0.4,), a_task_with_a_long_name=(0.1,))):
        text = screen(table, width)
        assert max(map(len, text.splitlines())) <= width
        assert "…" not in text


def test_a_table_that_cannot_be_narrower_comes_in_parts_each_with_the_rows_names():
    methods = [f"method-{letter}" for letter in "abcdef"]
    results = [result(method, task=task) for task in ("hold-disc", "other") for method in methods]
    lines = screen(overview(condense(results), Known()), 80).splitlines()
    headers = [line.split() for line in lines if "method-" in line]
    assert len(headers) > 1
    assert [name for header in headers for name in header if name.startswith("method-")] == methods
    assert all(header[0] == "task" for header in headers)
    assert sum(line.startswith("hold-disc") for line in lines) == len(headers)
    assert max(map(len, lines)) <= 80


def test_a_narrow_screen_says_what_it_left_out():
    text = " ".join(screen(summary(condense(RESULTS), {})[0], 80).split())
    assert "Left out on this narrow screen: starts, mean robustness, worst start, learned 95 % interval [%], " in text
    assert "0.250 - 83.3 2" in text


def test_on_screen_the_interval_of_what_was_learned_has_a_line_of_its_own():
    table = Table("t", (Column("raw", kind=Learned, digits=1),), ((Learned(0.5, 0.25, 0.75, 3, 2, 3, "="),),))
    lines = [line.strip() for line in screen(table, 80).splitlines()]
    assert lines[3:5] == ["0.5 (3, 2 of 3) =", "[0.2, 0.8]"]
    assert "| 0.5 (3, 2 of 3) = [0.2, 0.8] |" in to_markdown(table)


def test_what_all_rows_share_goes_into_the_title():
    first = screen(summary(condense(RESULTS), {})[0], 120).splitlines()[0]
    assert first == "Robustness: task hold-disc, agent dqn, budget quick, track shared"
    other = screen(robustness_table(condense([*RESULTS, result(task="other")]), Known()), 120).splitlines()[0]
    assert other == "Robustness: agent dqn, budget quick, track shared"


def test_reasons_are_printed_as_they_are_and_stand_below_the_table():
    tables = summary(condense(RESULTS), {})
    text = " ".join(screen(tables[-1], 120).split())
    assert "hold-disc/mine/dqn/0 quick raised ValueError: [bold]no[/bold] :smile:" in text
    remark = "remarks: hold-disc/tau-mdp/dqn/quick/shared: intractable: needs 6003 inputs, limit 512"
    assert remark in screen(tables[0], 120).splitlines()
