"""Inputs that nobody meant: bytes that were damaged on their way, and texts put together from pieces of good ones."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

__all__ = ["damaged", "soup"]

Edit = tuple[str, float, int, bytes]


def damaged(good: bytes | list[bytes], most: int = 4) -> st.SearchStrategy[bytes]:
    """Good bytes with a few edits: flipped bits, and parts that were cut out, put in, said twice or filled with one
    byte; or cut short; or any bytes at all."""
    edits = st.tuples(
        st.sampled_from(["flip", "cut", "insert", "repeat", "fill", "truncate"]),
        st.floats(0, 1),
        st.integers(0, 200),
        st.binary(min_size=1, max_size=12),
    )
    chosen = st.just(good) if isinstance(good, bytes) else st.sampled_from(good)
    edited = st.tuples(chosen, st.lists(edits, min_size=1, max_size=most)).map(_edited)
    return st.one_of(edited, edited, edited, st.binary(max_size=200))


def _edited(drawn: tuple[bytes, list[Edit]]) -> bytes:
    data, edits = drawn
    for kind, share, length, other in edits:
        at = int(share * len(data))
        head, part, tail = data[:at], data[at : at + length], data[at + length :]
        if kind == "flip":
            part = bytes([*([part[0] ^ (1 << length % 8)] if part else []), *part[1:]])
        elif kind == "cut":
            part = b""
        elif kind == "insert":
            part = other + part
        elif kind == "repeat":
            part = part * 3
        elif kind == "fill":
            part = other[:1] * len(part)
        else:
            part, tail = b"", b""
        data = head + part + tail
    return data


def soup(pieces: list[str], most: int = 30, between: str = "") -> st.SearchStrategy[str]:
    """Pieces in any order, with any text among them."""
    anything: st.SearchStrategy[Any] = st.one_of(*[st.sampled_from(pieces)] * 8, st.text(max_size=4))
    return st.lists(anything, max_size=most).map(between.join)
