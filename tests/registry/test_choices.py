"""Names with parameters: reading, and checking against a constructor."""

from __future__ import annotations

import importlib
from inspect import cleandoc
from typing import Annotated, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import Field

from stlbench.errors import UsageError
from stlbench.registry.choices import Choice, Parameter, check, declared, field_docs, parse_choice, parse_choices

keys = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
values = st.from_regex(r"[A-Za-z0-9._+-]{1,8}", fullmatch=True)
names = st.from_regex(r"[a-z0-9][a-z0-9-]{0,8}", fullmatch=True)
some = st.builds(lambda name, pairs: Choice(name, tuple(pairs.items())), names, st.dictionaries(keys, values))


def test_a_comma_in_brackets_does_not_split():
    assert parse_choices("funnel,funnel[variant=code,ginf=0.02],flag") == (
        Choice("funnel"),
        Choice("funnel", (("ginf", "0.02"), ("variant", "code"))),
        Choice("flag"),
    )


def test_the_text_is_canonical_whatever_the_order_and_the_spaces():
    assert str(parse_choice(" funnel[ variant = code , ginf=0.02 ] ")) == "funnel[ginf=0.02,variant=code]"
    assert parse_choice("funnel[b=1,a=2]") == parse_choice("funnel[a=2,b=1]")


def test_repetitions_are_dropped_and_the_order_is_kept():
    texts = [str(choice) for choice in parse_choices("raw,flag[b=1,a=2],raw,flag[a=2,b=1],funnel")]
    assert texts == ["raw", "flag[a=2,b=1]", "funnel"]


@settings(max_examples=25)
@given(st.lists(some, min_size=1, max_size=4, unique=True))
def test_what_is_printed_parses_to_the_same(choices):
    assert parse_choices(",".join(map(str, choices))) == tuple(choices)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty item at column 1"),
        ("funnel,,flag", "empty item at column 8"),
        ("funnel,", "empty item at column 8"),
        ("funnel[a=1", "'[' at column 7 of 'funnel[a=1' is never closed"),
        ("funnel]", "unbalanced ']' at column 7"),
        ("funnel[a=[1]]", "unbalanced '[' at column 10"),
        ("funnel[a=1]x", "one pair of brackets"),
        ("funnel[a=1][b=2]", "one pair of brackets"),
        ("funnel[]", "expected key=value, got ''"),
        ("funnel[a=1,]", "expected key=value, got ''"),
        ("funnel[code]", "expected key=value, got 'code'"),
        ("funnel[=1]", "'' is no parameter name"),
        ("funnel[a=]", "the value of a consists of"),
        ("funnel[a=1=2]", "got '1=2'"),
        ("funnel[a=../x]", "got '../x'"),
        ("funnel[a=1,a=2]", "a is given twice"),
        ("Funnel", "a name consists of"),
        ("reach-stay overlap", "several stand in a list with commas: reach-stay,overlap"),
        ("../etc", "a name consists of"),
        ("G(0,1) x>=0", "a formula stands in a task's file, with intervals in square brackets, as in G[0,1]"),
        ("G[0,1] x>=0", "a formula stands in a task's file"),
        ("-x", "a name consists of"),
        ("[a=1]", "a name consists of"),
    ],
)
def test_bad_text_is_a_usage_error_that_says_where(text, message):
    with pytest.raises(UsageError) as caught:
        parse_choices(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


class Example:
    def __init__(
        self,
        specification: object,
        *,
        ginf: float = 0.01,
        variant: Literal["paper", "code"] = "paper",
        order: Literal[1, 2] = 1,
        window: int | None = None,
        clip: bool = False,
        hidden: tuple[int, ...] = (64, 64),
        share: Annotated[float, Field(ge=0, le=1)] = 0.5,
    ) -> None: ...


class Demanding(Example):
    def __init__(self, *, size: int, anything=None) -> None: ...


class Plain:
    pass


def checked(text, defaults=None, kind=Example):
    return check(declared(kind), parse_choice(text), defaults)


def test_text_becomes_the_declared_type():
    found = checked("x[ginf=2e-2,variant=code,order=2,window=7,clip=true,share=1]")
    assert found == {"ginf": 0.02, "variant": "code", "order": 2, "window": 7, "clip": True, "share": 1.0}
    assert [type(value) for value in found.values()].count(float) == 2


def test_the_items_of_a_list_are_joined_by_plus():
    assert checked("x[hidden=32+16]") == {"hidden": (32, 16)}
    assert checked("x[hidden=32]") == {"hidden": (32,)}


def test_the_choice_overrides_the_defaults_and_the_constructor_has_the_rest():
    assert checked("x") == {}
    assert checked("x[ginf=0.5]", {"ginf": 0.1, "hidden": [8, 8]}) == {"ginf": 0.5, "hidden": (8, 8)}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x[ginf=y]", "x[ginf=y]: ginf should be a number, got 'y'"),
        ("x[clip=2,ginf=y]", "]: clip should be true or false, got '2'; ginf should be a number, got 'y'"),
        ("x[ginf=nan]", "x[ginf=nan]: ginf should be a finite number, got 'nan'"),
        ("x[window=1.5]", "x[window=1.5]: window should be a whole number, got '1.5'"),
        ("x[clip=maybe]", "x[clip=maybe]: clip should be true or false, got 'maybe'"),
        ("x[variant=cod]", "x[variant=cod]: variant should be 'paper' or 'code', got 'cod'"),
        ("x[order=3]", "x[order=3]: order should be 1 or 2, got '3'"),
        ("x[share=2]", "x[share=2]: share should be at most 1, got '2'"),
        ("x[hidden=32+y]", "x[hidden=32+y]: hidden[1] should be a whole number, got 'y'"),
        ("x[hidden=+]", "x[hidden=+]: hidden[0] should be a whole number, got ''"),
        ("x[varient=code]", "x[varient=code]: no parameter 'varient'; did you mean 'variant'?"),
        ("x[specification=1]", "no parameter 'specification'; there are: clip, ginf"),
    ],
)
def test_a_wrong_parameter_is_told_with_what_would_be_right(text, message):
    with pytest.raises(UsageError) as caught:
        checked(text)
    assert message in str(caught.value)


def test_an_error_of_the_recipe_is_told_apart():
    with pytest.raises(UsageError, match=r"x: hidden\[1\] should be a whole number, got 'b' in the recipe"):
        checked("x", {"hidden": [1, "b"]})


def test_a_parameter_without_default_must_be_given():
    with pytest.raises(UsageError, match="x: parameter 'size' must be given"):
        checked("x", kind=Demanding)
    assert checked("x[size=3,anything=at-all]", kind=Demanding) == {"size": 3, "anything": "at-all"}


def test_types_are_told_for_people():
    assert {name: entry.text for name, entry in declared(Example).items()} == {
        **{"ginf": "float", "variant": "paper | code", "order": "1 | 2", "window": "int | None", "clip": "bool"},
        **{"hidden": "tuple[int, ...]", "share": "float"},
    }


def test_a_class_without_constructor_has_no_parameters():
    assert declared(Plain) == {}
    with pytest.raises(UsageError, match="no parameter 'a'; there are none"):
        checked("x[a=1]", kind=Plain)


class TestDataclasses:
    """A constructor that `dataclass` made: its parameters are the fields, of base classes too."""

    @pytest.fixture
    def derived(self, site):
        """A class whose base lies in another module, and alone knows what the base's annotation means."""
        base = """
            from __future__ import annotations
            from dataclasses import dataclass
            from typing import Annotated, ClassVar
            from pydantic import Field
            Share = Annotated[float, Field(ge=0, le=1)]
            @dataclass(frozen=True, kw_only=True)
            class Base:
                kind: ClassVar[str] = "x"
                gamma: Share = 0.9
                '''discount of
                a decision'''
                rate: Share = 0.5
                '''how fast'''
        """
        derived = """
            from __future__ import annotations
            from dataclasses import dataclass, field
            from zz_fields.base import Base
            @dataclass(frozen=True, kw_only=True)
            class Derived(Base):
                rate: int = 3
                must: int
                size: int = 3
                '''how large'''
                silent: str = ""
            class Quiet(Derived):
                pass
            class Own(Derived):
                def __init__(self, *, size: int = 5):
                    super().__init__(must=1, size=size)
        """
        files = {"__init__.py": "", "base.py": cleandoc(base), "derived.py": cleandoc(derived)}
        site("zz-fields", "", {f"zz_fields/{name}": text for name, text in files.items()})
        return importlib.import_module("zz_fields.derived")

    def test_fields_of_the_base_are_parameters_too(self, derived):
        for kind in (derived.Derived, derived.Quiet):
            known = declared(kind)
            types = {"gamma": "float", "rate": "int", "must": "int", "size": "int", "silent": "str"}
            assert {name: entry.text for name, entry in known.items()} == types
            assert (known["gamma"].default, known["gamma"].limits, known["rate"].limits) == (0.9, ">= 0, <= 1", "")
            assert checked("x[gamma=0.25,must=2]", kind=kind) == {"gamma": 0.25, "must": 2}
            with pytest.raises(UsageError, match="gamma should be at most 1, got '2'"):
                checked("x[gamma=2,must=2]", kind=kind)
            with pytest.raises(UsageError, match="parameter 'must' must be given"):
                checked("x", kind=kind)

    def test_a_constructor_of_its_own_goes_before_the_fields(self, derived):
        assert list(declared(derived.Own)) == ["size"]
        assert declared(derived.Own)["size"].default == 5

    def test_the_docstring_below_a_field_is_its_meaning(self, derived):
        expected = {"gamma": "discount of a decision", "rate": "how fast", "size": "how large"}
        assert field_docs(derived.Derived) == field_docs(derived.Quiet) == expected
        assert field_docs(int) == field_docs(type("Made", (), {})) == {}


@pytest.mark.parametrize(
    ("hint", "text", "limits"),
    [
        (float, "float", ""),
        (Annotated[float, Field(gt=0)], "float", "> 0"),
        (Annotated[int, Field(ge=1)], "int", ">= 1"),
        (Annotated[float, Field(ge=-0.5, lt=2)], "float", ">= -0.5, < 2"),
        (Annotated[float, Field(ge=0)] | None, "float | None", ">= 0"),
        (Annotated[tuple[Annotated[int, Field(ge=1)], ...], Field(min_length=1)], "tuple[int, ...]", "each >= 1"),
        (tuple[float, ...], "tuple[float, ...]", ""),
    ],
)
def test_ranges_are_told_for_people(hint, text, limits):
    parameter = Parameter(hint, 0)
    assert (parameter.text, parameter.limits) == (text, limits)
