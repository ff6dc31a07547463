"""No bit of a result changes unless the revision of the part that changed it is raised."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

import pytest
from helpers import pinned_bits

from stlbench.registry import choices, plugins

ROWS = {row.name: row for row in pinned_bits.rows()}


def test_the_bits_of_all_rows_are_the_pinned_ones() -> None:
    pins = pinned_bits.read_pins()
    here = pinned_bits.here()
    if here != {name: pins[name] for name in here}:
        pytest.skip("the pins are of other versions, or of another kind of machine")
    assert pinned_bits.problem(pinned_bits.computed(), pins, pinned_bits.parts()) is None


def test_each_part_of_the_distribution_has_a_row() -> None:
    assert {part for row in ROWS.values() for part in row.parts} == {*pinned_bits.parts()}


@pytest.mark.parametrize(
    ("kind", "name"),
    [tuple(part.split(".")) for part in pinned_bits.parts() if part.startswith(("agents.", "methods."))],
)
def test_each_value_of_each_parameter_has_a_row(kind: str, name: str) -> None:
    """Of a choice between words each, of a number one that is not its default; grids stand in tasks."""
    texts = [word for row in ROWS if row.startswith("training") for word in row.split(" ")]
    chosen = [choice for text in texts if text.partition("[")[0] == name for choice in [choices.parse_choice(text)]]
    for parameter, declared in choices.declared(plugins.find(kind, name).load()).items():
        given = {value for choice in chosen for key, value in choice.parameters if key == parameter}
        if get_origin(declared.hint) is Literal:
            assert {*map(str, get_args(declared.hint))} - {str(declared.default)} <= given, parameter
        elif parameter != "grid":
            assert given - {str(declared.default)}, parameter


class TestAChangedBit:
    """Of rows that are made up of the matrix's names."""

    numbers = pinned_bits.parts()

    @property
    def pins(self) -> dict[str, Any]:
        return {"processor": "one", "revisions": self.numbers, "rows": dict.fromkeys(ROWS, "same")}

    def said(self, part: str, on: str = "one", **raised: int) -> str | None:
        digests = {name: "other" if part in row.parts else "same" for name, row in ROWS.items()}
        return pinned_bits.problem(digests, self.pins, self.numbers | raised, on)

    @pytest.mark.parametrize("part", [*numbers])
    def test_names_its_part_and_the_new_number(self, part: str) -> None:
        said = self.said(part)
        assert said is not None
        assert f"{part} from {self.numbers[part]} to {self.numbers[part] + 1}" in said

    @pytest.mark.parametrize(
        ("rows", "parts"),
        [
            (["rule selection", "training points raw dqn shared patient"], ["harness"]),
            (["training points flag dqn[time_limit=terminal] shared quick"], ["agents.dqn"]),
            (["training pole-fails raw dqn shared quick", "training pole-fails flag dqn shared quick"], ["harness"]),
            (["rewards tltl[semantics=lse]", "rewards bhnr[semantics=lse]"], ["methods.bhnr", "methods.tltl"]),
            (["moves pendulum"], ["tasks.pendulum"]),
        ],
    )
    def test_of_a_few_rows_is_blamed_on_what_they_alone_have(self, rows: list[str], parts: list[str]) -> None:
        assert {*rows} <= {*ROWS}
        assert pinned_bits.suspects(rows) == parts

    def test_of_pytorch_is_no_problem_on_another_processor(self) -> None:
        assert self.said("agents.sb3-sac", on="another") is None
        assert self.said("agents.td3", on="another") is not None

    def test_is_no_problem_once_the_number_is_raised_but_a_new_pin_is_needed(self) -> None:
        assert self.said("none") is None
        said = self.said("methods.raw", **{"methods.raw": self.numbers["methods.raw"] + 1})
        assert said is not None
        assert "pinned_bits.py --write" in said
        assert "bits have changed" not in said
