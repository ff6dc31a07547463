"""No bit of a result changes unless the revision of the part that changed it is raised."""

from __future__ import annotations

from typing import Any

import pytest
from helpers import witnesses
from helpers.witnesses import Witness

from stlbench.registry import plugins

WITNESSES = {witness.part: witness for witness in witnesses.witnesses()}


NIGHTLY = {"agents.best-possible", "agents.sb3-dqn", "agents.sb3-ppo", "agents.sb3-sac", "agents.sb3-td3"}
"""What other libraries train, and what the planner's witness covers too."""


@pytest.mark.parametrize(
    "part", [pytest.param(part, marks=[pytest.mark.slow] if part in NIGHTLY else []) for part in WITNESSES]
)
def test_the_bits_of_a_part_are_those_of_its_revision(part: str) -> None:
    witness = WITNESSES[part]
    if witness.missing:
        pytest.skip(f"{witness.missing} is not installed")
    assert witnesses.problem(witness, witness.compute(), witnesses.read_pins()) is None


def test_each_part_of_the_distribution_has_a_revision() -> None:
    kinds = ("agents", "methods", "suites", "tasks")
    own = {
        f"{kind}.{name}"
        for kind in kinds
        for name, at in plugins.available(kind).items()
        if at.distribution == plugins.OWN
    }
    assert set(WITNESSES) == {"harness", "view"} | own


class TestAChangedBit:
    """Of the method raw, whose witness is made up here."""

    witness = Witness("methods.raw", lambda: {"paid": [0.1, 0.2]})

    @property
    def changed(self) -> dict[str, list[float]]:
        return {"paid": [0.1, 0.2 + 3e-17]}

    @pytest.fixture
    def pins(self) -> dict[str, Any]:
        numbers = self.witness.compute()
        pin = {
            "revisions": self.witness.depends,
            "digest": witnesses.digest(numbers),
            "values": witnesses.sketch(numbers),
        }
        return {"machine": witnesses.here(), "parts": {"methods.raw": pin}}

    def test_names_the_part_the_revision_and_the_file(self, pins: dict[str, Any]) -> None:
        assert witnesses.problem(self.witness, self.witness.compute(), pins) is None
        said = witnesses.problem(self.witness, self.changed, pins)
        number = self.witness.depends["methods.raw"]
        assert said is not None
        assert f"raise methods.raw from {number} to {number + 1} in stlbench/registry/revisions.yaml" in said

    def test_is_no_problem_on_another_processor_where_numbers_are_close(self, pins: dict[str, Any]) -> None:
        pins["machine"]["processor"] = "another"
        assert witnesses.problem(self.witness, self.changed, pins) is None
        assert witnesses.problem(self.witness, {"paid": [0.1, 0.3]}, pins) is not None

    def test_a_raised_revision_needs_a_new_pin(self, pins: dict[str, Any]) -> None:
        pins["parts"]["methods.raw"]["revisions"]["methods.raw"] += 1
        said = witnesses.problem(self.witness, self.witness.compute(), pins)
        assert said is not None
        assert "witnesses.py --write" in said
