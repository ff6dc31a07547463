"""Texts that plugins wrote: none of them raises, none reaches a file or a terminal as it should not."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stlbench.errors import LINE, PAGE, cause, one_line, printable


class Sly(str):
    def split(self, *_):
        raise RuntimeError


class Nameless(type):
    @property
    def __name__(cls):
        raise SystemExit


def error(text, kind=type):
    class Strange(Exception, metaclass=kind):
        def __str__(self):
            if isinstance(text, BaseException):
                raise text
            return text

    return Strange()


@pytest.mark.parametrize(
    ("raised", "said"),
    [
        (ValueError("no such luck"), "ValueError: no such luck"),
        (ValueError(), "ValueError"),
        (ValueError("two\n  lines\r\nor \x85 three"), "ValueError: two lines or three"),
        (error(KeyError()), "Strange: (its text cannot be had, it raises KeyError)"),
        (error(SystemExit()), "Strange: (its text cannot be had, it raises SystemExit)"),
        (error(3), "Strange: (its text cannot be had, it raises TypeError)"),
        (error(Sly("a b")), "Strange: a b"),
        (error("b", Nameless), "Strange: b"),
        (FileNotFoundError(2, "No such file", "caf\udce9"), "FileNotFoundError: [Errno 2] No such file: 'caf\\udce9'"),
        (ValueError("\x1b[2J\x1b]0;title\x07"), "ValueError: \\x1b[2J\\x1b]0;title\\x07"),
        (ValueError("\u202eright to left"), "ValueError: \\u202eright to left"),
        (ValueError("φ ≥ 0, naïve, 机器人"), "ValueError: φ ≥ 0, naïve, 机器人"),
    ],
)
def test_the_cause_is_one_safe_line(raised, said):
    assert cause(raised) == said


def test_what_is_too_long_lacks_its_middle():
    found = printable("begin " + 10 * PAGE * "x" + " end")
    assert found.startswith("begin xxx")
    assert found.endswith("xxx end")
    assert f"{9 * PAGE + 60} characters left out" in found
    assert PAGE - 50 < len(found) <= PAGE
    line = one_line("x" * 10**6)
    assert f" {10**6 - (LINE - 50)} characters left out " in line
    assert one_line(line) == line
    assert len(line) <= LINE


def test_several_lines_stay():
    assert printable("a\n\tb\x1b") == "a\n\tb\\x1b"


@given(st.text(st.characters()))
def test_every_text_can_be_written_and_is_the_same_when_made_safe_again(text):
    safe = printable(text)
    assert safe.encode("utf-8").decode("utf-8") == safe == printable(safe)
    assert not any(ord(sign) < 32 and sign not in "\t\n" for sign in safe)
    json.dumps(one_line(text)).encode("ascii")
    assert len(one_line(text).splitlines()) <= 1
